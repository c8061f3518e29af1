"""A digital line on a control line that can fail, and in the file of a recorder that makes errors."""

from __future__ import annotations

import errno
import random
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.emulators.clocks import DeviceClock
from tactile_nodes.emulators.world import Edge


class Line(Protocol):
    """A digital line as a function of time."""

    def line_level(self, time_ns: int) -> bool:
        """Whether it was high at a time."""
        ...


class EmulatedControlLine:
    """A control line of a serial adapter.

    Attributes:
        unplugged: the adapter is gone.
        stuck: the level at which it is stuck; None: it follows the line.
    """

    def __init__(self, line: Line, clock: Clock, inverted: bool = False) -> None:
        self.unplugged = False
        self.stuck: bool | None = None
        self._line = line
        self._clock = clock
        self._inverted = inverted

    def level(self) -> bool:
        """The level now."""
        if self.unplugged:
            raise OSError(errno.EIO, 'Input/output error')
        if self.stuck is not None:
            return self.stuck
        return self._line.line_level(self._clock.now_ns()) != self._inverted

    def wait(self) -> bool:
        """Not possible: a simulated line has no interrupt."""
        return False

    def close(self) -> None:
        """Nothing to close."""


@dataclass(frozen=True)
class RecorderFaults:
    """A recorder's errors at edges: missed edges, double edges (a bouncing contact), and random delays."""

    missing: float = 0.0
    doubled: float = 0.0
    jitter_s: float = 0.0


def recorded(
    edges: Sequence[Edge], clock: DeviceClock, faults: RecorderFaults | None = None, seed: int = 1
) -> list[tuple[int, bool]]:
    """(ticks, level) of every edge that a recorder with its own clock records, in order of time."""
    faults = faults or RecorderFaults()
    chance = random.Random(seed)  # noqa: S311  (noise, not secrets)
    recording: list[tuple[int, bool]] = []
    for edge in edges:
        if chance.random() < faults.missing:
            continue
        stamp_ns = edge.stamp_ns + round(chance.uniform(-faults.jitter_s, faults.jitter_s) * NS_PER_S)
        recording.append((clock.offset + clock.count(stamp_ns), edge.level))
        if chance.random() < faults.doubled:
            again_ns = stamp_ns + round(chance.uniform(0.003, 0.03) * NS_PER_S)
            recording.append((clock.offset + clock.count(again_ns), edge.level))
    return sorted(recording)
