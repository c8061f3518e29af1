"""The simulated machine: it moves a simulated world directly, without a wire protocol.

It waits with the given clock; with a clock that skips sleeping, a whole plan takes no time. The machine is anything
with `Machine`'s methods, like the emulators' `World`, so that drivers need not import the emulators.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from tactile_nodes.clock import Clock
from tactile_nodes.drivers.cnc.contract import CncSettings, CncState, CncStatus, Envelope, Place, Switched
from tactile_nodes.drivers.cnc.envelope import guard
from tactile_nodes.drivers.cnc.guarded import GuardedCnc
from tactile_nodes.drivers.health import Health, Level
from tactile_nodes.errors import DeviceError, DeviceFaultError

SLICE_NS = 20_000_000  # latency of a stop by another thread
DECELERATION = 200.0
HOMING_MM_S = 25.0
PULL_OFF_MM = 1.0


class Machine(Protocol):
    """The simulated machine; the origin of its coordinates is at the upper end switches."""

    @property
    def room_mm(self) -> Place:
        """The travel from the lower to the upper end switch of each axis."""
        ...

    def go(self, target: Place, feed_mm_s: float, time_ns: int) -> int:
        """Go on to a place after all earlier ones; returns the time of arrival."""
        ...

    def brake(self, time_ns: int, deceleration: float | None = None) -> int:
        """Come to rest and drop all later motion; returns the time of rest."""
        ...

    def motor_at(self, time_ns: int) -> Place:
        """The position of the motors."""
        ...

    def set_line(self, level: bool, time_ns: int) -> None:
        """Switch the digital line."""
        ...


class SimulatedCnc(GuardedCnc):
    """A machine that follows every command exactly."""

    def __init__(self, settings: CncSettings, clock: Clock, machine: Machine) -> None:
        super().__init__(settings, clock, 'the simulated CNC')
        self._machine = machine
        self.deceleration_mm_s2 = DECELERATION
        self._origin: Place = (0.0, 0.0, 0.0)
        self._arrival_ns = 0
        self._stops = 0
        self._sent: Place | None = None  # the last target since it came to rest

    @property
    def description(self) -> Mapping[str, str]:
        return {'source': self._settings.source, 'kind': 'simulated CNC'}

    @property
    def health(self) -> Health:
        """OK once it is homed."""
        if self._guard is None:
            return Health(Level.STALE, f'{self._name} is not connected')
        state = self._state().value
        return Health(Level.OK, state) if self._homed else Health(Level.WARN, f'{state}, not homed')

    def connect(self) -> None:
        """As `Cnc.connect`; its position is its origin until it is homed."""
        room = self._machine.room_mm
        self._guard = guard(self._settings, Envelope((-room[0], -room[1], -room[2]), (0.0, 0.0, 0.0)))
        self._origin = self._machine.motor_at(self._clock.now_ns())
        self._homed = False

    def home(self) -> None:
        """As `Cnc.home`: up, then to the upper ends, then off the switches."""
        self._rules()
        self._sent, self._homed = None, False
        start = self._machine.motor_at(self._clock.now_ns())
        off = -PULL_OFF_MM
        for target in ((start[0], start[1], 0.0), (0.0, 0.0, 0.0), (off, off, off)):
            self._arrival_ns = self._machine.go(target, HOMING_MM_S, self._clock.now_ns())
        self._wait_until_arrived()
        self._origin, self._target, self._homed = (0.0, 0.0, 0.0), (off, off, off), True
        self._at_rest()

    def stop(self) -> None:
        self._rules()
        self._stops += 1
        self._sent = None
        self._arrival_ns = self._machine.brake(self._clock.now_ns(), DECELERATION)
        self._clock.sleep_until(self._arrival_ns)
        self._at_rest()
        self._target = self._place() if self._homed else None

    def wait_idle(self) -> None:
        self._require_ready()
        self._wait_until_arrived()
        self._arrived()

    def status(self) -> CncStatus:
        self._rules()
        return CncStatus(self._state(), self._place(), self._homed, self._clock.now_ns(), 0)

    def close(self) -> None:
        self._guard = None
        self._homed = False

    def _wait_until_arrived(self) -> None:
        stops = self._stops
        while (now_ns := self._clock.now_ns()) < self._arrival_ns and stops == self._stops:
            self._clock.sleep_until(min(self._arrival_ns, now_ns + SLICE_NS))
        if stops != self._stops:
            raise DeviceFaultError(f'{self._name}: the motion was aborted by a stop')

    def _state(self) -> CncState:
        if self._clock.now_ns() >= self._arrival_ns:
            return CncState.IDLE
        return CncState.JOG if self._motion.jogging else CncState.RUN

    def _place(self) -> Place:
        motor, origin = self._machine.motor_at(self._clock.now_ns()), self._origin
        return (motor[0] - origin[0], motor[1] - origin[1], motor[2] - origin[2])

    def _require_ready(self, up: bool = False) -> None:  # noqa: ARG002
        if self._guard is None:
            raise DeviceError(f'{self._name} is not connected; connect it first')

    def _send_move(self, target: Place, feed: float) -> None:
        self._go((target[0] + self._origin[0], target[1] + self._origin[1], target[2] + self._origin[2]), feed)

    def _send_jog(self, target: Place, feed: float) -> None:
        self._send_move(target, feed)

    def _send_up(self, distance: float, feed: float) -> None:
        x, y, z = self._sent or self._machine.motor_at(self._clock.now_ns())
        self._go((x, y, z + distance), feed)

    def _go(self, target: Place, feed: float) -> None:
        self._arrival_ns = self._machine.go(target, feed / 60, self._clock.now_ns())
        self._sent = target

    def _switch(self, level: bool) -> Switched:
        now_ns = self._clock.now_ns()
        self._machine.set_line(level, now_ns)
        return Switched(level, now_ns, now_ns)
