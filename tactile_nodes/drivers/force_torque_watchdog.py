"""Says within milliseconds that a force/torque sensor is silent, late, stuck or ill, so that whoever moves can stop.

Fed by the thread that reads the sensor (``sensor.listen(watchdog.feed)``) and asked by the loop that moves.
"""

from __future__ import annotations

from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.drivers.force_torque import UNUSABLE, Flag, Sample
from tactile_nodes.errors import DeviceError, DeviceTimeoutError

PERIODS = 3


class Watchdog:
    """Remembers when the last good measurement was made.

    A sample that is late counts from when it was measured, not from when it arrived; one that repeats an old
    measurement does not count at all. So a sensor that is silent, an overloaded host and a front end that stands still
    are all seen, and after the same time.

    Args:
        name: of the sensor, for errors.
        clock: the host's.
        silence_ms: the longest age of the newest good measurement.
        rate_hz: of the sensor; three of its periods are granted if they are longer. 0: not known.
    """

    def __init__(self, name: str, clock: Clock, silence_ms: float = 50.0, rate_hz: float = 0.0) -> None:
        self._name = name
        self._clock = clock
        self._limit_ns = round(max(silence_ms / 1e3, PERIODS / rate_hz if rate_hz > 0 else 0.0) * NS_PER_S)
        self._measured_ns = clock.now_ns()
        self._newest: Sample | None = None

    @property
    def limit_ms(self) -> float:
        """The silence that is granted."""
        return self._limit_ns / 1e6

    def feed(self, sample: Sample) -> None:
        """A sample has come."""
        if not sample.flags & Flag.STALLED:
            self._measured_ns = max(self._measured_ns, sample.stamp_ns)
        self._newest = sample

    def check(self) -> None:
        """Return if all is well.

        Raises:
            DeviceTimeoutError: no new measurement for too long.
            DeviceError: the newest sample cannot be used.
        """
        newest = self._newest
        age_ns = self._clock.now_ns() - self._measured_ns
        if age_ns > self._limit_ns:
            raise DeviceTimeoutError(self._silence(newest, age_ns))
        if newest is not None and newest.flags & (UNUSABLE & ~Flag.STALLED):
            what = 'is beyond its range' if newest.flags & Flag.SATURATED else 'reports a fault'
            raise DeviceError(f'{self._name} {what} (status {newest.status:#x}); unload it and see what it says')

    def _silence(self, newest: Sample | None, age_ns: int) -> str:
        age_ms = age_ns / 1e6
        if newest is None:
            return f'{self._name} has not measured anything for {age_ms:.0f} ms; check its power and cable'
        if newest.flags & Flag.STALLED:
            return f'{self._name} has repeated one measurement for {age_ms:.0f} ms; switch it off and on'
        if self._clock.now_ns() - newest.arrival_ns < self._limit_ns:
            return f'the samples of {self._name} arrive {age_ms:.0f} ms late; relieve this computer or the network'
        return f'{self._name} has been silent for {age_ms:.0f} ms; check its power and cable'
