"""How late and how completely each hardware driver hands over what its device sends, at its highest rate.

Every device is emulated in a process of its own, behind its own wire protocol, and knows when it made what; its driver
runs in another process as a program uses it. Latency runs from the device's making or sending to the driver's handing
over, in the reader's hands; of a CNC, from the question to the answer. What was lost, reordered or doubled is counted
from the device's own numbers, not from what the driver says.
"""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
import os
import tempfile
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from ctypes import c_int64
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.drivers import devices, readers
from benchmarks.drivers.meter import Meter
from benchmarks.report import surroundings, table, write_json
from tactile_nodes.clock import SystemClock
from tactile_nodes.errors import DeviceError, TactileError

MARGIN_S = 60.0  # for starting, homing and ending

Device = Callable[[Path, np.ndarray], AbstractContextManager[devices.Address]]


@dataclass(frozen=True)
class Case:
    """One driver and the device that it is measured on; a device of None lives in the reader's process."""

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


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of ``tactile bench drivers``."""
    parser.add_argument(
        '--only', nargs='+', choices=CASES, metavar='NAME', help=f'of {", ".join(CASES)} (default: all)'
    )
    parser.add_argument('--seconds', type=float, default=10.0, help='how long to measure each (default: 10)')
    parser.add_argument('--together', type=int, default=1, metavar='N', help='measure so many at once (default: 1)')
    parser.add_argument('-o', '--output', type=Path, metavar='FILE.json', help='keep the result')


def run(arguments: argparse.Namespace) -> int:
    """Measure, print, and keep; what has failed is said among the rest, and in the exit status."""
    names, result = arguments.only or list(CASES), {**surroundings('tactile bench drivers'), 'drivers': {}}
    for first in range(0, len(names), arguments.together):
        result['drivers'] |= measure(names[first : first + arguments.together], arguments.seconds)
        if arguments.output:
            write_json(arguments.output, result)
    print(text(result))
    return int(any('failed' in entry for entry in result['drivers'].values()))


def measure(names: list[str], seconds: float) -> dict[str, Any]:
    """The named drivers, all at once, for so many seconds."""
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
        context = multiprocessing.get_context('spawn')  # a fork would inherit threads and sockets
        stamps = context.RawArray(c_int64, 1 + devices.PICTURES)
        self._device_pipe, device_end = context.Pipe()
        self._reader_pipe, reader_end = context.Pipe()
        self._device = context.Process(target=_serve, args=(device_end, name, own, stamps), daemon=True)
        self._reader = context.Process(target=_read, args=(reader_end, name, stamps, seconds), daemon=True)
        for process in (self._device, self._reader):
            process.start()
        device_end.close()
        reader_end.close()
        self._reader_pipe.send(self._answer(self._device_pipe, MARGIN_S))

    def result(self, seconds: float) -> dict[str, Any]:
        """What the reader has measured, or why it could not."""
        try:
            found: dict[str, Any] = self._answer(self._reader_pipe, seconds + MARGIN_S)
        except TactileError as error:
            return {'failed': str(error)}
        return found

    def close(self) -> None:
        """End both."""
        for pipe, process in ((self._reader_pipe, self._reader), (self._device_pipe, self._device)):
            pipe.close()
            process.join(5.0)
            process.kill()

    def _answer(self, pipe: Connection, within_s: float) -> Any:
        try:
            if not pipe.poll(within_s):
                raise DeviceError(
                    f'the benchmark of {self.name} did not answer within {within_s:g} s; is the machine idle?'
                )
            answer = pipe.recv()
        except (EOFError, ConnectionResetError) as error:
            raise DeviceError(
                f'a process of the benchmark of {self.name} has ended; what it said stands above'
            ) from error
        if isinstance(answer, TactileError):
            raise answer
        return answer


def _serve(pipe: Connection, name: str, folder: Path, stamps: Any) -> None:
    """The process of a device: it lives until its pipe is closed."""
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


def text(result: dict[str, Any]) -> str:
    """The result as a person reads it."""
    machine, measured = result['machine'], result['drivers'].values()
    head = (
        f'{machine["processor"]}, {machine["cores_allowed"]} cores, load before {machine["load_before"][0]}; '
        f'commit {result["commit"]}; ' + ', '.join(f'{name} {version}' for name, version in result['versions'].items())
    )
    heads = ['driver', 'received', '/s', 'lost', 'reordered', 'doubled', 'latency p50', 'p99', 'worst [ms]']
    heads += ['stamp off by p99', 'worst [ms]', 'one core', 'memory [MB]', 'load', 'beside']
    failed = [f'{entry["title"]}: FAILED: {entry["failed"]}' for entry in measured if 'failed' in entry]
    return '\n'.join([head, '', table(heads, [_row(entry) for entry in measured if 'failed' not in entry]), *failed])


def _row(entry: dict[str, Any]) -> list[str]:
    latency, stamp, memory = entry['latency_ms'], entry['stamp_error_ms'], entry['memory_mb']
    return [
        entry['title'],
        f'{entry["received"]}',
        f'{entry["per_s"]:.0f}',
        *(f'{entry[what]}' for what in ('lost', 'reordered', 'doubled')),
        *(f'{latency[level]:.2f}' for level in ('p50', 'p99', 'worst')),
        *(f'{stamp[level]:.2f}' if stamp else '–' for level in ('p99', 'worst')),
        f'{entry["cpu_share"]:.0%}',
        f'{memory["begin"]:.1f} → {memory["half"]:.1f} → {memory["end"]:.1f}',
        f'{entry["load"][1]:.1f}',
        ', '.join(entry['beside']),
    ]
