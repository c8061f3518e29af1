"""Switching of the digital line at irregular times, apart from presses, so that recorders can be matched.

Presses are alike, so their edges are periodic, and edges of different recorders cannot be matched uniquely. A few edges
at times that are unique to the run solve this. The times follow from the plan's id and the number of the pattern, so
they are known from the plan, and a resumed run continues with another pattern.
"""

from __future__ import annotations

import hashlib

from tactile_nodes.collection.actions import Go, Look, Procedure, Switch
from tactile_nodes.collection.settings import CollectionSettings

SHORTEST_S, LONGEST_S = 0.4, 2.5
"""Range of the gaps: long enough for a camera to see both levels."""


def pattern_gaps(plan_id: str, number: int, edges: int) -> tuple[float, ...]:
    """Seconds before each edge of a pattern, to the millisecond, from 0.4 to 2.5 s.

    The first is 0.4 + 2.1 * s, with s = the first 32 bits of SHA-256("a1b2c3d4e5f6 1 0") / 2^32.
    """
    digests = (hashlib.sha256(f'{plan_id} {number} {edge}'.encode()).digest() for edge in range(edges))
    shares = (int.from_bytes(digest[:4], 'big') / 2**32 for digest in digests)
    return tuple(round(SHORTEST_S + (LONGEST_S - SHORTEST_S) * share, 3) for share in shares)


def sync_pattern(gaps: list[float], settings: CollectionSettings, safe_z_mm: float) -> Procedure[None]:
    """Switch the line with the tip above the gel: high, low, high, ...; it ends low.

    Args:
        gaps: seconds before each edge. The gaps of a pulse are removed when it starts. So a pattern that is restarted
            because a device became silent continues with the next pulse.
        settings: the feed for going up.
        safe_z_mm: the height to go to.
    """
    if gaps:
        yield Go(z=safe_z_mm, feed_mm_min=settings.motion.travel_mm_min)
    while gaps:
        low_s, high_s, *rest = gaps
        yield Look(low_s)
        gaps[:] = rest  # on a failure, bringing the tip up sets the line low
        yield Switch(True)
        yield Look(high_s)
        yield Switch(False)
