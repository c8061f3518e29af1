"""A run in simulated time: emulated devices in one world, and a clock that skips waiting times.

Campaign, hands, safety and procedures are those of a real machine. Hours take seconds, and every run is the same. There
are no threads: whenever the clock moves, the sensor is read, pictures are taken, and the safety makes its checks.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable
from functools import partial

import numpy as np

from tactile_nodes.clock import NS_PER_S
from tactile_nodes.collection.hands import Hands
from tactile_nodes.collection.readings import Frame, Picture, Readings
from tactile_nodes.collection.safety import Safety, Trip
from tactile_nodes.collection.settings import CollectionSettings
from tactile_nodes.drivers.cnc.contract import Cnc, CncSettings, CncStatus, Switched
from tactile_nodes.drivers.cnc.opening import open_cnc
from tactile_nodes.drivers.force_torque.contract import ForceTorqueSensor, ForceTorqueSettings
from tactile_nodes.drivers.force_torque.simulated import SimulatedForceTorque
from tactile_nodes.emulators.world import World

TICK_S = 0.01
Camera = Callable[[int], Picture]


class JumpingClock:
    """A clock that moves only when a caller sleeps, and then at once; periodic work in between is done."""

    def __init__(self, start_ns: int = NS_PER_S) -> None:
        self._now_ns = start_ns
        self._order = itertools.count()
        self._due: list[tuple[int, int, int, Callable[[], None]]] = []

    def now_ns(self) -> int:
        """The present time."""
        return self._now_ns

    def sleep_until(self, deadline_ns: int) -> None:
        """Jump to `deadline_ns`, and do all work that is due before."""
        while self._due and self._due[0][0] <= deadline_ns:
            due_ns, _, period_ns, act = heapq.heappop(self._due)
            heapq.heappush(self._due, (due_ns + period_ns, next(self._order), period_ns, act))
            self._now_ns = max(self._now_ns, due_ns)
            act()
        self._now_ns = max(self._now_ns, deadline_ns)

    def every(self, period_s: float, act: Callable[[], None]) -> None:
        """Do something periodically."""
        period_ns = round(period_s * NS_PER_S)
        heapq.heappush(self._due, (self._now_ns + period_ns, next(self._order), period_ns, act))


class Rehearsal:
    """The devices of a run in simulated time. `silent_sensor` and `silent_camera` switch on faults.

    Args:
        world: the simulated world.
        settings: settings of the collection.
        cnc: settings of the machine.
        camera: gives the image at a time, called only when the image is used; None: a small image whose grey level
            depends on the depth.
        rate_hz: rate of the force samples; fps: that of the images.
        start_ns: start time.
        on_status: called with the state of the machine; on_switch: called when the digital line switches.
        tick_s: time between two looks for silent devices.
    """

    def __init__(
        self,
        world: World,
        settings: CollectionSettings,
        cnc: CncSettings,
        camera: Camera | None = None,
        rate_hz: float = 200.0,
        fps: float = 30.0,
        start_ns: int = NS_PER_S,
        on_status: Callable[[CncStatus], None] | None = None,
        on_switch: Callable[[Switched], None] | None = None,
        tick_s: float = TICK_S,
    ) -> None:
        self.world = world
        self.clock = JumpingClock(start_ns)
        self.readings = Readings()
        self.silent_sensor = self.silent_camera = False
        self._tripped: Trip | None = None
        self._camera = camera or self._small_picture
        self.cnc: Cnc = open_cnc(cnc, self.clock, machine=world)
        self.safety = Safety(settings.watched, self._stop, rate_hz)
        self.sensor: ForceTorqueSensor = SimulatedForceTorque(ForceTorqueSettings(rate_hz=rate_hz), self.clock, world)
        self.sensor.listen(self.safety.sample)
        self.sensor.listen(self.readings.put_sample)
        self.sensor.open()
        motion = settings.motion
        self.hands = Hands(
            self.cnc, self.clock, self.safety, self.readings, motion, on_status, on_switch, self._stopped
        )
        self.clock.every(1 / rate_hz, self._feel)
        self.clock.every(1 / fps, self._take_picture)
        self.clock.every(tick_s, self._look_around)

    def _feel(self) -> None:
        if not self.silent_sensor:
            self.sensor.newest()
        self._obey()

    def _take_picture(self) -> None:
        if not self.silent_camera:
            now_ns = self.clock.now_ns()
            self.safety.frame(now_ns)
            self.readings.put_frame(Frame(now_ns, partial(self._camera, now_ns)))

    def _small_picture(self, time_ns: int) -> Picture:
        depth_mm = max(0.0, self.world.press_at(time_ns).depth_mm)
        return np.full((32, 32), round(100 + 50 * min(depth_mm, 3.0)), np.uint8)

    def _stop(self, trip: Trip) -> None:
        self._tripped = trip

    def _stopped(self, _: float) -> bool:
        self._obey()
        return True

    def _look_around(self) -> None:
        self.safety.tick(self.clock.now_ns(), self.cnc.health)
        self._obey()

    def _obey(self) -> None:
        """Stop after a trip, but not during a sample: a stop takes time, in which further samples come."""
        if self._tripped is not None:
            self._tripped = None
            self.cnc.stop()
