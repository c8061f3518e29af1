"""The digital line as recorders see it: on a control line, as a light in a camera's view, and in a recorder's file."""

from __future__ import annotations

import errno
import random
from collections.abc import Sequence
from dataclasses import dataclass

from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.emulators.clocks import DeviceClock
from tactile_nodes.emulators.world import Edge, LineSource, World
from tactile_nodes.simulation import worlds


class EmulatedControlLine:
    """A control line of a serial adapter.

    Attributes:
        unplugged: the adapter is gone.
        stuck: the level at which it is stuck; None: it follows the line.
    """

    def __init__(self, line: LineSource, clock: Clock, inverted: bool = False) -> None:
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


class SharedLine:
    """The line of a world that is shared by name in this process; low while there is no such world."""

    def __init__(self, name: str) -> None:
        self._name = name

    def line_level(self, time_ns: int) -> bool:
        """See `LineSource.line_level`."""
        world = worlds.find(self._name)
        return isinstance(world, World) and world.line_level(time_ns)

    def line_edges(self) -> Sequence[Edge]:
        """See `LineSource.line_edges`."""
        world = worlds.find(self._name)
        return world.line_edges() if isinstance(world, World) else ()


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


def light_brightness(
    edges: Sequence[Edge], start_ns: int, exposure_s: float, dark: float = 20.0, bright: float = 220.0
) -> float:
    """Grey level of a light that follows the line, in a frame whose exposure starts at `start_ns`."""
    end_ns = start_ns + round(exposure_s * NS_PER_S)
    lit_ns, on, since_ns = 0, False, start_ns
    for edge in edges:
        if edge.stamp_ns >= end_ns:
            break
        if edge.stamp_ns > start_ns:
            lit_ns += on * (edge.stamp_ns - since_ns)
            since_ns = edge.stamp_ns
        on = edge.level
    lit_ns += on * (end_ns - since_ns)
    return dark + (bright - dark) * lit_ns / (end_ns - start_ns)
