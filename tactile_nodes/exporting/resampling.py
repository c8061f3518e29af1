"""Resampling: messages at any times become frames at a fixed rate; each frame uses existing messages unchanged.

Nothing is interpolated. A frame records the age of each message that it uses; missing values are NaN.
"""

from __future__ import annotations

from bisect import insort
from collections.abc import Iterator
from dataclasses import dataclass, field
from operator import itemgetter
from typing import Any

import numpy as np

from tactile_nodes.clock import NS_PER_S

PREVIOUS, NEAREST = 'previous', 'nearest'
_NEVER_NS = 2**63 - 1
WAIT_NS = 2 * NS_PER_S
"""A frame waits for messages of so much later: that which is nearest may be one of them."""


class Horizon:
    """Up to when everything has come, told from when messages were received [ns, rising] and from their stamps.

    Stamps may be any time older than receipts: those of what was played and recorded again, of another machine's clock.

    >>> Horizon(np.array([100, 101, 102]), np.array([7, 5, 9])).at(101)
    5
    """

    def __init__(self, received_ns: np.ndarray, stamps_ns: np.ndarray) -> None:
        self._received_ns = received_ns
        self._earliest_ns = np.minimum.accumulate(stamps_ns[::-1])[::-1]

    def at(self, received_ns: int) -> int:
        """The earliest stamp of what was received then or later."""
        place = int(np.searchsorted(self._received_ns, received_ns))
        return int(self._earliest_ns[place]) if place < len(self._earliest_ns) else _NEVER_NS


@dataclass(frozen=True)
class Picked:
    """What a frame took of one topic: `value` is None, and `age_s` NaN, while nothing had come. Age: frame - stamp."""

    value: Any = None
    age_s: float = float('nan')


@dataclass
class Track:
    """The latest messages of one topic, by their stamps; older ones than a frame took are forgotten."""

    kept: list[tuple[int, Any]] = field(default_factory=list)

    def take(self, stamp_ns: int, value: Any) -> None:
        """One message more, in any order."""
        insort(self.kept, (stamp_ns, value), key=itemgetter(0))

    def pick(self, frame_ns: int, pick: str) -> Picked:
        """What a frame takes; frames are asked for in rising order."""
        past = sum(stamp_ns <= frame_ns for stamp_ns, _ in self.kept)
        del self.kept[: max(0, past - 1)]
        candidates = self.kept[: min(past, 1)] if pick == PREVIOUS else self.kept[: min(past, 1) + 1]
        if not candidates:
            return Picked()
        stamp_ns, value = min(candidates, key=lambda each: abs(each[0] - frame_ns))
        return Picked(value, (frame_ns - stamp_ns) / NS_PER_S)


@dataclass(frozen=True)
class Episode:
    """A stretch of a bag, both ends included [ns]; `told` is what is known of it."""

    start_ns: int
    end_ns: int
    told: dict[str, Any] = field(default_factory=dict)

    def frames_ns(self, fps: int) -> Iterator[int]:
        """When its frames are: the first at its start."""
        for number in range((self.end_ns - self.start_ns) * fps // NS_PER_S + 1):
            yield self.start_ns + (number * NS_PER_S + fps // 2) // fps


@dataclass(frozen=True)
class Frame:
    """One frame of an episode (counted from 0), with what it took of each topic."""

    episode: int
    number: int
    stamp_ns: int
    picked: dict[str, Picked]


class Resampler:
    """Turns messages in the order of their receipt into frames of episodes that follow each other in time."""

    def __init__(self, topics: list[str], episodes: list[Episode], fps: int, pick: str) -> None:
        self._tracks = {topic: Track() for topic in topics}
        self._pick = pick
        self._due = (
            (index, number, stamp_ns)
            for index, episode in enumerate(episodes)
            for number, stamp_ns in enumerate(episode.frames_ns(fps))
        )
        self._next = next(self._due, None)

    def take(self, topic: str, stamp_ns: int, horizon_ns: int, value: Any) -> Iterator[Frame]:
        """One message, before which all up to `horizon_ns` have come; gives the frames that wait for nothing more."""
        yield from self._until(horizon_ns - WAIT_NS)
        self._tracks[topic].take(stamp_ns, value)
        self._forget(topic)

    def finish(self) -> Iterator[Frame]:
        """No more messages: the frames that are left."""
        yield from self._until(None)

    def _until(self, end_ns: int | None) -> Iterator[Frame]:
        while self._next is not None and (end_ns is None or self._next[2] <= end_ns):
            index, number, stamp_ns = self._next
            picked = {topic: track.pick(stamp_ns, self._pick) for topic, track in self._tracks.items()}
            yield Frame(index, number, stamp_ns, picked)
            self._next = next(self._due, None)

    def _forget(self, topic: str) -> None:
        """Between episodes no frame is due, and messages would pile up."""
        if self._next is None:
            self._tracks[topic].kept.clear()
        elif len(self._tracks[topic].kept) > 1 and self._tracks[topic].kept[1][0] <= self._next[2]:
            self._tracks[topic].pick(self._next[2], PREVIOUS)


@dataclass
class Statistics:
    """Minimum, maximum, mean and standard deviation of a feature, component by component, a row at a time.

    Numbers that are none do not count. `shape` is that of one row; sums are taken about the first row, for precision.
    """

    shape: tuple[int, ...]
    rows: int = 0

    def __post_init__(self) -> None:
        self._count, self._sum, self._squares = (np.zeros(self.shape) for _ in range(3))
        self._low, self._high = np.full(self.shape, np.inf), np.full(self.shape, -np.inf)
        self._pivot = np.full(self.shape, np.nan)

    def take(self, row: Any) -> None:
        """One row, or the many points of one (its first axis), a picture's pixels say."""
        values = np.asarray(row, np.float64).reshape(-1, *self.shape)
        finite = np.isfinite(values)
        self._pivot = np.where(np.isnan(self._pivot) & finite[0], values[0], self._pivot)
        apart = np.where(finite, values - np.nan_to_num(self._pivot), 0.0)
        self.rows += 1
        self._count += finite.sum(axis=0)
        self._sum += apart.sum(axis=0)
        self._squares += (apart**2).sum(axis=0)
        self._low = np.minimum(self._low, np.where(finite, values, np.inf).min(axis=0))
        self._high = np.maximum(self._high, np.where(finite, values, -np.inf).max(axis=0))

    def told(self) -> dict[str, Any] | None:
        """As LeRobot names them; None where a component never was a number."""
        if not self._count.all():
            return None
        mean = self._sum / self._count
        spread = np.sqrt(np.maximum(self._squares / self._count - mean**2, 0.0))
        found = {'min': self._low, 'max': self._high, 'mean': self._pivot + mean, 'std': spread}
        return {**{name: value.tolist() for name, value in found.items()}, 'count': [self.rows]}
