"""Common part of emulated serial force/torque sensors: samples by their own clock, and faults."""

from __future__ import annotations

import random
from dataclasses import dataclass

from tactile_nodes.emulators.clocks import DeviceClock
from tactile_nodes.emulators.world import WrenchSource

MICROSECONDS = 1e6
MOST_AT_ONCE = 20_000
NOT_YET = (float('nan'),) * 6


@dataclass
class SerialFtFaults:
    """The faults; the numbers count down as they take effect.

    Attributes:
        silent: it sends nothing.
        stuck: it repeats its last values while its clock goes on.
        saturated: it is at the end of its range.
        lose: this many samples are lost on the line.
        garble: in this many samples a byte is damaged.
        garbage: instead of this many samples there is noise on the line.
    """

    silent: bool = False
    stuck: bool = False
    saturated: bool = False
    lose: int = 0
    garble: int = 0
    garbage: int = 0


class SampledSensor:
    """Takes a sample every `period_us` of its own clock."""

    def __init__(self, world: WrenchSource, clock: DeviceClock, noise: float) -> None:
        self.world = world
        self.clock = clock
        self.faults = SerialFtFaults()
        self.period_us = 10_000.0
        self._noise = noise
        self._random = random.Random(1)  # noqa: S311  (noise, not secrets)
        self._from = 0
        self._taken = 0
        self._values: tuple[float, ...] = NOT_YET

    def restart(self, now_ns: int) -> None:
        self._from = self.clock.count(now_ns)
        self._taken = 0

    def next_sample_ns(self) -> int:
        return self.clock.time_ns(self._next_count())

    def samples(self, now_ns: int) -> list[tuple[int, tuple[float, ...]]]:
        """(own clock's reading, six values) of every sample completed since the last call."""
        found: list[tuple[int, tuple[float, ...]]] = []
        while len(found) < MOST_AT_ONCE and self.next_sample_ns() <= now_ns:
            count = self._next_count()
            self._taken += 1
            found.append((self.clock.reading(count), self._sampled(count)))
        return found

    def spoilt(self, sent: bytes) -> bytes:
        """The bytes that reach the host, after the active faults."""
        faults = self.faults
        if faults.silent:
            return b''
        if faults.lose > 0:
            faults.lose -= 1
            return b''
        if faults.garbage > 0:
            faults.garbage -= 1
            return self._random.randbytes(len(sent))
        if faults.garble > 0:
            faults.garble -= 1
            middle = len(sent) // 2
            return sent[:middle] + bytes([sent[middle] ^ 0x55]) + sent[middle + 1 :]
        return sent

    def _next_count(self) -> int:
        return self._from + round((self._taken + 1) * self.period_us)

    def _sampled(self, count: int) -> tuple[float, ...]:
        if not self.faults.stuck or self._values is NOT_YET:
            wrench = self.world.wrench_at(self.clock.time_ns(count))
            self._values = tuple(value + self._random.gauss(0.0, self._noise) for value in wrench)
        return self._values


def microsecond_clock(start_ns: int = 0, offset: int = 0, drift_ppm: float = 0.0) -> DeviceClock:
    """A counter of microseconds, 32 bits wide: it wraps after 71.6 min."""
    return DeviceClock(MICROSECONDS, start_ns, offset, drift_ppm)
