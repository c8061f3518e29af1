"""Clocks of emulated devices: counters with any start value, which run a little too fast or too slow."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from tactile_nodes.clock import NS_PER_S, Clock


@dataclass(frozen=True)
class DeviceClock:
    """A counter with its own oscillator.

    With 7000 ticks per second and a drift of +100 ppm, 1 h of the host's time is 25 202 520 ticks, 2520 too many.

    Attributes:
        rate_hz: nominal ticks per second.
        start_ns: the time on the host's base at which it read `offset`.
        offset: its reading at `start_ns`.
        drift_ppm: how much too fast it runs.
        bits: its width, at which the readings of the device wrap around.
    """

    rate_hz: float
    start_ns: int = 0
    offset: int = 0
    drift_ppm: float = 0.0
    bits: int = 32

    def count(self, time_ns: int) -> int:
        """Whole ticks since `start_ns`; negative before it."""
        return math.floor((time_ns - self.start_ns) * self._ticks_per_ns)

    def time_ns(self, count: int) -> int:
        """The time of a tick: the first ns at which `count` has this value."""
        return self.start_ns + math.ceil(count / self._ticks_per_ns)

    def reading(self, count: int) -> int:
        """The device's reading after this many ticks: with the offset, wrapped to its width."""
        return (self.offset + count) % (1 << self.bits)

    def altered(self, time_ns: int, drift_ppm: float, jump_s: float = 0.0) -> DeviceClock:
        """This clock with another drift and a jump ahead, from a time on. `count` continues, the reading jumps.

        A clock of 7000 Hz that reads 700 and jumps by 1 s reads 7700 next.
        """
        changed = replace(self, drift_ppm=drift_ppm, offset=self.offset + round(jump_s * self.rate_hz))
        passed_ns = math.ceil(self.count(time_ns) / changed._ticks_per_ns)
        return replace(changed, start_ns=time_ns - passed_ns)

    @property
    def _ticks_per_ns(self) -> float:
        return self.rate_hz * (1.0 + self.drift_ppm * 1e-6) / NS_PER_S


class ForeignClock:
    """The clock of another computer or of a recorder, with an offset and a drift.

    Args:
        host: the true time.
        ahead_s: how far it is ahead when it is made.
        drift_ppm: how much too fast it runs.
    """

    def __init__(self, host: Clock, ahead_s: float = 0.0, drift_ppm: float = 0.0) -> None:
        self._host = host
        start_ns = host.now_ns()
        self._counter = DeviceClock(NS_PER_S, start_ns, start_ns + round(ahead_s * NS_PER_S), drift_ppm, 64)

    def now_ns(self) -> int:
        """Its reading now."""
        return self.reading_ns(self._host.now_ns())

    def reading_ns(self, host_ns: int) -> int:
        """Its reading at a time of the host."""
        return self._counter.offset + self._counter.count(host_ns)

    def sleep_until(self, ns: int) -> None:
        """Sleep until it has this reading."""
        self._host.sleep_until(self._counter.time_ns(ns - self._counter.offset))
