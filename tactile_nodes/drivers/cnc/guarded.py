"""Common part of all machines: rules of motion, expected position, time limits, and the retract."""

from __future__ import annotations

import math
from abc import abstractmethod

from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.drivers.cnc.contract import Cnc, CncSettings, Envelope, Place, Switched
from tactile_nodes.drivers.cnc.envelope import Guard, describe_place, way_between
from tactile_nodes.drivers.cnc.motion import Motion
from tactile_nodes.errors import ConfigurationError, DeviceError, DeviceFaultError

ARRIVED_MM = 0.02
UNKNOWN_ACCELERATION = 50.0  # mm/s²
MARGIN = 1.5


class GuardedCnc(Cnc):
    """A machine whose every move is checked first. The abstract methods talk to the machine."""

    def __init__(self, settings: CncSettings, clock: Clock, name: str) -> None:
        self._settings = settings
        self._clock = clock
        self._name = name
        self._guard: Guard | None = None
        self._homed = False
        self._target: Place | None = None
        self._motion = Motion()
        self._busy_until_ns = 0
        self._cruising_until_ns = 0
        self.deceleration_mm_s2 = UNKNOWN_ACCELERATION
        self._speeds: Place = (math.inf, math.inf, math.inf)  # largest of each axis, in mm/s

    @property
    def limits(self) -> Envelope:
        return self._rules().envelope

    @property
    def blind_step_mm(self) -> float | None:
        return None

    def feed_along(self, way: Place, feed: float) -> float:
        length = math.hypot(*way)
        limits = zip(self._speeds, way, strict=True)
        return min([feed, *(60 * most * length / abs(mm) for most, mm in limits if mm)])

    def move(self, x: float | None = None, y: float | None = None, z: float | None = None, *, feed: float) -> None:
        rules, start = self._rules(), self._known_place()
        target = (start[0] if x is None else x, start[1] if y is None else y, start[2] if z is None else z)
        rules.check(start, target, feed)
        target = rules.nearest(target)
        if self._motion.jogging:
            self.wait_idle()
        self._motion.moving = True
        self._expect(way_between(start, target), feed)
        self._motion.add(start, target, feed)
        self._send_move(target, feed)
        self._target = target

    def jog(self, dx: float = 0.0, dy: float = 0.0, dz: float = 0.0, *, feed: float) -> None:
        rules, way = self._rules(), (dx, dy, dz)
        length = math.hypot(*way)
        self._check_blind(length)
        self._require_ready(up=not (dx or dy) and dz > 0)
        if not self._homed:
            rules.check_up(way, feed)
            self._expect_jog(way, feed)
            self._send_up(dz, feed)
            return
        start = self._known_place()
        target = (start[0] + dx, start[1] + dy, start[2] + dz)
        rules.check(start, target, feed)
        target = rules.nearest(target)
        if self._motion.moving and not self._motion.jogging:
            self.wait_idle()
        self._expect_jog(way, feed)
        self._motion.add(start, target, feed)
        self._send_jog(target, feed)
        self._target = target

    def retract(self) -> None:
        rules = self._rules()
        self.stop()
        self._lift()
        self._require_ready()
        z = self._known_place()[2]
        if z < rules.safe_z_mm:
            self._go_up(rules.safe_z_mm - z, self._settings.retract_mm_min)
            self.wait_idle()

    def set_line(self, level: bool) -> Switched:
        if self._motion.moving:
            self.wait_idle()
        self._require_ready()
        return self._switch(level)

    @abstractmethod
    def _require_ready(self, up: bool = False) -> None:
        """Raise if the machine cannot obey; for a jog straight `up`, an unknown position is allowed."""

    @abstractmethod
    def _send_move(self, target: Place, feed: float) -> None: ...

    @abstractmethod
    def _send_jog(self, target: Place, feed: float) -> None: ...

    @abstractmethod
    def _send_up(self, distance: float, feed: float) -> None:
        """A jog straight up from an unknown position."""

    @abstractmethod
    def _switch(self, level: bool) -> Switched: ...

    def _lift(self) -> None:
        """Go up from an unknown position; a machine that never loses its position does nothing."""
        return

    def _go_up(self, distance: float, feed: float) -> None:
        self.jog(dz=distance, feed=feed)

    def _rules(self) -> Guard:
        if self._guard is None:
            raise DeviceError(f'{self._name} is not connected; connect it first')
        return self._guard

    def _known_place(self) -> Place:
        """Position of the tip after all requested motion."""
        self._require_ready()
        if not self._homed or self._target is None:
            raise DeviceFaultError(f'{self._name} does not know its position; home it first')
        return self._target

    def _check_blind(self, length: float) -> None:
        longest = self.blind_step_mm
        if longest is not None and length > longest + 1e-9:
            raise ConfigurationError(
                f'{self._name} cannot stop a jog of {length:g} mm in time; jog at most {longest:g} mm, '
                'then wait and check the force'
            )

    def _expect_jog(self, way: Place, feed: float) -> None:
        self._motion.moving = self._motion.jogging = True
        self._expect(way, feed)

    def _expect(self, way: Place, feed: float) -> None:
        length = math.hypot(*way)
        speed = self.feed_along(way, feed) / 60
        duration_s = length / speed + speed / self.deceleration_mm_s2
        now_ns = self._clock.now_ns()
        self._busy_until_ns = max(now_ns, self._busy_until_ns) + round(duration_s * NS_PER_S)
        self._cruising_until_ns = max(now_ns, self._cruising_until_ns) + round(length / speed * NS_PER_S)

    @property
    def _surely_moving(self) -> bool:
        """Whether the requested motion cannot be finished yet, even at its full feed from the start."""
        return self._clock.now_ns() < self._cruising_until_ns

    def _patience_s(self) -> float:
        """Time limit of a response that comes after the motion."""
        left_s = max(0, self._busy_until_ns - self._clock.now_ns()) / NS_PER_S
        return MARGIN * left_s + self._settings.answer_s

    def _arrived(self) -> None:
        """Check, after a motion, that it ended at the target.

        Raises:
            DeviceFaultError: it did not; lines were lost, or another program moves the machine.
        """
        status, target = self.status(), self._target
        self._at_rest()
        if target is None or not self._homed:
            return
        if math.dist(status.position_mm, target) <= ARRIVED_MM:
            self._motion.rest(target, self._clock.now_ns())
            return
        self._rests_at(status.position_mm)
        raise DeviceFaultError(
            f'{self._name} stopped at {describe_place(status.position_mm)} instead of {describe_place(target)}; '
            'commands were lost or another program moves it: check it, then home it'
        )

    def _rests_at(self, place: Place) -> None:
        """Note that the machine rests here, and that no motion is requested."""
        self._at_rest()
        self._target = place
        self._motion.rest(place, self._clock.now_ns())

    def _at_rest(self) -> None:
        self._motion.moving = self._motion.jogging = False
        self._busy_until_ns = self._cruising_until_ns = 0
