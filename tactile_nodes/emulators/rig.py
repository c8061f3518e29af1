"""A complete emulated rig: controller, force/torque sensor and camera in one world, with faults to switch on."""

from __future__ import annotations

import errno
import json
import threading
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from tactile_nodes import paths
from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.emulators.camera_stream import CameraStream
from tactile_nodes.emulators.cnc.grbl import Grbl
from tactile_nodes.emulators.cnc.grbl_dialect import GrblSettings
from tactile_nodes.emulators.rig_sensor import BoxOnTheNetwork, RigSensor, SensorFaults, SensorOnALine
from tactile_nodes.emulators.serial_ports import PtyPort
from tactile_nodes.emulators.world import UpsideDown, World, WorldSettings
from tactile_nodes.errors import AddressInUseError, ConfigurationError
from tactile_nodes.params import parameter

PERIOD_S = 0.01


class RigTrace:
    """Records the true tip position, which only the world knows, while it is open; without a file it writes nothing.

    JSON lines: ``{"at": ns, "tip": [x, y, z], "force": N}`` in machine coordinates (mm), and ``{"at": ns, "faults":
    {name: value}}`` when faults are switched.
    """

    def __init__(self, world: World, clock: Clock, file: str) -> None:
        self._world = world
        self._clock = clock
        self._file = Path(file).open('a', encoding='ascii') if file else None  # noqa: SIM115  (closed at the exit)
        self._lock = threading.Lock()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._write_down, name='rig trace', daemon=True)

    def __enter__(self) -> RigTrace:
        if self._file is not None:
            self._thread.start()
        return self

    def __exit__(self, *args: object) -> None:
        self._ending.set()
        if self._file is not None:
            self._thread.join()
            self._file.close()

    def switched(self, had: Any, wanted: Any) -> None:
        before, after = vars(had), vars(wanted)
        if changed := {name: value for name, value in after.items() if value != before[name]}:
            self._say({'at': self._clock.now_ns(), 'faults': changed})

    def _write_down(self) -> None:
        while not self._ending.wait(PERIOD_S):
            now_ns = self._clock.now_ns()
            tip = [round(value, 4) for value in self._world.tip_at(now_ns)]
            self._say({'at': now_ns, 'tip': tip, 'force': round(self._world.force_at(now_ns), 4)})

    def _say(self, values: dict[str, Any]) -> None:
        if self._file is not None:
            with self._lock:
                self._file.write(json.dumps(values) + '\n')
                self._file.flush()


LOOK_S = 0.01


@dataclass(frozen=True)
class RigFaults(SensorFaults):
    """The active faults."""

    READ_ONLY: ClassVar[bool] = False

    silent_camera: bool = parameter(False, 'the camera sends nothing')
    lose_frames: int = parameter(0, 'number of pictures that are lost next', minimum=0)
    frame_loss_rate: float = parameter(0.0, 'share of pictures that are lost', minimum=0.0, maximum=1.0)
    camera_delay_s: float = parameter(0.0, 'additional delay of pictures', minimum=0.0)
    hung_machine: bool = parameter(False, 'the controller neither moves nor answers')
    machine_delay_s: float = parameter(0.0, 'delay of everything the controller sends', minimum=0.0)
    alarm: int = parameter(0, 'raise an alarm of this number; 0: none', minimum=0, maximum=10)
    unplugged: bool = parameter(False, "the controller's serial line is pulled")
    stuck_axis: str = parameter('', 'axis that does not follow its motor', choices=('', 'x', 'y', 'z'))


@dataclass(frozen=True)
class EmulatedRigSettings:
    """The parts of the rig."""

    READ_ONLY: ClassVar[bool] = True

    cnc_port: str = parameter('', 'link to the serial port; empty: emulated_cnc in the run folder')
    sensor: str = parameter(
        'netft', 'the force/torque sensor: on the network, or on a serial line', choices=('netft', 'bota', 'text')
    )
    sensor_port: str = parameter('', "link to the sensor's serial port; empty: emulated_ft beside cnc")
    rdt_port: int = parameter(49153, 'UDP port of the Net F/T box', minimum=0, maximum=65535)
    http_port: int = parameter(49180, 'TCP port of its web pages', minimum=0, maximum=65535)
    camera_port: int = parameter(49190, 'TCP port of the camera stream', minimum=0, maximum=65535)
    fps: float = parameter(30.0, 'pictures a second', minimum=1.0)
    trace: str = parameter('', 'file for the true position of the tip, and for each fault; empty: none')
    world: WorldSettings = field(default_factory=WorldSettings)
    grbl: GrblSettings = field(default_factory=GrblSettings)
    faults: RigFaults = field(default_factory=RigFaults)


class EmulatedRig:
    """The devices, open until `close`.

    Raises:
        AddressInUseError: a port is in use.
        ConfigurationError: a file cannot be used.
    """

    def __init__(self, settings: EmulatedRigSettings, clock: Clock) -> None:
        self._clock = clock
        self.world = World(settings.world)
        self._grbl = Grbl(self.world, clock, settings.grbl)
        self._opened = ExitStack()
        try:
            link = _link(settings.cnc_port, paths.run_directory() / 'emulated_cnc')
            # First what a second rig cannot have, so that it does not replace the links of the first.
            self.camera = self._opened.enter_context(
                CameraStream(self.world, clock, settings.fps, settings.camera_port)
            )
            self.sensor = _sensor(settings, self.world, clock, link)
            self._opened.enter_context(self.sensor)
            self._port = self._opened.enter_context(PtyPort(self._grbl, clock, link))
            self._trace = self._opened.enter_context(RigTrace(self.world, clock, settings.trace))
        except OSError as error:
            self._opened.close()
            if file := error.filename2 or error.filename:
                raise ConfigurationError(f'cannot use {file} ({error.strerror}); choose another path') from error
            raise AddressInUseError(
                f'cannot listen at UDP {settings.rdt_port}, TCP {settings.http_port} and {settings.camera_port}: '
                f'{error.strerror}; is another emulated rig running?'
            ) from error
        self.faults = RigFaults()

    @property
    def places(self) -> str:
        camera = f'http://127.0.0.1:{self.camera.port}/'
        return f'machine at {self._port.path}, force/torque at {self.sensor.source}, camera at {camera}'

    def switch(self, wanted: RigFaults) -> None:
        """Set the active faults.

        Raises:
            ConfigurationError: a fault that this rig cannot have.
        """
        self.sensor.switch(wanted, self._clock.now_ns())
        had, self.faults = self.faults, wanted
        self._trace.switched(had, wanted)
        self._switch_camera(had, wanted)
        self._switch_machine(had, wanted)

    def rest(self, patience_s: float) -> bool:
        """Wait until the machine stands still and no program has its port open; false if that takes too long."""
        deadline_ns = self._clock.now_ns() + round(patience_s * NS_PER_S)
        while (now_ns := self._clock.now_ns()) < deadline_ns:
            if not self._port.in_use and not self.world.motor_speed_at(now_ns):
                return True
            self._clock.sleep_until(now_ns + round(LOOK_S * NS_PER_S))
        return False

    def close(self) -> None:
        self._opened.close()

    def _switch_camera(self, had: RigFaults, wanted: RigFaults) -> None:
        camera = self.camera
        camera.silent, camera.delay_s = wanted.silent_camera, wanted.camera_delay_s
        camera.loss_rate = wanted.frame_loss_rate
        camera.lose += wanted.lose_frames if wanted.lose_frames != had.lose_frames else 0

    def _switch_machine(self, had: RigFaults, wanted: RigFaults) -> None:
        self._grbl.faults.hung, self._grbl.faults.delay_s = wanted.hung_machine, wanted.machine_delay_s
        if wanted.alarm and wanted.alarm != had.alarm:
            self._grbl.alarm(wanted.alarm)
        if wanted.stuck_axis != had.stuck_axis:
            for axis, stuck in ((had.stuck_axis, False), (wanted.stuck_axis, True)):
                if axis:
                    self.world.stick('xyz'.index(axis), self._clock.now_ns(), stuck)
        if wanted.unplugged != had.unplugged:
            (self._port.unplug if wanted.unplugged else self._port.plug)()


def _sensor(settings: EmulatedRigSettings, world: World, clock: Clock, cnc_link: Path) -> RigSensor:
    mounted = UpsideDown(world)
    if settings.sensor == 'netft':
        return BoxOnTheNetwork(mounted, clock, settings.rdt_port, settings.http_port)
    return SensorOnALine(settings.sensor, mounted, clock, _link(settings.sensor_port, cnc_link.parent / 'emulated_ft'))


def _link(wanted: str, otherwise: Path) -> Path:
    link = Path(wanted) if wanted else otherwise
    link.parent.mkdir(parents=True, exist_ok=True)
    if link.exists() and not link.is_symlink():
        raise FileExistsError(errno.EEXIST, 'it is no link to a port', str(link))
    return link
