"""Force/torque sensors for the tests: a world to feel, and each kind of sensor on its emulator."""

from __future__ import annotations

import contextlib
import itertools
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from jumping_clock import AheadClock

from tactile_nodes.clock import SystemClock
from tactile_nodes.drivers.force_torque.contract import (
    ForceTorqueSensor,
    ForceTorqueSettings,
    NetFtSettings,
    Sample,
    TextLineSettings,
)
from tactile_nodes.drivers.force_torque.opening import open_force_torque
from tactile_nodes.drivers.force_torque.simulated import SimulatedForceTorque
from tactile_nodes.drivers.health import Health, Level
from tactile_nodes.emulators.clocks import DeviceClock
from tactile_nodes.emulators.force_torque.net_ft import NetFtServer
from tactile_nodes.emulators.force_torque.net_ft_box import NetFtBox
from tactile_nodes.emulators.force_torque.net_ft_config import NetFtConfig
from tactile_nodes.emulators.force_torque.serial_ft import PtySensor
from tactile_nodes.emulators.force_torque.serial_ft_bota import BotaSensor
from tactile_nodes.emulators.force_torque.serial_ft_sensor import microsecond_clock
from tactile_nodes.emulators.force_torque.serial_ft_text import TextLineSensor
from tactile_nodes.errors import DeviceLostError, DeviceTimeoutError, TactileError

LOAD = (0.5, -1.0, 2.0, 0.01, -0.02, 0.03)
NEAR_WRAP = 2**32 - 3000
LOST_S = 60.0
"""A sensor counts as lost after this silence, which passes when a test says so, and not on a busy machine."""


class Load:
    """A world that presses with one wrench."""

    def __init__(self, wrench: tuple[float, ...] = LOAD) -> None:
        self.wrench = wrench

    def wrench_at(self, time_ns: int) -> tuple[float, ...]:
        return self.wrench


def nothing() -> None:
    """For sensors that cannot do it."""


@dataclass
class Rig:
    """A sensor that can be opened, and what can be done to the thing that it is connected to.

    `faults` are the emulator's; `take_away` and `bring_back` unplug it and plug it in. `clock` is the driver's.
    """

    settings: ForceTorqueSettings
    world: Load
    make: Callable[[ForceTorqueSettings], ForceTorqueSensor]
    clock: AheadClock
    faults: Any = None
    device: Any = None
    take_away: Callable[[], None] = nothing
    bring_back: Callable[[], None] = nothing
    opened: list[ForceTorqueSensor] = field(default_factory=list)

    def open(self, **changes: object) -> ForceTorqueSensor:
        sensor = self.make(replace(self.settings, **changes))
        self.opened.append(sensor)
        return sensor


@contextlib.contextmanager
def simulated_rig(folder: Path) -> Iterator[Rig]:
    world, ahead = Load(), AheadClock()

    def make(settings: ForceTorqueSettings) -> ForceTorqueSensor:
        sensor = SimulatedForceTorque(settings, ahead, world)
        sensor.open()
        return sensor

    yield Rig(ForceTorqueSettings(rate_hz=500.0), world, make, ahead)


@contextlib.contextmanager
def net_ft_rig(folder: Path, config: NetFtConfig | None = None, **net_ft: object) -> Iterator[Rig]:
    """500 records a second; the box's counter wraps after half a second."""
    clock, world = SystemClock(), Load()
    ticks = DeviceClock(7000, clock.now_ns(), NEAR_WRAP, drift_ppm=100)
    box = NetFtBox(world, config or NetFtConfig(divider=14), ticks, noise=(0.002, 0.0001))
    with NetFtServer(box, clock) as server:
        more = {'start_tries': 200, **net_ft}  # the emulated box may have to wait for a processor
        ports = NetFtSettings(rdt_port=server.rdt_port, http_port=server.http_port, **more)
        settings = ForceTorqueSettings('netft://127.0.0.1', net_ft=ports, lost_s=LOST_S)

        def take_away() -> None:
            box.faults.silent = True

        def bring_back() -> None:
            box.faults.silent = False

        yield emulated(settings, world, box.faults, server, take_away, bring_back)


@contextlib.contextmanager
def bota_rig(folder: Path) -> Iterator[Rig]:
    clock, world = SystemClock(), Load()
    talker = BotaSensor(world, microsecond_clock(clock.now_ns(), NEAR_WRAP, 100))
    with PtySensor(talker, clock, folder / 'ttyBota') as device:
        settings = ForceTorqueSettings(f'bota:{device.path}', rate_hz=200.0, lost_s=LOST_S)
        yield emulated(settings, world, talker.faults, device, device.unplug, device.plug)


@contextlib.contextmanager
def text_rig(folder: Path, rate_hz: float = 200.0) -> Iterator[Rig]:
    """A load cell for Fz on a converter; faster than an HX711, so that the tests are."""
    clock, world = SystemClock(), Load()
    talker = TextLineSensor(world, clock=microsecond_clock(clock.now_ns(), NEAR_WRAP, 100), rate_hz=rate_hz)
    with PtySensor(talker, clock, folder / 'ttyText') as device:
        text = TextLineSettings(units_per_count=(1e-5,))
        settings = ForceTorqueSettings(f'text:{device.path}', text=text, lost_s=LOST_S)
        yield emulated(settings, world, talker.faults, device, device.unplug, device.plug)


def emulated(settings: ForceTorqueSettings, world: Load, *more: Any) -> Rig:
    ahead = AheadClock()
    return Rig(settings, world, lambda changed: open_force_torque(changed, ahead), ahead, *more)


RIGS = {'simulated': simulated_rig, 'net_ft': net_ft_rig, 'bota': bota_rig, 'text': text_rig}


@contextlib.contextmanager
def rig_of(kind: str, folder: Path) -> Iterator[Rig]:
    """The rig, whose sensors are closed afterwards."""
    with RIGS[kind](folder) as rig:
        try:
            yield rig
        finally:
            for sensor in rig.opened:
                sensor.close()


def read(sensor: ForceTorqueSensor, count: int = 40) -> list[Sample]:
    """At least so many samples."""
    samples: list[Sample] = []
    while len(samples) < count:
        samples += sensor.read(30.0)
    return samples


def lose(rig: Rig, sensor: ForceTorqueSensor, last: Sample) -> Sample:
    """Let time pass until a sensor that is silent counts as lost; its last sample, if there is none `last`."""
    while True:
        rig.clock.advance(1.1 * LOST_S)
        try:
            last = sensor.read(0.2)[-1]
        except DeviceTimeoutError:
            continue
        except DeviceLostError:
            return last


def working(sensor: ForceTorqueSensor, level: Level = Level.OK) -> Health:
    """Its health, once it has this level: on a busy machine samples may be late, or old, for a moment."""
    found: list[Health] = []

    def is_at_level(_: Sample) -> bool:
        found.append(sensor.health)
        return found[-1].level == level

    read_until(sensor, is_at_level)
    return found[-1]


def read_until(sensor: ForceTorqueSensor, condition: Callable[[Sample], bool], within_s: float = 60.0) -> Sample:
    """The first sample that fulfils a condition; errors on the way are what a lost sensor gives."""
    deadline = time.monotonic() + within_s
    while time.monotonic() < deadline:
        try:
            for sample in sensor.read(0.05):
                if condition(sample):
                    return sample
        except TactileError:
            time.sleep(0.01)
    raise AssertionError(f'no such sample within {within_s} s')


def assert_counted(samples: list[Sample]) -> None:
    for earlier, later in itertools.pairwise(samples):
        assert later.sequence - earlier.sequence - 1 == later.dropped - earlier.dropped >= 0
