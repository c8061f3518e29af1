"""The parts of a bag that become episodes of a data set."""

from __future__ import annotations

import dataclasses
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from tactile_nodes.bag.compare import find_topic
from tactile_nodes.bus.topics import FORCE_DISTRIBUTION, PRESS
from tactile_nodes.clock import NS_PER_S
from tactile_nodes.errors import BagError
from tactile_nodes.exporting.resampling import Episode
from tactile_nodes.exporting.source import Source
from tactile_nodes.messages import stamp_ns, types

BAG, PRESSES = 'bag', 'presses'
LONGEST_GAP_NS = 24 * 3600 * NS_PER_S
"""No recording pauses that long. A clock that is set may leave a gap of decades, with a frame every 1/fps s."""


@dataclass(frozen=True)
class Limit:
    """Where the episodes of a bag may begin or end, the topic that sets it, and how many seconds of forces lie beyond.

    They begin at the first message of the last topic to start, and end with the forces of the first sensor to stop.
    """

    at_ns: int
    topic: str
    skipped_s: float


def find_start(source: Source, topics: Iterable[str]) -> Limit:
    """The time from which on all of `topics` and all forces have a message.

    Raises:
        BagError: the bag holds no forces that can be read.
    """
    forces = _force_topics(source)
    first_ns = source.first_stamps_ns({*topics, *forces})
    topic = max(sorted(first_ns), key=lambda each: first_ns[each])
    earliest_ns = min(first_ns[each] for each in forces)
    return Limit(first_ns[topic], topic, max(0, first_ns[topic] - earliest_ns) / NS_PER_S)


def find_end(source: Source) -> Limit:
    """The time until which all sensors have forces. Raises BagError: the bag holds no forces that can be read."""
    last_ns = {topic: source.stamps_ns(topic)[-1] for topic in _force_topics(source)}
    topic = min(sorted(last_ns), key=lambda each: last_ns[each])
    return Limit(last_ns[topic], topic, (max(last_ns.values()) - last_ns[topic]) / NS_PER_S)


def find_episodes(source: Source, cut: str, exclude: Sequence[str], start: Limit, end: Limit) -> list[Episode]:
    """The episodes of a bag from `start` to `end`, in order of time; each ends at a force message.

    When cut at presses, an episode begins where the window of the previous press ended, and ends with the window of its
    own press. Presses without a force in between are counted in the source's `left_out`.

    Raises:
        BagError: there is no force from `start` on, their stamps jump, or the bag is to be cut at presses and has none,
            or those of several rigs that are not in `exclude`.
    """
    stamps, end_ns = source.stamps_ns(_force_topics(source)[0]), end.at_ns
    if start.at_ns > end_ns:
        raise BagError(
            f'{start.topic} of {source.bag.path} has no message until after the last force; '
            f'leave it out with --exclude {start.topic}'
        )
    _require_no_gap(source, stamps, start.at_ns, end_ns)
    if cut == BAG:
        return [Episode(start.at_ns, end_ns)]
    presses = _presses(source, exclude)
    found = _cut(stamps, start.at_ns, end_ns, presses)
    if lost := len(presses) - len(found):
        source.left_out[f'presses of {source.bag.path.name}'] = (
            f'{lost} of {len(presses)}: no force after the window before and until the end of their own'
        )
    return found


def _require_no_gap(source: Source, stamps: list[int], start_ns: int, end_ns: int) -> None:
    within = (each for each in stamps if start_ns <= each <= end_ns)
    gap_ns = max((after - before for before, after in pairwise([start_ns, *within])), default=0)
    if gap_ns > LONGEST_GAP_NS:
        raise BagError(
            f'the stamps of the forces in {source.bag.path} jump by {gap_ns / NS_PER_S / 86_400:.0f} days, as when a '
            'clock is set; export parquet or zarr, or record again with the clock set before'
        )


def _force_topics(source: Source) -> list[str]:
    topics = [topic for topic, layout in source.layouts.items() if layout.is_force]
    if not topics:
        raise BagError(
            f'no {FORCE_DISTRIBUTION.name} of {source.bag.path} is exported, which sets the times of frames; add it '
            'to --topics, or if the bag holds none, compute it from image_raw: tactile launch replay bag:=…'
        )
    return topics


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
            found.append(Episode(stamps[first], stamps[past - 1], _details(press)))
        after_ns = max(after_ns, until_ns)
    return found


def _details(press: Any) -> dict[str, Any]:
    return {
        'press': int(press.press),
        'attempt': int(press.attempt),
        'press_status': int(press.status),
        'press_reason': str(press.reason),
        'plan_id': str(press.plan_id),
    }


def _presses(source: Source, exclude: Sequence[str]) -> list[Any]:
    """A message for each attempt and window, sorted by window; an attempt marked suspect later keeps its window.

    A rig that is started anew within a bag presses the same attempts again, in other windows.
    """
    excluded = {find_topic(source.bag, topic) for topic in exclude}
    topics = [
        name
        for name, described in source.bag.topics.items()
        if described.type_name == PRESS.type_name and name not in excluded
    ]
    if len(topics) > 1:  # rigs that press at once would cut each other's presses
        raise BagError(
            f'{source.bag.path} holds the presses of several rigs: {", ".join(topics)}; export those of each alone, '
            f'the first with --exclude {" ".join(topics[1:])}'
        )
    messages = list(source.bag.messages(topics)) if topics else []
    if not messages:
        raise BagError(f'{source.bag.path} holds no presses, so it cannot be cut at presses; leave out --cut')
    found: dict[Any, Any] = {}
    windows_ns: dict[Any, int] = {}
    for message in messages:
        press = source.bag.decode(message)
        attempt = press.plan_id, press.press, press.attempt
        if press.status != types.Press.STATUS_SUSPECT:
            windows_ns[attempt] = stamp_ns(press.window_end)
            found[attempt, windows_ns[attempt]] = press
        elif attempt in windows_ns:  # it names only attempt and reason; the attempt itself may be in another bag
            key = attempt, windows_ns[attempt]
            found[key] = dataclasses.replace(found[key], status=press.status, reason=press.reason)
    return sorted(found.values(), key=lambda press: stamp_ns(press.window_end))
