"""Time differences between the pictures of several sensors in one bag."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactile_nodes.bag.reader import BagReader
from tactile_nodes.shapes import Int


@dataclass(frozen=True)
class PicturesApart:
    """Time differences (s) between the `count` pictures of the first sensor and the nearest one of every other.

    `sensors` are namespaces. `alone` counts pictures whose difference is more than half a frame time.
    """

    sensors: tuple[str, ...]
    count: int
    median_s: float
    largest_s: float
    alone: int

    def __str__(self) -> str:
        """In one line: '2 (/left, /right), pictures 3.1 ms apart (median), 8.2 ms at most'."""
        text = (
            f'{len(self.sensors)} ({", ".join(self.sensors)}), pictures {1e3 * self.median_s:.1f} ms apart (median), '
            f'{1e3 * self.largest_s:.1f} ms at most'
        )
        return f'{text}; {self.alone} of {self.count} have none within half a frame time' if self.alone else text


def pictures_apart(bag: BagReader, names: Sequence[str]) -> PicturesApart | None:
    """Compare the stamps of the first topic of these names that several sensors have; None if there is none.

    Stamps of 0, 20 and 40 ms beside 3, 24 and 41 ms are 3 ms apart in the median and 4 ms at most.
    """
    topics = next((found for name in names if len(found := _of_sensors(bag, name)) > 1), None)
    if topics is None:
        return None
    stamps = _stamps_ns(bag, topics)
    sensors = tuple(sensor for sensor, each in stamps.items() if len(each))
    if len(sensors) < 2:
        return None
    first, *others = (stamps[sensor] for sensor in sensors)
    nearest = np.stack([first, *(_nearest(first, each) for each in others)])
    apart_s = np.ptp(nearest, axis=0) * 1e-9
    frame_s = float(np.median(np.diff(first))) * 1e-9 if len(first) > 1 else np.inf
    alone = int(np.count_nonzero(apart_s > frame_s / 2))
    return PicturesApart(sensors, len(first), float(np.median(apart_s)), float(apart_s.max()), alone)


def _of_sensors(bag: BagReader, name: str) -> dict[str, str]:
    """Topics with that last name and messages, mapped to the namespaces of their sensors."""
    found = {topic: topic.rpartition('/')[0] or '/' for topic in sorted(bag.topics) if bag.counts.get(topic)}
    return {topic: sensor for topic, sensor in found.items() if topic.rpartition('/')[2] == name.strip('/')}


def _stamps_ns(bag: BagReader, topics: dict[str, str]) -> dict[str, Int[np.ndarray, ' messages']]:
    """The stamps of each sensor in rising order."""
    stamps: dict[str, list[int]] = defaultdict(list)
    for message in bag.messages(list(topics)):
        if (stamp := bag.stamp_ns(message)) is not None:
            stamps[topics[message.topic]].append(stamp)
    return {sensor: np.unique(np.array(stamps[sensor], np.int64)) for sensor in topics.values()}


def _nearest(to: Int[np.ndarray, ' n'], stamps: Int[np.ndarray, ' m']) -> Int[np.ndarray, ' n']:
    """The nearest of the rising `stamps` to each time in `to`."""
    after = np.clip(np.searchsorted(stamps, to), 1, max(1, len(stamps) - 1))
    before, later = stamps[after - 1], stamps[np.minimum(after, len(stamps) - 1)]
    found: np.ndarray = np.where(to - before <= later - to, before, later)
    return found
