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
"""A frame waits for messages up to this much later, because one of them may be the nearest."""


class Horizon:
    """The time up to which all messages have been received, from receive times [ns, rising] and stamps.

    Stamps may be much older than receive times: those of a bag that was played and recorded again, or of another clock.

    >>> Horizon(np.array([100, 101, 102]), np.array([7, 5, 9])).at(101)
    5
    """

    def __init__(self, received_ns: np.ndarray, stamps_ns: np.ndarray) -> None:
        self._received_ns = received_ns
        self._earliest_ns = np.minimum.accumulate(stamps_ns[::-1])[::-1]

    def at(self, received_ns: int) -> int:
        """The earliest stamp of the messages received at `received_ns` or later."""
        place = int(np.searchsorted(self._received_ns, received_ns))
        return int(self._earliest_ns[place]) if place < len(self._earliest_ns) else _NEVER_NS


@dataclass(frozen=True)
class Picked:
    """The message of one topic in a frame: `value` and `age_s` (frame - stamp); None and NaN before the first one."""

    value: Any = None
    age_s: float = float('nan')


@dataclass
class Track:
    """The latest messages of one topic, by stamp; those older than the last frame needs are dropped."""

    kept: list[tuple[int, Any]] = field(default_factory=list)

    def take(self, stamp_ns: int, value: Any) -> None:
        """Add a message; messages may come in any order."""
        insort(self.kept, (stamp_ns, value), key=itemgetter(0))

    def pick(self, frame_ns: int, pick: str) -> Picked:
        """The message for a frame; frames must come in rising order."""
        past = sum(stamp_ns <= frame_ns for stamp_ns, _ in self.kept)
        del self.kept[: max(0, past - 1)]
        candidates = self.kept[: min(past, 1)] if pick == PREVIOUS else self.kept[: min(past, 1) + 1]
        if not candidates:
            return Picked()
        stamp_ns, value = min(candidates, key=lambda each: abs(each[0] - frame_ns))
        return Picked(value, (frame_ns - stamp_ns) / NS_PER_S)


@dataclass(frozen=True)
class Episode:
    """A part of a bag, both ends included [ns]; `details` describes it."""

    start_ns: int
    end_ns: int
    details: dict[str, Any] = field(default_factory=dict)

    def frames_ns(self, fps: int) -> Iterator[int]:
        """The times of its frames; the first is its start."""
        for number in range((self.end_ns - self.start_ns) * fps // NS_PER_S + 1):
            yield self.start_ns + (number * NS_PER_S + fps // 2) // fps


@dataclass(frozen=True)
class Frame:
    """One frame of an episode (counted from 0), with the message picked for each topic."""

    episode: int
    number: int
    stamp_ns: int
    picked: dict[str, Picked]


class Resampler:
    """Turns messages, in the order received, into frames of episodes, which follow each other in time."""

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
        """Add a message; all with stamps up to `horizon_ns` have come before it. Gives the frames that are complete."""
        yield from self._until(horizon_ns - WAIT_NS)
        self._tracks[topic].take(stamp_ns, value)
        self._forget(topic)

    def finish(self) -> Iterator[Frame]:
        """The remaining frames, after the last message."""
        yield from self._until(None)

    def _until(self, end_ns: int | None) -> Iterator[Frame]:
        while self._next is not None and (end_ns is None or self._next[2] <= end_ns):
            index, number, stamp_ns = self._next
            picked = {topic: track.pick(stamp_ns, self._pick) for topic, track in self._tracks.items()}
            yield Frame(index, number, stamp_ns, picked)
            self._next = next(self._due, None)

    def _forget(self, topic: str) -> None:
        """Drop messages that no frame needs; between episodes they would fill the memory."""
        if self._next is None:
            self._tracks[topic].kept.clear()
        elif len(self._tracks[topic].kept) > 1 and self._tracks[topic].kept[1][0] <= self._next[2]:
            self._tracks[topic].pick(self._next[2], PREVIOUS)


@dataclass
class Statistics:
    """Minimum, maximum, mean and standard deviation of each component of a feature, updated row by row.

    NaN and infinities do not count. `shape` is that of one row. Sums are relative to the first row, for precision.
    """

    shape: tuple[int, ...]
    rows: int = 0

    def __post_init__(self) -> None:
        self._count, self._sum, self._squares = (np.zeros(self.shape) for _ in range(3))
        self._low, self._high = np.full(self.shape, np.inf), np.full(self.shape, -np.inf)
        self._pivot = np.full(self.shape, np.nan)

    def take(self, row: Any) -> None:
        """Add one row, or the many samples in it (its first axis), such as the pixels of a picture."""
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

    def join(self, other: Statistics) -> None:
        """Add all rows of `other`."""
        pivot = np.where(np.isnan(self._pivot), other._pivot, self._pivot)
        moved = np.nan_to_num(other._pivot - pivot)  # sums of numbers less one pivot become those less the other
        self._squares += other._squares + 2 * moved * other._sum + moved**2 * other._count
        self._sum += other._sum + moved * other._count
        self._count += other._count
        self._low, self._high = np.minimum(self._low, other._low), np.maximum(self._high, other._high)
        self._pivot, self.rows = pivot, self.rows + other.rows

    def summary(self) -> dict[str, Any] | None:
        """The statistics under LeRobot's names; None if a component was never a number."""
        if not self._count.all():
            return None
        mean = self._sum / self._count
        spread = np.sqrt(np.maximum(self._squares / self._count - mean**2, 0.0))
        found = {'min': self._low, 'max': self._high, 'mean': self._pivot + mean, 'std': spread}
        return {**{name: value.tolist() for name, value in found.items()}, 'count': [self.rows]}
