"""Latency and losses of each hardware driver at the highest rate of its device.

Each device is emulated in a separate process, with its own wire protocol, and records the times of its data. Its driver
runs in another process, as in an application. Latency is from the time at which the device makes or sends its data
until the reader has it; for a CNC, from question to answer. Lost, reordered and doubled data are counted by the
device's own numbers, not by the driver's counters.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from ctypes import c_int64
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.drivers import devices, readers
from benchmarks.drivers.meter import Meter
from benchmarks.harness.declaration import Benchmark, Result, argument
from benchmarks.harness.report import columns, machine_and_commit, named_versions
from benchmarks.harness.running import Run
from benchmarks.harness.workers import SPAWN, Worker
from tactile_nodes.clock import SystemClock
from tactile_nodes.errors import TactileError

MARGIN_S = 60.0  # for starting, homing and ending

Device = Callable[[Path, np.ndarray], AbstractContextManager[devices.Address]]


@dataclass(frozen=True)
class Case:
    """One driver and its emulated device; with the device None, the reader's process emulates it."""

    title: str
    device: Device | None
    reader: readers.Reader


CASES = {
    'net_ft': Case('Net F/T, 7000 records/s', devices.net_ft, readers.net_ft),
    'bota': Case('Bota, 1004 frames/s', devices.bota, readers.bota),
    'text': Case('lines of text, 500/s', devices.text, readers.text),
    'camera_60': Case('MJPEG 640x480, 60/s', devices.camera_60, readers.camera),
    'camera_flood': Case('MJPEG 640x480, as fast as it goes', devices.camera_flood, readers.camera),
    'grbl': Case('Grbl, 3 reports and a jog in turn', devices.grbl, readers.grbl),
    'marlin': Case('Marlin, 3 reports and a jog in turn', devices.marlin, readers.marlin),
    'sync': Case('sync input, 50 edges/s', None, readers.sync),
}


def measured(arguments: argparse.Namespace, run: Run) -> Result:
    """Measure the chosen drivers, several at once; each group is stored before the next begins."""
    found: dict[str, Any] = {}
    for first in range(0, len(run.cases), arguments.together):
        found |= measure(run.cases[first : first + arguments.together], arguments.seconds)
        run.keep({'drivers': found})
    return {'drivers': found}


def measure(names: Sequence[str], seconds: float) -> dict[str, Any]:
    """Measure the named drivers, all at once, for `seconds`."""
    found: dict[str, Any] = {}
    with tempfile.TemporaryDirectory(prefix='tb') as folder, ExitStack() as running:
        trials = [running.enter_context(contextlib.closing(_Trial(name, seconds, Path(folder)))) for name in names]
        for trial in trials:
            found[trial.name] = {
                'title': CASES[trial.name].title,
                'beside': [name for name in names if name != trial.name],
                **trial.result(seconds),
                'load': [round(load, 2) for load in os.getloadavg()],
            }
    return found


class _Trial:
    """The two processes of one case, running."""

    def __init__(self, name: str, seconds: float, folder: Path) -> None:
        self.name = name
        own = folder / name
        own.mkdir()
        stamps = SPAWN.RawArray(c_int64, 1 + devices.PICTURES)
        self._device = Worker(_serve, name, own, stamps)
        self._reader = Worker(_read, name, stamps, seconds)
        self._reader.send(self._device.answer(MARGIN_S))

    def result(self, seconds: float) -> dict[str, Any]:
        """The reader's measurements, or the reason of its failure."""
        try:
            found: dict[str, Any] = self._reader.answer(seconds + MARGIN_S)
        except TactileError as error:
            return {'failed': str(error)}
        return found

    def close(self) -> None:
        """End both processes."""
        self._reader.close()
        self._device.close()


def _serve(pipe: Connection, name: str, folder: Path, stamps: Any) -> None:
    """The process of a device; it runs until its pipe is closed."""
    device = CASES[name].device
    if device is None:
        pipe.send({})
        return
    with device(folder, np.frombuffer(stamps, np.int64)) as address:
        pipe.send(address)
        pipe.poll(None)


def _read(pipe: Connection, name: str, stamps: Any, seconds: float) -> None:
    """The process of a driver."""
    address = {**pipe.recv(), 'seconds': seconds + MARGIN_S}
    meter = Meter(SystemClock(), seconds)
    try:
        CASES[name].reader(address, np.frombuffer(stamps, np.int64), meter)
        pipe.send(meter.result())
    except TactileError as error:
        pipe.send(error)


def text(result: Mapping[str, Any]) -> str:
    """The result as text for the user."""
    found, head = result['drivers'].values(), f'{machine_and_commit(result)}; {named_versions(result)}'
    failed = [f'{entry["title"]}: FAILED: {entry["failed"]}' for entry in found if 'failed' in entry]
    measured = columns(
        [entry for entry in found if 'failed' not in entry],
        ('driver', '{title}'), ('received', '{received}'), ('/s', '{per_s:.0f}'), ('lost', '{lost}'),
        ('reordered', '{reordered}'), ('doubled', '{doubled}'), ('latency p50', '{latency_ms[p50]:.2f}'),
        ('p99', '{latency_ms[p99]:.2f}'), ('worst [ms]', '{latency_ms[worst]:.2f}'),
        ('stamp off by p99', _stamp('p99')), ('worst [ms]', _stamp('worst')), ('one core', '{cpu_share:.0%}'),
        ('memory [MB]', '{memory_mb[begin]:.1f} → {memory_mb[half]:.1f} → {memory_mb[end]:.1f}'),
        ('load', '{load[1]:.1f}'), ('beside', lambda entry: ', '.join(entry['beside'])),
    )  # fmt: skip
    return '\n'.join([head, '', measured, *failed])


def _stamp(of: str) -> Callable[[Mapping[str, Any]], str]:
    return lambda entry: f'{entry["stamp_error_ms"][of]:.2f}' if entry['stamp_error_ms'] else '–'


BENCHMARK = Benchmark(
    name='drivers',
    about=__doc__,
    sources=(
        'benchmarks/drivers/**',
        'benchmarks/devices/**',
        'tactile_nodes/drivers/**',
        'tactile_nodes/emulators/**',
    ),
    page=text,
    measure=measured,
    cases=tuple(CASES),
    failed=lambda result: any('failed' in entry for entry in result['drivers'].values()),
    files=('drivers.json', 'drivers_again.json', 'drivers.md'),
    by_hand=True,
    arguments=(
        argument('--seconds', type=float, default=10.0, help='duration for each driver (default: 10)'),
        argument('--together', type=int, default=1, metavar='N', help='drivers to measure at once (default: 1)'),
    ),
)
