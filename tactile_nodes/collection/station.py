"""The devices of the rig: machine, sensor and camera images, with their threads and the safety.

Four threads: the sensor's own, which passes every sample to the safety; the guard's, which stops the machine; one that
forwards samples; and that of the run. The creator of a `Station` closes it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from tactile_nodes.clock import Clock
from tactile_nodes.collection.hands import Guard, Hands
from tactile_nodes.collection.readings import Picture, Readings, frame_of
from tactile_nodes.collection.safety import Safety
from tactile_nodes.collection.settings import CollectionSettings
from tactile_nodes.drivers.cnc.contract import SIMULATED, Cnc, CncSettings, CncStatus, Switched, Traffic
from tactile_nodes.drivers.cnc.opening import open_cnc
from tactile_nodes.drivers.force_torque.contract import ForceTorqueSensor, ForceTorqueSettings, Sample
from tactile_nodes.drivers.force_torque.opening import open_force_torque
from tactile_nodes.drivers.force_torque.simulated import SimulatedForceTorque
from tactile_nodes.emulators.world import UpsideDown, World, WorldSettings
from tactile_nodes.errors import TactileError
from tactile_nodes.simulation import worlds

WORLD = 'rig'
READ_S = 0.1
LEAVE_S = 3.5  # for the way up from 30 mm below; a launch sends the next signal after 5 s
NOT_UP_YET = (
    'the run has not ended in time, so the tip may not be up yet; if the machine still obeys, it is lifted when this '
    'process has ended'
)


class Station:
    """Open devices, monitored by a safety.

    Args:
        settings: limits and motion.
        cnc: the machine.
        force_torque: the sensor.
        world: the simulated world; shared under the name ``rig``.
        clock: the host's.
        on_sample: gets every sample, in a thread of its own.
        on_status: gets the position of the machine, in the thread of the run.
        on_switch: gets each change of the digital line, likewise.
        traffic: gets every byte to and from the machine, at once, in any thread: must be quick.

    Raises:
        ConfigurationError, DeviceError: a device that cannot be opened.
    """

    def __init__(
        self,
        settings: CollectionSettings,
        cnc: CncSettings,
        force_torque: ForceTorqueSettings,
        world: WorldSettings,
        clock: Clock,
        on_sample: Callable[[Sample], None],
        on_status: Callable[[CncStatus], None],
        on_switch: Callable[[Switched], None],
        traffic: Traffic | None = None,
    ) -> None:
        self._on_sample = on_sample
        self._clock = clock
        self._closing = threading.Event()
        self.readings = Readings()
        self.world = World(world) if SIMULATED in {cnc.source, force_torque.source} else None
        if self.world is not None:
            worlds.share(WORLD, self.world)
        self.cnc: Cnc = open_cnc(cnc, clock, machine=self.world, traffic=traffic)
        self.guard = Guard(self.cnc, clock, lambda: self.hands.homing)
        try:
            self.sensor = self._sensor(force_torque, settings)
        except BaseException:
            self.cnc.close()
            raise
        self.safety = Safety(settings.watched, lambda _: self.guard.stop(), self.sensor.expected_hz)
        self.sensor.listen(self.safety.sample)
        self.sensor.listen(self.readings.put_sample)
        stopped = self.guard.stopped.wait
        self.hands = Hands(self.cnc, clock, self.safety, self.readings, settings.motion, on_status, on_switch, stopped)
        self.guard.start(self.safety)
        self._pump = threading.Thread(target=self._pass_on, name='force samples', daemon=True)
        self._pump.start()

    def image(self, stamp_ns: int, image: Picture) -> None:
        """Add an image. Raises ImageError."""
        self.safety.frame(self._clock.now_ns())
        self.readings.put_frame(frame_of(stamp_ns, image))

    def stop(self) -> None:
        """Ask the run to end, with the tip up; returns at once. Homing is stopped here: a run cannot."""
        self.hands.asked_to_stop = True
        if self.hands.homing:
            self.guard.stop()

    def close_after(self, run: threading.Thread | None, within_s: float) -> bool:
        """Close after the run has ended; returns whether it ended in time.

        If it did not, its tip may be down, and nothing is closed: the run continues on its way up, monitored. If its
        process ends before, the watchdog of the machine (`tactile_nodes.drivers.cnc.dead_man`) lifts the tip.
        """
        if run is not None:
            run.join(within_s)
            if run.is_alive():
                return False
        self.close()
        return True

    def close(self) -> None:
        """Close the devices; the machine's motors stay on."""
        self._closing.set()
        self.guard.close()
        self._pump.join(5 * READ_S)
        self.sensor.close()
        self.cnc.close()

    def _sensor(self, sensor_settings: ForceTorqueSettings, settings: CollectionSettings) -> ForceTorqueSensor:
        if sensor_settings.source != SIMULATED or self.world is None:
            return open_force_torque(sensor_settings, self._clock)
        mounted = UpsideDown(self.world) if settings.mounting.upside_down else self.world
        sensor = SimulatedForceTorque(sensor_settings, self._clock, mounted)
        sensor.open()
        return sensor

    def _pass_on(self) -> None:
        while not self._closing.is_set():
            try:
                samples = self.sensor.read(READ_S)
            except TactileError:  # the safety notices the silence, the sensor's health reports it
                self._clock.sleep_until(self._clock.now_ns() + round(READ_S * 1e8))
                continue
            try:
                for sample in samples:
                    self._on_sample(sample)
            except TactileError:
                if not self._closing.is_set():
                    raise
                return  # closed meanwhile, as was the receiver of the samples
