"""The force/torque sensor of an emulated rig: an ATI box on the network, or a sensor on a serial line."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tactile_nodes.clock import Clock
from tactile_nodes.emulators.clocks import DeviceClock
from tactile_nodes.emulators.force_torque.net_ft import NetFtServer
from tactile_nodes.emulators.force_torque.net_ft_box import NetFtBox
from tactile_nodes.emulators.force_torque.serial_ft import PtySensor
from tactile_nodes.emulators.force_torque.serial_ft_bota import BotaSensor
from tactile_nodes.emulators.force_torque.serial_ft_sensor import SampledSensor
from tactile_nodes.emulators.force_torque.serial_ft_text import AXES, TextLineSensor
from tactile_nodes.emulators.world import WrenchSource
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.params import parameter

NOISE = (0.005, 0.0001)  # N and N m
TEXT_HZ = 200.0
COUNTS_PER_UNIT = 100_000.0


@dataclass(frozen=True)
class SensorFaults:
    """The faults of the sensor."""

    silent_sensor: bool = parameter(False, 'the sensor sends nothing')
    stalled_sensor: bool = parameter(False, 'the sensor sends, but always the last measured value')
    saturated_sensor: bool = parameter(False, 'the sensor reports that it is beyond its range')
    lose: int = parameter(0, 'number of records that are lost next', minimum=0)
    damage: int = parameter(0, 'number of records that are damaged next', minimum=0)
    loss_rate: float = parameter(0.0, 'share of records that are lost; Net F/T', minimum=0.0, maximum=1.0)
    reorder: int = parameter(0, 'number of records that each arrive after their successor; Net F/T', minimum=0)
    double: int = parameter(0, 'number of records that arrive twice next; Net F/T', minimum=0)
    unplugged_sensor: bool = parameter(False, "the sensor's serial line is pulled; not Net F/T")
    sensor_jump_s: float = parameter(0.0, "the sensor's clock jumps ahead by this")
    sensor_drift_ppm: float = parameter(0.0, "the sensor's clock runs too fast by this", minimum=-1e5, maximum=1e5)


class BoxOnTheNetwork:
    """A Net F/T box; `source` is what its driver opens."""

    def __init__(self, world: WrenchSource, clock: Clock, rdt_port: int, http_port: int) -> None:
        self._box = NetFtBox(world, noise=NOISE)
        self._server = NetFtServer(self._box, clock, rdt_port=rdt_port, http_port=http_port)
        self._had = SensorFaults()

    @property
    def source(self) -> str:
        return f'netft://127.0.0.1 (RDT {self._server.rdt_port}, HTTP {self._server.http_port})'

    def __enter__(self) -> BoxOnTheNetwork:
        self._server.__enter__()
        return self

    def __exit__(self, *args: object) -> None:
        self._server.__exit__(*args)

    def switch(self, wanted: SensorFaults, now_ns: int) -> None:
        """Set the active faults. Raises ConfigurationError for one that this sensor cannot have."""
        if wanted.unplugged_sensor:
            raise ConfigurationError('a Net F/T box has no serial line; choose sensor: bota, or make it silent')
        had, self._had, box = self._had, wanted, self._box.faults
        box.silent, box.stalled, box.saturated = wanted.silent_sensor, wanted.stalled_sensor, wanted.saturated_sensor
        box.loss_rate = wanted.loss_rate
        box.lose += _more(had.lose, wanted.lose)
        box.malformed += _more(had.damage, wanted.damage)
        box.swap += _more(had.reorder, wanted.reorder)
        box.duplicate += _more(had.double, wanted.double)
        self._box.clock = _altered(self._box.clock, had, wanted, now_ns)


class SensorOnALine:
    """A Bota sensor, or one that prints lines of text."""

    def __init__(self, kind: str, world: WrenchSource, clock: Clock, link: Path) -> None:
        self._kind = kind
        self._sensor: SampledSensor = (
            BotaSensor(world, noise=NOISE[0]) if kind == 'bota'
            else TextLineSensor(world, AXES, (COUNTS_PER_UNIT,) * 6, rate_hz=TEXT_HZ, noise=NOISE[0], settling=1)
        )  # fmt: skip
        self._port = PtySensor(self._sensor, clock, link)
        self._had = SensorFaults()

    @property
    def source(self) -> str:
        return f'{self._kind}:{self._port.path}'

    def __enter__(self) -> SensorOnALine:
        self._port.__enter__()
        return self

    def __exit__(self, *args: object) -> None:
        self._port.__exit__(*args)

    def switch(self, wanted: SensorFaults, now_ns: int) -> None:
        if wanted.reorder or wanted.double or wanted.loss_rate:
            raise ConfigurationError('a serial line keeps its order and doubles nothing; choose sensor: netft')
        had, self._had, line = self._had, wanted, self._sensor.faults
        line.silent, line.stuck, line.saturated = wanted.silent_sensor, wanted.stalled_sensor, wanted.saturated_sensor
        line.lose += _more(had.lose, wanted.lose)
        line.garble += _more(had.damage, wanted.damage)
        self._sensor.clock = _altered(self._sensor.clock, had, wanted, now_ns)
        if wanted.unplugged_sensor != had.unplugged_sensor:
            (self._port.unplug if wanted.unplugged_sensor else self._port.plug)()


RigSensor = BoxOnTheNetwork | SensorOnALine


def _more(had: int, wanted: int) -> int:
    """A changed number requests this many more; an unchanged one requests nothing."""
    return wanted if wanted != had else 0


def _altered(clock: DeviceClock, had: SensorFaults, wanted: SensorFaults, now_ns: int) -> DeviceClock:
    jump_s = wanted.sensor_jump_s - had.sensor_jump_s
    if not jump_s and wanted.sensor_drift_ppm == had.sensor_drift_ppm:
        return clock
    return clock.altered(now_ns, wanted.sensor_drift_ppm, jump_s)
