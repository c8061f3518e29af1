"""When the digital line is switched apart from presses: at irregular times, so that recorders can be told apart.

Presses are alike, so their edges are periodic, and nobody can tell which edge of one recorder is which of another. A
few edges at times that no other run has settle it. The times follow from the plan's id and the number of the pattern,
so whoever has the plan knows them, and a run that is resumed goes on with another one.
"""

from __future__ import annotations

import hashlib

from tactile_nodes.collection.actions import Go, Look, Procedure, Switch
from tactile_nodes.collection.settings import CollectionSettings

SHORTEST_S, LONGEST_S = 0.4, 2.5
"""Long enough for a camera to see both levels, short enough to be over soon; no whole frames, no usual periods."""


def pattern_gaps(plan_id: str, number: int, edges: int) -> tuple[float, ...]:
    """Seconds before each edge of a pattern, to the millisecond, from 0.4 to 2.5 s.

    Of a SHA-256 over "a1b2c3d4e5f6 1 0", whose first 32 bits are a share s of 2^32, the first is 0.4 + 2.1 s.
    """
    return tuple(
        round(SHORTEST_S + (LONGEST_S - SHORTEST_S) * _share(plan_id, number, edge), 3) for edge in range(edges)
    )


def sync_pattern(gaps: list[float], settings: CollectionSettings, safe_z_mm: float) -> Procedure[None]:
    """Switch the line with the tip above the gel: up, down, up, ...; it ends low.

    Args:
        gaps: seconds before each edge. Those of a pulse that is begun are taken away: a pattern that is begun again
            because a device fell silent goes on with the next.
        settings: how fast to go up.
        safe_z_mm: where to.
    """
    if gaps:
        yield Go(z=safe_z_mm, feed_mm_min=settings.motion.travel_mm_min)
    while gaps:
        low_s, high_s, *rest = gaps
        yield Look(low_s)
        gaps[:] = rest  # whatever happens now, who brings the tip up leaves the line low
        yield Switch(True)
        yield Look(high_s)
        yield Switch(False)


def _share(plan_id: str, number: int, edge: int) -> float:
    digest = hashlib.sha256(f'{plan_id} {number} {edge}'.encode()).digest()
    return int.from_bytes(digest[:4], 'big') / 2**32
