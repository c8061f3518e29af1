"""Motion by region of each flow method against what is known of it, and its time on one thread.

Simulated presses, some in another light or blurred: the markers' true mean motion in each region that holds three or
more. Then a rest image moved as a whole, and pushed apart as under a very deep press; and, where the recordings lie,
computer-made speckle with commanded shifts. Methods take turns on every image, so that the machine's load meets all.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.flow.cases import Case, Sensor, deep, disturbed, known_shifts, pressed, rigid
from benchmarks.harness.declaration import SIMULATED, Benchmark, Result, argument
from benchmarks.harness.report import table
from benchmarks.harness.running import Run
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.flow.methods import DisplacementField, FlowMethod

BELIEVED = 0.4
"""Patches of more confidence than this are counted as believed."""

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


@dataclass(frozen=True)
class Score:
    """What one method made of a set of images: errors by region and axis (px), truth, belief, CPU times (ms)."""

    error: np.ndarray
    truth: np.ndarray
    believed: np.ndarray
    times_ms: list[float]

    def summary(self) -> dict[str, float]:
        """Root mean square error, slope of measured over true motion, share off by over 1 px, and of those believed."""
        size = np.square(self.truth).sum()
        far = np.hypot(*self.error.T) > 1
        return {
            'rms_px': float(np.sqrt(np.square(self.error).mean())),
            'slope': float(((self.error + self.truth) * self.truth).sum() / size) if size > 0 else float('nan'),
            'believed_rms_px': float(np.sqrt(np.square(self.error[self.believed]).mean()))
            if self.believed.any()
            else 0.0,
            'far_share': float(far.mean()),
            'believed_share': float(self.believed.mean()),
            'believed_far_share': float(far[self.believed].mean()) if self.believed.any() else 0.0,
            'cpu_ms': float(np.median(self.times_ms)),
        }


def measured(arguments: argparse.Namespace, _: Run) -> Result:
    """Every set of images, by each method in turn."""
    if arguments.presses < 1:
        raise ConfigurationError(f'--presses must be at least 1, got {arguments.presses}')
    cv2.setNumThreads(1)
    sensor = Sensor()
    sets: dict[str, Iterable[Case]] = {
        **pressed(sensor, arguments.presses), **disturbed(sensor, arguments.presses), **rigid(sensor), **deep(sensor)
    }  # fmt: skip
    if arguments.speckle:
        sets |= known_shifts(arguments.speckle)
    return {'results': {name: measure(cases) for name, cases in sets.items()}}


def measure(cases: Iterable[Case]) -> dict[str, dict[str, float]]:
    """What each contender makes of the cases, which take turns on every image."""
    flows = {name: make_flow(method, options) for name, (method, options) in CONTENDERS.items()}
    found: dict[str, list[Score]] = {name: [] for name in flows}
    rest: np.ndarray | None = None
    for case in cases:
        if case.rest is not rest:
            rest = case.rest
            for flow in flows.values():
                flow.set_reference(rest)
                flow.displacement(rest)
        for name, flow in flows.items():
            found[name].append(score(flow, case))
    return {name: _joined(scores).summary() for name, scores in found.items()}


def score(flow: FlowMethod, case: Case) -> Score:
    """One image: the method's motion in the regions that the case knows, and its CPU time."""
    start = time.process_time_ns()
    field = flow.displacement(case.image)
    took_ms = (time.process_time_ns() - start) / 1e6
    motion, confidence = by_region(field)
    truth, counts = case.truth(motion.shape[0])
    return Score((motion - truth)[counts], truth[counts], confidence[counts] > BELIEVED, [took_ms])


def by_region(field: DisplacementField, regions: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """Motion and confidence by patch, or of a dense field by region; a method that states none believes all."""
    motion = field.displacement_px
    if motion.shape[0] > regions:
        motion = cv2.resize(motion, (regions, regions), interpolation=cv2.INTER_AREA)
    confidence = field.confidence if field.confidence is not None else np.ones(motion.shape[:2], np.float32)
    return motion, confidence


def _joined(scores: list[Score]) -> Score:
    return Score(
        np.concatenate([each.error for each in scores]),
        np.concatenate([each.truth for each in scores]),
        np.concatenate([each.believed for each in scores]),
        [time for each in scores for time in each.times_ms],
    )


def tables(result: Mapping[str, Any]) -> str:
    """Tables with a row for each set of images: errors, what is far off (where anything is), and times."""
    results, shown_tables = result['results'], []
    wild = {name: each for name, each in results.items() if any(one['far_share'] >= 0.0005 for one in each.values())}
    for title, cell, shown in (
        ('rms error in px (slope)', _error, results),
        ('off by over 1 px, of all / of believed', _far, wild),
        ('CPU time in ms, median', _time, results),
    ):
        rows = [[name, *(cell(found[each]) for each in CONTENDERS)] for name, found in shown.items()]
        shown_tables.append(table([title, *CONTENDERS], rows))
    return '\n\n'.join(shown_tables)


def _error(summary: Mapping[str, float]) -> str:
    slope = '' if np.isnan(summary['slope']) else f' ({summary["slope"]:.2f})'
    return f'{summary["rms_px"]:.4f}{slope}'


def _far(summary: Mapping[str, float]) -> str:
    return f'{summary["far_share"]:.1%} / {summary["believed_far_share"]:.1%}'


def _time(summary: Mapping[str, float]) -> str:
    return f'{summary["cpu_ms"]:.2f}'


BENCHMARK = Benchmark(
    name='flow',
    about=__doc__,
    sources=('benchmarks/flow/**', 'tactile_nodes/sensing/flow/**', *SIMULATED),
    page=tables,
    measure=measured,
    by_hand=True,
    arguments=(
        argument('--presses', type=int, default=40, help='simulated presses a range of depths (default: 40)'),
        argument('--speckle', type=Path, help='folder with the shifted speckle images of dic_rigid_shift'),
    ),
)
