"""The capture time of the last message of a topic."""

from __future__ import annotations

import math
from collections.abc import Iterable

from tactile_nodes.bag.content import ALWAYS_NS
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.clock import NS_PER_S

REACHES_S = 2.0, 20.0, 200.0, math.inf
"""How far back from the end of a bag to search first: most topics have messages up to the end."""


def last_stamps_ns(bag: BagReader, topics: Iterable[str]) -> dict[str, int]:
    """The newest stamp of each of the topics that has any."""
    left, found = {topic for topic in topics if bag.counts.get(topic)}, dict[str, int]()
    for reach_s in REACHES_S:
        start_ns = ALWAYS_NS[0] if math.isinf(reach_s) else bag.extent.end_ns - round(reach_s * NS_PER_S)
        for message in bag.messages(left, start_ns) if left else ():
            if (stamp_ns := bag.stamp_ns(message)) is not None:
                found[message.topic] = max(stamp_ns, found.get(message.topic, stamp_ns))
        left -= found.keys()
    return found
