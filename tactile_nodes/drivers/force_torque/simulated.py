"""The simulated force/torque sensor: it measures a world given as a function of time, at its rate."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np

from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.drivers.force_torque.check import SampleCheck
from tactile_nodes.drivers.force_torque.contract import (
    AXES,
    ForceTorqueSensor,
    ForceTorqueSettings,
    Listener,
    Sample,
    Wrench,
)
from tactile_nodes.drivers.force_torque.queue import SampleQueue, closed
from tactile_nodes.drivers.health import Health, Level
from tactile_nodes.errors import DeviceTimeoutError

NAME = 'the simulated force/torque sensor'
USUAL_RATE_HZ = 1000.0
NOISE = (0.005, 0.005, 0.005, 0.0001, 0.0001, 0.0001)  # N and N·m
NOISE_BLOCK = 500
UNTOUCHED: Wrench = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class WrenchSource(Protocol):
    """The true wrench."""

    def wrench_at(self, time_ns: int) -> Wrench:
        """(Fx, Fy, Fz, Tx, Ty, Tz) in N and N·m in the sensor's axes."""
        ...


class SimulatedForceTorque(ForceTorqueSensor):
    """Takes all samples that are due when it is read, so it needs no thread and follows a stepped clock.

    Args:
        settings: `rate_hz` (0: 1000) and `queue` are used.
        clock: stamps the samples.
        world: what it measures; no contact if omitted.
    """

    def __init__(self, settings: ForceTorqueSettings, clock: Clock, world: WrenchSource | None = None) -> None:
        self._settings = settings
        self._clock = clock
        self._world = world
        self._random = np.random.default_rng(1)
        self._noise: list[list[float]] = []
        self._rate_hz = settings.rate_hz or USUAL_RATE_HZ
        self._queue = self._new_queue()
        self._listeners: list[Listener] = []
        self._start_ns = 0
        self._taken = 0
        self._is_open = False

    @property
    def description(self) -> Mapping[str, str]:
        return {'source': self._settings.source, 'kind': 'simulated', 'rate': f'{self._rate_hz:g}'}

    @property
    def health(self) -> Health:
        if not self._is_open:
            return Health(Level.STALE, f'{NAME} is not open')
        return Health(Level.OK, f'{self._rate_hz:g} samples/s, {self._queue.dropped} lost')

    @property
    def axes(self) -> tuple[str, ...]:
        return AXES

    @property
    def rate_hz(self) -> float:
        return self._rate_hz if self._is_open else 0.0

    @property
    def expected_hz(self) -> float:
        return self._rate_hz

    def open(self) -> None:
        """Start; the first sample is due at once."""
        self._queue = self._new_queue()
        for listener in self._listeners:
            self._queue.listen(listener)
        self._start_ns, self._taken = self._clock.now_ns(), 0
        self._is_open = True

    def read(self, timeout_s: float) -> Sequence[Sample]:
        """All samples that have become due since the last call; waits for one."""
        if not self._is_open:
            raise closed(NAME)
        deadline_ns = self._clock.now_ns() + round(timeout_s * NS_PER_S)
        self._measure()
        if not self._queue.wait(0.0):
            self._clock.sleep_until(min(self._due_ns(), deadline_ns))
            self._measure()
        if not self._queue.wait(0.0):
            raise DeviceTimeoutError(f'{NAME} has no sample due within {timeout_s:g} s at its rate')
        return self._queue.take(0.0)

    def newest(self) -> Sample | None:
        if self._is_open:
            self._measure()
        return self._queue.newest

    def listen(self, listener: Listener) -> None:
        self._listeners.append(listener)
        self._queue.listen(listener)

    def close(self) -> None:
        self._is_open = False

    def _new_queue(self) -> SampleQueue:
        return SampleQueue(NAME, self._settings.queue, SampleCheck(AXES, self._settings.same_values))

    def _measure(self) -> None:
        now_ns = self._clock.now_ns()
        while (due_ns := self._due_ns()) <= now_ns:
            wrench = self._felt(due_ns)
            self._queue.put(wrench, wrench, due_ns, now_ns, self._taken)
            self._taken += 1

    def _felt(self, time_ns: int) -> Wrench:
        a, b, c, d, e, f = self._world.wrench_at(time_ns) if self._world else UNTOUCHED
        if not self._noise:  # drawn in bulk, which is ten times as fast
            self._noise = self._random.normal(0.0, NOISE, (NOISE_BLOCK, len(NOISE))).tolist()
        noise = self._noise.pop()
        return a + noise[0], b + noise[1], c + noise[2], d + noise[3], e + noise[4], f + noise[5]

    def _due_ns(self) -> int:
        return self._start_ns + math.ceil(self._taken * NS_PER_S / self._rate_hz)
