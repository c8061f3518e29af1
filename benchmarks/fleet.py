"""Calibration of gels with few presses, with a prior that was learned from many other gels, and without it.

Gels of one described sensor vary in stiffness and thickness, in position, tilt, roll and focal length of the camera,
and in their markers. The deviations of many such gels from the description give a prior. Other gels are calibrated with
it, and without it.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

import numpy as np

from benchmarks.harness.declaration import SIMULATED, Benchmark, Result, argument
from benchmarks.harness.report import columns, opening
from benchmarks.harness.running import Run

if TYPE_CHECKING:
    from tactile_nodes.learning.datasets.simulated import Dataset
    from tactile_nodes.learning.field.fit import FieldFit
    from tactile_nodes.sensing.explain.field.readout import FieldReadout
    from tactile_nodes.shapes import Float
    from tactile_nodes.simulation.gel import Gel

PRESSES, FEW, JUDGED = 100, (5, 10, 30), 120
"""Presses on each gel of the fleet; presses that calibrate each other gel; presses at random places to test those."""

SHALLOWEST_MM, DEEPEST_MM, REACH_MM = 0.25, 1.15, 13.5
SEED, UNSEEN_SEED = 2077, 77
PLACED, READ = 3, 99
"""Seeds of the presses for calibration, and of those for the test."""

LEARNED, NONE, FIXED = "the fleet's", 'none', 'the camera as described'
ABOUT = """\
A prior is learned from {learned} gels of the simulated sensor, with {presses} presses of the paper's tip on each.
{unseen} other gels are tested, with {judged} presses at random places, up to {deepest:g} mm deep, whose forces are
estimated as a force field: *centre* is the median error of the centre of pressure, *total* the median relative error of
the total. In the first row only the description is known. Then the given number of presses calibrate the gel. Its
camera is estimated with the prior of the {learned} gels; with no prior, as the calibration does
(`tactile_nodes.learning.field.camera`); or it is assumed to be as described. Mean over the gels, with the worst gel in
brackets."""
TAUGHT = """\
Standard deviations over the {learned} gels, of the estimated camera relative to its description: position x and y (mm),
both tilts and the roll (degrees), the focal length (%); and of the estimated softness (%)."""


@dataclass(frozen=True)
class Make:
    """A gel of the fleet, or one outside it: a task."""

    number: int
    seed: int
    learned: tuple[float, ...] = ()


def measure(arguments: argparse.Namespace, run: Run) -> Result:
    """Learn the prior from the fleet, and measure the errors with it and without it."""
    fleet = {f'gel {number}': Make(number, SEED) for number in range(arguments.gels)}
    taught = run.parts(_taught, fleet, 'gels that are learned from')
    numbers = np.array([each['camera'] for each in taught.values()])
    softer = np.log([each['gain'] for each in taught.values()])
    learned = numbers.std(axis=0)
    unseen = {
        f'unseen gel {number}': Make(number, UNSEEN_SEED, tuple(learned.tolist())) for number in range(arguments.unseen)
    }
    return {
        'learned': arguments.gels, 'unseen': arguments.unseen, 'usual': learned.tolist(),
        'off': numbers.mean(axis=0).tolist(), 'softer': [float(softer.mean()), float(softer.std())],
        'read': list(run.parts(_read, unseen, 'gels that are not').values()),
    }  # fmt: skip


def _taught(make: Make) -> dict[str, Any]:
    """Deviation of the camera from its description, and softness of the gel, from many presses."""
    found = _fitted(_pressed(_gel(make), PRESSES, PLACED))
    return {'gain': found.gain, 'camera': found.looks.tolist()}


def _read(make: Make) -> dict[str, Any]:
    """Errors on a gel by the prior and the number of presses."""
    from tactile_nodes.learning.field.fit import described

    gel = _gel(make)
    judged = _pressed(gel, JUDGED, READ, 'random')
    sensor, scaling = _known(judged)
    found: dict[str, Any] = {'description': _errors(described(sensor, scaling).readout, judged)}
    priors: dict[str, AbstractContextManager[Any]] = {
        LEARNED: _with_prior(np.array(make.learned)), NONE: nullcontext(), FIXED: _as_described()
    }  # fmt: skip
    for presses in FEW:
        dataset = _pressed(gel, presses, PLACED)
        for name, prior in priors.items():
            with prior:
                found[f'{presses}, {name}'] = _errors(_fitted(dataset).readout, judged)
    return found


def _with_prior(usual: Float[np.ndarray, ' 6']) -> AbstractContextManager[Any]:
    """A context in which the estimate of the camera has its description as prior, with these standard deviations."""
    from tactile_nodes.learning.field import camera

    plain = camera.ObservedPresses.left

    def left(self: Any, rest: np.ndarray, by: np.ndarray) -> np.ndarray:
        return np.concatenate([plain(self, rest, by), (by * camera.SCALES)[usual > 0] / usual[usual > 0]])

    return patch.object(camera.ObservedPresses, 'left', left)


def _as_described() -> AbstractContextManager[Any]:
    """A context in which the camera is not estimated."""
    return patch('tactile_nodes.learning.field.fit.fitted_camera', lambda regions, *_: regions.sensor)


def _gel(make: Make) -> Gel:
    from tactile_nodes.simulation.gel import Gel
    from tactile_nodes.simulation.other_gels import other_gel

    return other_gel(Gel(), make.number, make.seed)


def _pressed(gel: Gel, presses: int, seed: int, plan: str = 'spread') -> Dataset:
    """Simulated presses, with flow and encoding of the shipped model."""
    from tactile_nodes.learning.config import Choice, DataConfig, TrainConfig
    from tactile_nodes.learning.datasets.simulated import simulate
    from tactile_nodes.learning.progress import Progress
    from tactile_nodes.model_file import find_model, load_model

    source = load_model(find_model('field'))
    data = DataConfig(
        plan=plan, presses=presses, seed=seed, reach_mm=REACH_MM, shallowest_mm=SHALLOWEST_MM, deepest_mm=DEEPEST_MM,
        without_contact=0.5, presses_per_rest_image=0, processes=1,
    )  # fmt: skip
    config = TrainConfig(data=data, flow=Choice(*source.flow), encoding=Choice(*source.encoding), gel=gel)
    return simulate(config, Progress())


def _known(dataset: Dataset) -> tuple[Any, Any]:
    """The described sensor, and the scaling of its regions at rest."""
    from tactile_nodes.learning.field.fit import uncovered
    from tactile_nodes.learning.transfer.fit import at_rest, pressed_gel
    from tactile_nodes.model_file import find_model, load_model
    from tactile_nodes.sensing.explain.field.readout import FieldReadout
    from tactile_nodes.sensors import load_sensor

    sensor, readout = load_sensor('simulated'), load_model(find_model('field')).model.readout
    assert isinstance(readout, FieldReadout)
    scaling, _, _ = pressed_gel((readout.tips or readout).scaling, dataset)
    return sensor, uncovered(sensor, at_rest(scaling))


def _fitted(dataset: Dataset) -> FieldFit:
    """The field fitted to the presses of a dataset."""
    from tactile_nodes.learning.field.body import Bodies, KnownBody
    from tactile_nodes.learning.field.fit import fit_field
    from tactile_nodes.learning.transfer.fit import folds_of

    sensor, scaling = _known(dataset)
    rows = np.flatnonzero(dataset.presses[:, 2] > 0)
    fold = folds_of(dataset.presses[rows][:, [0, 1, 3]].astype(float))
    return fit_field(sensor, scaling, dataset, rows, fold, Bodies.one(KnownBody.named('tip'), len(dataset.presses)))


def _errors(readout: FieldReadout, judged: Dataset) -> dict[str, float]:
    """Errors of the estimates: median distance of the centres, and median relative error of the totals."""
    patches = readout.solver.patches.centres_mm
    away, off = [], []
    for row in np.flatnonzero(judged.presses[:, 2] > 0).tolist():
        values, confidence = judged.features[row].astype(np.float32), judged.confidence[judged.rest[row]]
        pressed = readout.solver.field(*readout.weighed(values, confidence)[1:]).forces_n[0]
        x, y, _, force_n = judged.presses[row].tolist()
        centre = pressed @ patches / max(float(pressed.sum()), 1e-9)
        away.append(float(np.hypot(*(centre - (x, y)))))
        off.append(abs(float(pressed.sum()) / force_n - 1))
    return {'centre_mm': float(np.median(away)), 'total': float(np.median(off))}


def page(result: Mapping[str, Any]) -> str:
    """The page in Markdown."""
    about = ABOUT.format(presses=PRESSES, judged=JUDGED, deepest=DEEPEST_MM, **result)
    rows = [{'presses': 'none', 'prior': 'the description', **_summed(result['read'], 'description')}]
    rows += [
        {'presses': str(presses), 'prior': name, **_summed(result['read'], f'{presses}, {name}')}
        for presses in FEW for name in (LEARNED, NONE, FIXED)
    ]  # fmt: skip
    errors = columns(
        rows, ('presses', '{presses}'), ('prior', '{prior}'), ('centre [mm]', '{centre_mm}'), ('total', '{total}')
    )
    x, y, about_x, about_y, roll, focal, *_ = result['usual']  # the thickness follows
    taught = {
        'x': f'{x:.2f}', 'y': f'{y:.2f}', 'ax': f'{about_x:.2f}', 'ay': f'{about_y:.2f}', 'roll': f'{roll:.2f}',
        'focal': f'{100 * focal:.1f}', 'soft': f'{100 * result["softer"][1]:.0f}',
    }  # fmt: skip
    heads = {
        'x': 'x',
        'y': 'y',
        'ax': 'tilt about x',
        'ay': 'about y',
        'roll': 'roll',
        'focal': 'focal',
        'soft': 'softness',
    }
    learned = columns([taught], *((head, f'{{{name}}}') for name, head in heads.items()))
    return '\n\n'.join(
        [
            *opening('A prior from many gels', result, about),
            errors,
            '## The learned prior',
            TAUGHT.format(**result),
            learned,
        ]
    )


def _summed(read: Sequence[Mapping[str, Mapping[str, float]]], name: str) -> dict[str, str]:
    centre, total = (np.array([each[name][key] for each in read]) for key in ('centre_mm', 'total'))
    return {
        'centre_mm': f'{centre.mean():.3f} ({centre.max():.3f})',
        'total': f'{100 * total.mean():.1f} % ({100 * total.max():.1f} %)',
    }


BENCHMARK = Benchmark(
    name='fleet',
    about=__doc__,
    sources=(
        'benchmarks/fleet.py', 'tactile_nodes/learning/field/**', 'tactile_nodes/sensing/elasticity/**',
        'tactile_nodes/sensing/explain/field/**', 'tactile_nodes/sensing/flow/**', *SIMULATED,
    ),
    page=page,
    measure=measure,
    tasks=True,
    arguments=(
        argument('--gels', type=int, default=100, least=2, help='gels to learn the prior from (default: %(default)s)'),
        argument('--unseen', type=int, default=10, least=1, help='gels to test (default: %(default)s)'),
    ),
    example="""\
examples:
  tactile bench fleet -o docs/results
  tactile bench fleet --on tcp://scheduler:8786 -o docs/results
  tactile bench fleet --gels 2 --unseen 1    # to see that it runs""",
)  # fmt: skip
