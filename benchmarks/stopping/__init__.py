"""Time and distance from the first force sample above the limit to the stop command, and to the tip at rest.

Grbl and Net F/T box are emulated in a separate process, with their wire protocols. That process records the time of the
sample, the time of the stop, all commands in between, and where the tip came to rest. Drivers, safety and guard are
those of a collection, in this process. A real rig adds the delays of USB and firmware.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness.declaration import RIG, Benchmark, Result, argument
from benchmarks.harness.report import table
from benchmarks.harness.running import Run
from benchmarks.harness.workers import Worker
from benchmarks.stopping.rig import NEVER, Seen, serve
from tactile_nodes.clock import SystemClock
from tactile_nodes.collection.actions import Go, Look, Procedure, SetTare
from tactile_nodes.collection.hands import TrippedError
from tactile_nodes.collection.press.speed import stopping_mm
from tactile_nodes.collection.safety import FORCE
from tactile_nodes.collection.settings import CollectionSettings, LimitSettings
from tactile_nodes.collection.station import Station
from tactile_nodes.collection.wrench import tare_of
from tactile_nodes.drivers.cnc.contract import CncSettings
from tactile_nodes.drivers.force_torque.contract import ForceTorqueSettings, NetFtSettings
from tactile_nodes.emulators.force_torque.net_ft_config import INTERNAL_RATE_HZ
from tactile_nodes.emulators.world import WorldSettings
from tactile_nodes.errors import DeviceFaultError

LIMIT_N = 0.4
SAFE_Z_MM, ABOVE_MM, DEEP_MM = -26.0, 0.3, 2.5
TRAVEL_MM_MIN = 1200.0
BRAKE_MM_S2 = 200.0  # $120 to $122 of the emulated Grbl
TARE_S, FEWEST = 0.2, 50
PATIENCE = 20
WORST = ('p50', 'p99', 'worst')


def measured(arguments: argparse.Namespace, _: Run) -> Result:
    """Measure all stops at each feed."""
    found = {feed: measure(feed, arguments.stops, arguments.divider) for feed in arguments.feeds}
    return {'limit_n': LIMIT_N, 'feeds': {f'{feed:g} mm/min': _result(stops) for feed, stops in found.items()}}


def measure(feed_mm_min: float, stops: int, divider: int = 7) -> list[Seen]:
    """Move down into the gel `stops` times, each time until the force limit stops the tip.

    Raises:
        DeviceError: a device failed, or the limit did not stop the tip.
    """
    with tempfile.TemporaryDirectory() as folder, _rig(Path(folder), divider) as (rig, cnc, force_torque):
        limits = LimitSettings(force_n=LIMIT_N, force_rate_n_s=1e6, force_silence_ms=2000.0)
        settings = CollectionSettings(limits=limits)
        station = Station(settings, cnc, force_torque, WorldSettings(), SystemClock(), *(lambda _: None,) * 3)
        try:
            station.cnc.home()
            station.safety.watch(station.hands.clock.now_ns(), camera=False)
            return [_one(station, settings, rig, feed_mm_min) for _ in range(stops)]
        finally:
            station.close()


def _result(stops: Sequence[Seen]) -> dict[str, Any]:
    numbers = {f'{name} [{unit}]': dict(zip(WORST, summary(all_), strict=True)) for name, all_, unit in measures(stops)}
    return {**numbers, 'stops': len(stops), 'not the first command': sum(bool(seen.before) for seen in stops)}


def measures(stops: Sequence[Seen]) -> list[tuple[str, list[float], str]]:
    """The measures of the stops: name, values, unit."""
    return [
        ('sample to stop on the wire', [(each.stop_ns - each.sample_ns) / 1e6 for each in stops], 'ms'),
        ('sample to rest', [(each.rest_ns - each.sample_ns) / 1e6 for each in stops], 'ms'),
        ('way from sample to rest', [each.way_mm for each in stops], 'mm'),
        ('force above the limit', [each.greatest_n - LIMIT_N for each in stops], 'N'),
    ]


def summary(values: Sequence[float]) -> tuple[float, float, float]:
    """Median, 99th percentile and maximum. The numbers 1 to 100 give 50.5, 99.01 and 100."""
    return float(np.median(values)), float(np.percentile(values, 99)), max(values)


@contextmanager
def _rig(folder: Path, divider: int) -> Iterator[tuple[Worker, CncSettings, ForceTorqueSettings]]:
    rig = Worker(serve, folder, LIMIT_N, divider)
    try:
        rdt_port, http_port = rig.answer()
        net_ft = NetFtSettings(rdt_port=rdt_port, http_port=http_port)
        cnc = CncSettings(str(folder / 'cnc'), 'grbl', boot_s=0.5, safe_z_mm=SAFE_Z_MM)
        sensor = ForceTorqueSettings('netft://127.0.0.1', rate_hz=INTERNAL_RATE_HZ / divider, net_ft=net_ft)
        yield rig, cnc, sensor
    finally:
        rig.close()


def _one(station: Station, settings: CollectionSettings, rig: Worker, feed_mm_min: float) -> Seen:
    """One stop. Stops for another reason than the force, as on a busy machine, are repeated."""
    reason = ''
    for _ in range(PATIENCE):
        try:
            station.hands.run(_ready(settings))
            rig.send('arm')
            station.hands.run(_down(feed_mm_min))
        except TrippedError as tripped:
            station.hands.retreat()
            station.safety.reset(station.hands.clock.now_ns(), station.safety.trip)
            reason = tripped.trip.reason
            if tripped.trip.kind == FORCE:
                return _seen(rig)
    raise DeviceFaultError(f'the force limit did not stop the tip in {PATIENCE} attempts; {reason}')


def _seen(rig: Worker) -> Seen:
    seen: Seen = rig.ask('tell')
    if NEVER in {seen.sample_ns, seen.stop_ns, seen.rest_ns}:
        raise DeviceFaultError(f'the emulated rig saw no stop: {seen}')
    return seen


def _ready(settings: CollectionSettings) -> Procedure[None]:
    s = settings.surface
    yield Go(s.gel_x_mm, s.gel_y_mm, feed_mm_min=TRAVEL_MM_MIN)
    yield Go(z=WorldSettings().gel_z_mm + ABOVE_MM, feed_mm_min=TRAVEL_MM_MIN)
    seen = yield Look(TARE_S)
    while len(seen.samples) < FEWEST:  # a busy machine may be late
        seen = yield Look(TARE_S)
    yield SetTare(tare_of(seen.samples))


def _down(feed_mm_min: float) -> Procedure[None]:
    yield Go(z=WorldSettings().gel_z_mm - DEEP_MM, feed_mm_min=feed_mm_min)


def feeds_table(result: Mapping[str, Any]) -> str:
    """The table with a row for each feed and measure."""
    rows = []
    for feed, found in result['feeds'].items():
        numbers = {name: each for name, each in found.items() if isinstance(each, dict)}
        rows += [[f'{feed}: {name}', *(f'{each[of]:.3f}' for of in WORST)] for name, each in numbers.items()]
        allowed_mm = stopping_mm(CollectionSettings(), float(feed.split()[0]), BRAKE_MM_S2)
        rows.append([f'{feed}: distance assumed by the speed limit [mm]', '', '', f'{allowed_mm:.3f}'])
        others = f'{found["not the first command"]} of {found["stops"]}'
        rows.append([f'{feed}: stops with other commands before them', '', '', others])
    return table(['', 'median', 'p99', 'worst'], rows)


BENCHMARK = Benchmark(
    name='stopping',
    about=__doc__,
    sources=('benchmarks/stopping/**', *RIG),
    page=feeds_table,
    measure=measured,
    failed=lambda result: any(each['not the first command'] for each in result['feeds'].values()),
    by_hand=True,
    arguments=(
        argument('--stops', type=int, default=100, help='stops at each feed rate (default: %(default)s)'),
        argument(
            '--feeds',
            type=float,
            nargs='+',
            default=[60.0, 300.0],
            metavar='MM_MIN',
            help='feed rates of the tip (default: 60 300)',
        ),
        argument('--divider', type=int, default=7, help='divider of the 7000 samples a second (default: 7, 1000 Hz)'),
    ),
)
