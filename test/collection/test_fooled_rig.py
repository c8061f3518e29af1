"""A rig whose sensor lies in mid-press: the project's drivers, on emulated sensors, with liars in between.

The tip goes down at 1 mm/s; the lie begins at 0.3 mm depth, 2.0 mm are commanded.
"""

from __future__ import annotations

import contextlib
import math
import random
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from benchmarks.devices.liars import BotaLiar, Changed, Lie, TextLiar, UdpProxy, Values, frozen
from tactile_nodes.clock import SystemClock, monotonic_s
from tactile_nodes.collection.actions import Go, Procedure
from tactile_nodes.collection.hands import TrippedError
from tactile_nodes.collection.press.rest import zero
from tactile_nodes.collection.press.rising import rising
from tactile_nodes.collection.press.surface import HERTZ, Loading, Surface
from tactile_nodes.collection.safety import MACHINE, OVERLOAD, SENSOR, Trip
from tactile_nodes.collection.settings import CollectionSettings, LimitSettings, PressSettings
from tactile_nodes.collection.station import Station
from tactile_nodes.drivers.cnc.contract import CncSettings
from tactile_nodes.drivers.force_torque.contract import ForceTorqueSettings, NetFtSettings, TextLineSettings
from tactile_nodes.emulators.force_torque.net_ft import NetFtServer
from tactile_nodes.emulators.force_torque.net_ft_box import NetFtBox
from tactile_nodes.emulators.force_torque.net_ft_config import NetFtConfig
from tactile_nodes.emulators.force_torque.serial_ft import PtySensor
from tactile_nodes.emulators.force_torque.serial_ft_bota import BotaSensor
from tactile_nodes.emulators.force_torque.serial_ft_text import TextLineSensor
from tactile_nodes.emulators.world import NOTHING, World, WorldSettings, Wrench

WORLD = WorldSettings(start_mm=(-1.0, -1.0, -1.0), gel_x_mm=-1.0, gel_y_mm=-1.0, gel_z_mm=-2.0)  # where it homes
SURFACE_MM, BEGINS_MM, COMMANDED_MM = -2.0, 0.3, 2.0
GEL = Surface(SURFACE_MM, softest=Loading(SURFACE_MM, 0.577, HERTZ))  # as the surface of the paper's gel is felt
NOISE = (0.005, 0.0001)
SILENCE_MS = 5000.0  # granted, since a computer with other work makes silence of itself, which stops the tip as well
MS = 1e-3
Liar = Callable[['Bench', Changed | None], contextlib.AbstractContextManager[ForceTorqueSettings]]


class Bench:
    """The world that the station makes, felt by an emulated sensor that was there before it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.clock = SystemClock()
        self.world: World | None = None
        self.descending = False

    def wrench_at(self, time_ns: int) -> Wrench:
        return NOTHING if self.world is None else self.world.wrench_at(time_ns)

    @property
    def depth_mm(self) -> float:
        return -1.0 if self.world is None else self.world.press_at(self.clock.now_ns()).depth_mm

    def begins(self) -> bool:
        return self.descending and self.depth_mm > BEGINS_MM


@contextlib.contextmanager
def net_ft(bench: Bench, lie: Changed | None, **liar: Callable[[], float]) -> Iterator[ForceTorqueSettings]:
    box = NetFtBox(bench, NetFtConfig(divider=14), noise=NOISE)
    with NetFtServer(box, bench.clock) as server, UdpProxy(server.rdt_port, lie, now_s=monotonic_s, **liar) as proxy:
        ports = NetFtSettings(rdt_port=proxy.port, http_port=server.http_port)
        yield ForceTorqueSettings('netft://127.0.0.1', net_ft=ports)


@contextlib.contextmanager
def bota(bench: Bench, lie: Changed | None) -> Iterator[ForceTorqueSettings]:
    assert lie is not None
    with PtySensor(BotaLiar(BotaSensor(bench), lie), bench.clock, bench.folder / 'bota') as device:
        yield ForceTorqueSettings(f'bota:{device.path}', rate_hz=200.0)


@contextlib.contextmanager
def text(bench: Bench, lie: Changed | None) -> Iterator[ForceTorqueSettings]:
    """A load cell for Fz."""
    assert lie is not None
    talker = TextLineSensor(bench, rate_hz=200.0)
    with PtySensor(TextLiar(talker, lie), bench.clock, bench.folder / 'text') as device:
        yield ForceTorqueSettings(f'text:{device.path}', text=TextLineSettings(units_per_count=(1e-5,)))


def descent(bench: Bench) -> Procedure[None]:
    tare = yield from zero(CollectionSettings(press=PressSettings(tare_s=0.2)))
    bench.descending = True
    expect = rising(GEL, tare, CollectionSettings(), 0.0, 0.0)
    yield Go(z=SURFACE_MM - COMMANDED_MM, feed_mm_min=60.0, expect=expect)


def pressed(bench: Bench, settings: ForceTorqueSettings, silence_ms: float = SILENCE_MS) -> tuple[Trip | None, float]:
    """What stopped the tip, and how deep it was in the end."""
    limits = LimitSettings(force_silence_ms=silence_ms)

    def nothing(_: object) -> None:
        """Nobody is informed."""

    station = Station(
        CollectionSettings(limits=limits), CncSettings(safe_z_mm=-1.5), settings, WORLD, bench.clock,
        nothing, nothing, nothing,
    )  # fmt: skip
    bench.world = station.world
    with contextlib.closing(station):
        hands = station.hands
        hands.home()
        while station.sensor.newest().flags:  # the emulated sensor had to wait for a processor: its clock is unknown
            time.sleep(0.01)
        hands.safety.watch(bench.clock.now_ns(), camera=False)
        try:
            hands.run(approached())
            hands.run(descent(bench))
        except TrippedError as tripped:
            station.guard.stopped.wait(60.0)
            return tripped.trip, bench.depth_mm
        return None, bench.depth_mm


def must_stop(
    bench: Bench,
    settings: ForceTorqueSettings,
    kind: str,
    reason: str,
    within_mm: float,
    silence_ms: float = SILENCE_MS,
) -> None:
    trip, depth_mm = pressed(bench, settings, silence_ms)
    assert trip is not None
    assert (trip.kind, reason in trip.reason) == (kind, True), trip
    assert depth_mm < within_mm


def approached() -> Procedure[None]:
    yield Go(z=SURFACE_MM + 0.1, feed_mm_min=300.0)


def one_axis_is_no_number(last: Values) -> Values:
    return (*last[:-1], math.nan)


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


def test_an_honest_sensor_lets_the_tip_go_all_the_way(bench: Bench) -> None:
    """The same rig and liars as in the others, which say nothing untrue."""
    with net_ft(bench, None) as settings:
        trip, depth_mm = pressed(bench, settings)
    assert trip is None
    assert depth_mm == pytest.approx(COMMANDED_MM, abs=0.01)


@pytest.mark.parametrize(
    ('sensor', 'said', 'reason'),
    [
        *((sensor, frozen, 'stalled') for sensor in (net_ft, bota, text)),
        *((sensor, one_axis_is_no_number, 'not a number') for sensor in (bota, text)),
    ],
)
def test_a_sensor_that_repeats_one_value_or_says_no_number_stops_the_tip(
    bench: Bench, sensor: Liar, said: Callable[[Values], Values], reason: str
) -> None:
    """20 samples at 200 to 500 Hz are 0.04 to 0.1 mm, and as much again for what a busy computer adds."""
    with sensor(bench, Lie(bench.begins, said)) as settings:
        must_stop(bench, settings, SENSOR, reason, 1.0)


def test_samples_that_arrive_a_second_and_a_half_late_stop_the_tip(bench: Bench) -> None:
    """They come as often as ever after the first pause, which is shorter than the silence that is granted here."""
    since_s: list[float] = []

    def delay_s() -> float:
        if not bench.begins():
            return 0.0
        since_s[:] = since_s or [monotonic_s()]
        return min(1.5, 0.8 * (monotonic_s() - since_s[0]))

    with net_ft(bench, None, delay_s=delay_s) as settings:
        must_stop(bench, settings, SENSOR, 'ms old', 1.2, silence_ms=300.0)


def test_a_sensor_that_slows_down_step_by_step_stops_the_tip(bench: Bench) -> None:
    """From 500 samples a second to 2, half as many from 0.1 mm to 0.1 mm."""

    def every() -> int:
        return 1 << max(0, min(8, math.ceil((bench.depth_mm - BEGINS_MM) / 0.1))) if bench.descending else 1

    with net_ft(bench, None, every=every) as settings:
        must_stop(bench, settings, SENSOR, '', 1.6, silence_ms=100.0)


def test_a_threshold_that_the_box_itself_has_latched_stops_the_tip(bench: Bench) -> None:
    """Bit 16 and the summary, on sound counts: a limit of force that does not depend on this software."""
    with net_ft(bench, None, status=lambda: 0x8001_0000 if bench.begins() else 0) as settings:
        must_stop(bench, settings, OVERLOAD, 'threshold', 1.0)


def test_an_old_force_with_the_noise_of_a_sound_sensor_stops_the_tip(bench: Bench) -> None:
    """Nothing of it repeats, is late, or is no number; but at 0.6 mm the gel gave twice as much."""
    noise = random.Random(1)

    def replayed(last: Values) -> Values:
        return tuple(value + noise.gauss(0.0, 5000.0 if axis < 3 else 100.0) for axis, value in enumerate(last))

    with net_ft(bench, Lie(bench.begins, replayed)) as settings:
        must_stop(bench, settings, MACHINE, 'but the gel gave', 1.3)


def test_one_axis_of_six_that_stands_still_stops_the_tip(bench: Bench) -> None:
    """Of 500 samples a second 120 are 0.24 mm."""
    lie = Lie(bench.begins, lambda last: last)

    def only_z(values: Values) -> Values:
        distorted = lie.of(values)
        return (*values[:2], distorted[2], *values[3:])

    with net_ft(bench, Changed(only_z)) as settings:
        must_stop(bench, settings, SENSOR, 'stalled', 1.2)
