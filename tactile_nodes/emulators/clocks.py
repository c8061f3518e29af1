"""Clocks of emulated devices: counters that start anywhere and run a little too fast or too slow."""

from __future__ import annotations

import math
from dataclasses import dataclass

NS_PER_S = 1_000_000_000


@dataclass(frozen=True)
class DeviceClock:
    """A counter driven by a crystal of its own.

    With 7000 ticks a second and a drift of +100 ppm, 1 h of the host's time is 25 202 520 ticks; 2520 too many.

    Attributes:
        rate_hz: nominal ticks a second.
        start_ns: the time on the host's base at which it read `offset`.
        offset: its reading then.
        drift_ppm: how much too fast it runs.
        bits: its width; the readings that leave the device wrap around there.
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
        """When that many ticks had passed: the first ns at which `count` says so."""
        return self.start_ns + math.ceil(count / self._ticks_per_ns)

    def reading(self, count: int) -> int:
        """What the device says after that many ticks: offset added, wrapped to its width."""
        return (self.offset + count) % (1 << self.bits)

    @property
    def _ticks_per_ns(self) -> float:
        return self.rate_hz * (1.0 + self.drift_ppm * 1e-6) / NS_PER_S
