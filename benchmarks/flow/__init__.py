"""Error of each flow method by region against the true motion, and its time on one thread.

Simulated presses, some with other light or blur; the true motion is the mean over the markers of each region with three
or more. Then a rest image moved as a whole, and expanded as under a very deep press; and, if the images are there,
synthetic speckle with known shifts. The methods run in turn on each image, so that other load affects all alike.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.flow.cases import Case, Sensor, deep, disturbed, known_shifts, pressed, rigid
from benchmarks.flow.errors import errors_of
from benchmarks.harness.declaration import SIMULATED, Benchmark, Result, argument
from benchmarks.harness.report import table
from benchmarks.harness.running import Run
from tactile_nodes.sensing.flow.choice import make_flow

REGIONS = 40
_OURS = 'inverse_compositional'
CONTENDERS: dict[str, tuple[str, Mapping[str, object]]] = {
    'DIS ultrafast': ('dis', {}),
    'DIS medium': ('dis', {'preset': 'medium'}),
    'ours 40x40': (_OURS, {}),
    'ours 20x20': (_OURS, {'rows': 20, 'cols': 20}),
    'ours 40x40 half': (_OURS, {'finest_scale': 1}),
    'ours 20x20 half': (_OURS, {'rows': 20, 'cols': 20, 'finest_scale': 1}),
    'ours 10x10 half': (_OURS, {'rows': 10, 'cols': 10, 'finest_scale': 1}),
}


def measured(arguments: argparse.Namespace, _: Run) -> Result:
    """Measure every set of images with each method in turn."""
    cv2.setNumThreads(1)
    sensor = Sensor()
    sets: dict[str, Iterable[Case]] = {
        **pressed(sensor, arguments.presses), **disturbed(sensor, arguments.presses), **rigid(sensor), **deep(sensor)
    }  # fmt: skip
    if arguments.speckle:
        sets |= known_shifts(arguments.speckle)
    flows = {name: make_flow(method, options) for name, (method, options) in CONTENDERS.items()}
    found = {name: errors_of(flows, cases, REGIONS) for name, cases in sets.items()}
    return {
        'results': {name: {one: each.by_belief() for one, each in errors.items()} for name, errors in found.items()}
    }


def tables(result: Mapping[str, Any]) -> str:
    """Tables with a row for each set of images: errors, shares of large errors (if there are any), and times."""
    results, shown_tables = result['results'], []
    wild = {name: each for name, each in results.items() if any(one['far_share'] >= 0.0005 for one in each.values())}
    for title, cell, shown in (
        ('rms error in px (slope)', _error, results),
        ('off by over 1 px, of all / of believed', _far, wild),
        ('CPU time in ms, median', lambda each: f'{each["cpu_ms"]:.2f}', results),
    ):
        rows = [[name, *(cell(found[each]) for each in CONTENDERS)] for name, found in shown.items()]
        shown_tables.append(table([title, *CONTENDERS], rows))
    return '\n\n'.join(shown_tables)


def _error(summary: Mapping[str, float]) -> str:
    slope = '' if np.isnan(summary['slope']) else f' ({summary["slope"]:.2f})'
    return f'{summary["rms_px"]:.4f}{slope}'


def _far(summary: Mapping[str, float]) -> str:
    return f'{summary["far_share"]:.1%} / {summary["believed_far_share"]:.1%}'


BENCHMARK = Benchmark(
    name='flow',
    about=__doc__,
    sources=('benchmarks/flow/**', 'tactile_nodes/sensing/flow/**', *SIMULATED),
    page=tables,
    measure=measured,
    by_hand=True,
    files=(),
    arguments=(
        argument(
            '--presses', least=1, type=int, default=40, help='simulated presses for each range of depths (default: 40)'
        ),
        argument('--speckle', type=Path, help='folder with the shifted speckle images of dic_rigid_shift'),
    ),
)
