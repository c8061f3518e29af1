"""Faults of the whole system during live sensing: killed processes, invalid messages, overload, and damaged files.

`kills`: kill -9 of each process of a live launch while the gel is touched. `bus`: random frames and messages to every
socket and topic of a live launch, and damage to its run folder. `crowd`: a hundred nodes, and sixteen sensors. `files`:
a bag truncated after each byte, and model files with one changed byte.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.harness.declaration import LIVE, Benchmark, Result, argument
from benchmarks.harness.running import Run
from benchmarks.harness.workers import own_bus
from benchmarks.system_faults.bus import SPOILT, WATCH_S, garbage, spoil
from benchmarks.system_faults.crowd import IDLE_S, many_nodes, many_sensors
from benchmarks.system_faults.files import bag_cuts, model_bytes
from benchmarks.system_faults.kills import VICTIMS, kills
from benchmarks.system_faults.page import complaints, page
from benchmarks.system_faults.sensor import Sensor, sensor
from tactile_nodes.learning.progress import Progress

PARTS = ('kills', 'bus', 'crowd', 'files')
MODELS = {'portable': 600, 'fast': 200, 'paper': 100}
RATES_HZ = (5.0, 10.0, 20.0)


def measured(arguments: argparse.Namespace, run: Run) -> Result:
    """Measure one part, on a separate bus."""
    (part,) = arguments.only
    with tempfile.TemporaryDirectory(prefix='ts') as scratch, own_bus(Path(scratch) / 'run'):
        return measure(part, arguments, Path(scratch) / part, run.progress)


def measure(part: str, arguments: argparse.Namespace, folder: Path, progress: Progress) -> Result:
    """Measure one part. Raises ConfigurationError if sensing does not start."""
    folder.mkdir(parents=True)
    if part == 'kills':
        chosen = [victim for victim in VICTIMS if arguments.kill is None or victim.process in arguments.kill]
        return {'kills': kills(folder, chosen, arguments.period, progress)}
    if part == 'bus':
        return _bus(folder, 20, list(SPOILT)[:1], 1.0) if arguments.quick else _bus(folder, 200, list(SPOILT), WATCH_S)
    if part == 'crowd':
        quick = arguments.quick
        count, idle_s, sensors, rates = (4, 0.5, 2, RATES_HZ[:1]) if quick else (100, IDLE_S, 16, RATES_HZ)
        seconds = 2.0 if quick else 5.0
        nodes = many_nodes(count, idle_s, progress)
        return {'nodes': nodes, 'sensors': many_sensors(sensors, rates, seconds, progress)}
    models = {'portable': 20} if arguments.quick else MODELS
    return {
        'bags': bag_cuts(folder, progress, 199 if arguments.quick else 1),
        'models': [model_bytes(folder, name, count, progress) for name, count in models.items()],
    }


def _bus(folder: Path, frames: int, faults: Sequence[str], watch_s: float) -> dict[str, Any]:
    with sensor(folder, 4.0) as running:
        return on_bus(running, frames, faults, watch_s)


def on_bus(running: Sensor, frames: int, faults: Sequence[str], watch_s: float) -> dict[str, Any]:
    """Send `frames` random frames to each socket of a running sensor, then apply faults to its run folder."""
    sent = garbage(running, frames, watch_s)
    return {'garbage': sent, 'spoilt': [asdict(spoil(running, fault, watch_s)) for fault in faults]}


BENCHMARK = Benchmark(
    name='system_faults',
    about=__doc__,
    sources=('benchmarks/system_faults/**', 'tactile_nodes/bag/**', *LIVE),
    page=page,
    measure=measured,
    cases=PARTS,
    in_parts=True,
    quick=True,
    failed=lambda result: bool(complaints(result)),
    output=Path('system_faults'),
    arguments=(
        argument(
            '--kill',
            action='append',
            choices=[victim.process for victim in VICTIMS],
            metavar='PROCESS',
            help='kill only this one',
        ),
        argument(
            '--period', least=4, type=float, default=16.0, help='period of the presses in s (default: %(default)s)'
        ),
    ),
)
