"""Faults of the whole system while it senses: what is killed, removed, altered, or too much of everything.

`kills`: kill -9 of each process of a live launch with the gel touched. `bus`: random frames and messages to every
socket and topic of a live launch, and its run folder spoilt in each way. `crowd`: a hundred nodes, and sixteen sensors.
`files`: a bag cut after each byte, and model files with one byte altered.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.report import keep, surroundings
from benchmarks.system_faults.bus import SPOILT, WATCH_S, garbage, spoil
from benchmarks.system_faults.crowd import many_nodes, many_sensors
from benchmarks.system_faults.files import bag_cuts, model_bytes
from benchmarks.system_faults.kills import VICTIMS, kills
from benchmarks.system_faults.page import complaints, page
from benchmarks.system_faults.sensor import sensor
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.progress import Progress, TerminalProgress

PARTS = ('kills', 'bus', 'crowd', 'files')
MODELS = {'portable': 600, 'fast': 200, 'accurate': 100, 'paper': 100}
RATES_HZ = (5.0, 10.0, 20.0)
NAME = 'system_faults'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of ``tactile bench system_faults``."""
    names = [victim.process for victim in VICTIMS]
    parser.add_argument('--only', action='append', choices=PARTS, help='one part; the others stay as they are kept')
    parser.add_argument('--kill', action='append', choices=names, metavar='PROCESS', help='kill only this one')
    parser.add_argument('--period', type=float, default=16.0, help='seconds from press to press (default: %(default)s)')
    parser.add_argument('--quick', action='store_true', help='little of each, to see that it runs; too little to quote')
    parser.add_argument(
        '-o', '--output', type=Path, default=Path(NAME), metavar='FOLDER', help='for results, and launches below it'
    )


def run(arguments: argparse.Namespace) -> int:
    """Do it, print, and keep; 1 if something broke."""
    folder: Path = arguments.output.absolute()
    if not arguments.period >= 4.0:
        raise ConfigurationError(f'--period must be 4 s or more, got {arguments.period:g}')
    parts = _earlier(folder)
    with tempfile.TemporaryDirectory(prefix='ts') as scratch:
        os.environ['TACTILE_RUN_DIR'] = str(Path(scratch) / 'run')  # a bus of our own
        for part in PARTS:
            if arguments.only is None or part in arguments.only:
                command = f'tactile bench {NAME} --only {part}{" --quick" * arguments.quick} -o docs/results'
                found = measure(part, arguments, Path(scratch) / part, TerminalProgress())
                parts[part] = {**surroundings(command), **found}
                keep(folder, NAME, page(parts), parts)
    print(page(parts))
    return int(bool(complaints(parts)))


def measure(part: str, arguments: argparse.Namespace, folder: Path, progress: Progress) -> dict[str, Any]:
    """One part. Raises ConfigurationError if sensing does not come up."""
    folder.mkdir(parents=True)
    if part == 'kills':
        chosen = [victim for victim in VICTIMS if arguments.kill is None or victim.process in arguments.kill]
        return {'kills': kills(folder, chosen, arguments.period, progress)}
    if part == 'bus':
        return _bus(folder, 20, list(SPOILT)[:1], 1.0) if arguments.quick else _bus(folder, 200, list(SPOILT), WATCH_S)
    if part == 'crowd':
        count, sensors, rates = (4, 2, RATES_HZ[:1]) if arguments.quick else (100, 16, RATES_HZ)
        return {'nodes': many_nodes(count, progress), 'sensors': many_sensors(sensors, rates, 5.0, progress)}
    models = {'portable': 20} if arguments.quick else MODELS
    return {
        'bags': bag_cuts(folder, progress, 199 if arguments.quick else 1),
        'models': [model_bytes(folder, name, count, progress) for name, count in models.items()],
    }


def _bus(folder: Path, frames: int, faults: Sequence[str], watch_s: float) -> dict[str, Any]:
    with sensor(folder, 4.0) as running:
        sent = garbage(running, frames)
        return {'garbage': sent, 'spoilt': [asdict(spoil(running, fault, watch_s)) for fault in faults]}


def _earlier(folder: Path) -> dict[str, Any]:
    """The parts that stand in a folder already."""
    file = folder / f'{NAME}.json'
    found: dict[str, Any] = json.loads(file.read_text(encoding='utf-8')) if file.exists() else {}
    return found
