"""Which stretches of a bag are episodes of a data set."""

from __future__ import annotations

import dataclasses
from bisect import bisect_left, bisect_right
from typing import Any

from tactile_nodes.bus.topics import FORCE_DISTRIBUTION, PRESS
from tactile_nodes.errors import BagError
from tactile_nodes.exporting.resampling import Episode
from tactile_nodes.exporting.source import Source
from tactile_nodes.messages import stamp_ns, types

BAG, PRESSES = 'bag', 'presses'


def find_episodes(source: Source, cut: str) -> list[Episode]:
    """The episodes of a bag, in order of time: from a force message to a force message.

    Cut at presses, each begins where the window of the press before ended and ends with the window of its own. Where
    there are several sensors, an episode begins and ends where all of them speak.

    Raises:
        BagError: the bag holds no forces, or is to be cut at presses and tells of none.
    """
    topics = [topic for topic, layout in source.layouts.items() if layout.is_force]
    if not topics:
        raise BagError(
            f'{source.bag.path} holds no {FORCE_DISTRIBUTION.name}, which the frames of a data set follow; play it '
            'with a force estimator and record that, or export parquet or zarr'
        )
    stamps = [source.stamps_ns(topic) for topic in topics]
    start_ns, end_ns = max(each[0] for each in stamps), min(each[-1] for each in stamps)
    if cut == BAG:
        return [Episode(start_ns, end_ns)] if start_ns <= end_ns else []
    return _cut(stamps[0], start_ns, end_ns, _presses(source))


def count_outside(stamps: list[int], episodes: list[Episode]) -> int:
    """How many of these stamps, in rising order, lie in no episode."""
    return len(stamps) - sum(
        bisect_right(stamps, each.end_ns) - bisect_left(stamps, each.start_ns) for each in episodes
    )


def _cut(stamps: list[int], start_ns: int, end_ns: int, presses: list[Any]) -> list[Episode]:
    found = []
    after_ns = start_ns - 1
    for press in presses:
        until_ns = min(end_ns, stamp_ns(press.window_end))
        first, past = bisect_right(stamps, after_ns), bisect_right(stamps, until_ns)
        if first < past:
            found.append(Episode(stamps[first], stamps[past - 1], _told(press)))
        after_ns = max(after_ns, until_ns)
    return found


def _told(press: Any) -> dict[str, Any]:
    return {
        'press': int(press.press),
        'attempt': int(press.attempt),
        'press_status': int(press.status),
        'press_reason': str(press.reason),
        'plan_id': str(press.plan_id),
    }


def _presses(source: Source) -> list[Any]:
    """Every attempt once, as it was told of last, by its window; one that is called suspect later keeps its own."""
    topics = [name for name, described in source.bag.topics.items() if described.type_name == PRESS.type_name]
    told = [source.bag.decode(message) for message in source.bag.messages(topics)] if topics else []
    if not told:
        raise BagError(f'{source.bag.path} holds no presses, so it cannot be cut at them; leave out --cut')
    last: dict[Any, Any] = {}
    for press in told:
        key = press.plan_id, press.press, press.attempt
        if press.status != types.Press.STATUS_SUSPECT:
            last[key] = press
        elif key in last:  # it says no more than which one, and why; of one in another bag there is nothing here to cut
            last[key] = dataclasses.replace(last[key], status=press.status, reason=press.reason)
    return sorted(last.values(), key=lambda press: stamp_ns(press.window_end))
