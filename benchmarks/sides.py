"""Accuracy on a gel whose sides or thickness differ from its description.

Models `field` are calibrated with presses of the tip on that gel, or follow from its description alone. They estimate
tips at random places, and contacts of ten families by the chain of a live launch. The simulated motion is that of a
gel without sides, and what finer finite elements say that the sides add: these are free, or held by a frame.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.contacts import read
from benchmarks.contacts.page import share
from benchmarks.harness.declaration import SENSING, SIMULATED, Aim, Benchmark, Result, argument, reached
from benchmarks.harness.report import opening, shown, table
from benchmarks.harness.running import Run

if TYPE_CHECKING:
    from tactile_nodes.simulation.gel import Gel

SEED, PER_FAMILY, PRESSES, TIPS = 303, 2, 40, 100
TIPS_SEED = 3030
SIDES = 'free', 'held'
IGNORED = 'ignored'
THICKNESSES = 0.8, 0.9, 1.1, 1.2
TIMES, TIMES_MISPLACED = 3.0, 1.5
ABOUT = """\
*Described* is `gel.sides` of the description that the model was made from, *thickness* the described thickness over the
true one, *presses* their number in its calibration.
Tips: {tips} presses at random places up to 13.5 mm from the middle and 0.25 to 1.15 mm deep; force error (root mean
square, median) and median place error. Contacts: {frames} of ten families (seed {seed}), columns as in
[contacts.md](contacts.md). The first rows are a gel as described that goes on beyond its sides, for comparison."""


@dataclass(frozen=True)
class Row:
    """A gel, its description, and the presses of the calibration."""

    sides: str
    described: str
    thickness: float
    presses: int


def measure(arguments: argparse.Namespace, run: Run) -> Result:
    """Measure every gel with every description."""
    few = arguments.presses
    rows = [
        Row(sides, described, 1.0, presses)
        for sides in (IGNORED, *SIDES)
        for described in dict.fromkeys((IGNORED, sides))
        for presses in (few, 0)
    ]
    rows += [Row(IGNORED, IGNORED, thickness, few) for thickness in THICKNESSES]
    found = [
        asdict(row)
        | run.part(
            f'{row.sides}, {row.described}, {row.thickness:g}, {row.presses}', partial(_measured, row, arguments, run)
        )
        for row in rows
    ]
    return {'seed': arguments.seed, 'each': arguments.each, 'tips': arguments.tips, 'rows': found}


def _measured(row: Row, arguments: argparse.Namespace, run: Run) -> dict[str, Any]:
    from benchmarks.contacts.cases import solved, wanted
    from benchmarks.contacts.frames import CONDITIONS
    from benchmarks.contacts.models import calibrated
    from benchmarks.contacts.scores import summed
    from tactile_nodes.model_file import find_model, load_model
    from tactile_nodes.sensors import load_sensor
    from tactile_nodes.simulation.gel import Gel

    gel, sensor = Gel(sides=row.sides), load_sensor('simulated')
    layers, markers = (
        tuple(row.thickness * each for each in depths) for depths in (sensor.gel.layers_mm, sensor.gel.markers_mm)
    )
    described = replace(sensor.gel, sides=row.described, layers_mm=layers, markers_mm=markers)
    sensor = replace(sensor, gel=described)
    touched = run.made(solved, wanted(Gel(), arguments.seed, arguments.each), 'solving contacts')
    with tempfile.TemporaryDirectory() as folder:
        source = load_model(find_model('field'))
        file = str(calibrated(source, gel, row.presses, Path(folder), run.progress, sensor))
        scores, _ = read({'field': file}, gel, touched, CONDITIONS[0], run.progress)
        return {'tips': _tips(file, gel, arguments.tips, run), 'contacts': summed(scores['field'])}


def _tips(model: str, gel: Gel, count: int, run: Run) -> dict[str, float]:
    """Errors of tips at places that no calibration saw."""
    import numpy as np

    from benchmarks.contacts.models import pressed_by_tip
    from tactile_nodes.learning.transfer.fit import live_errors
    from tactile_nodes.model_file import find_model, load_model

    loaded = load_model(find_model(model))
    dataset = pressed_by_tip(loaded, gel, count, run.progress, 'random', TIPS_SEED)
    off = live_errors(loaded.model.readout, dataset, np.flatnonzero(dataset.presses[:, 2] > 0))
    known = off[np.isfinite(off).all(axis=1)]
    force, place = np.abs(known[:, 2]), np.hypot(known[:, 0], known[:, 1])
    return {
        'rmse_n': float(np.sqrt(np.mean(np.square(force)))), 'force_n': float(np.median(force)),
        'place_mm': float(np.median(place)),
    }  # fmt: skip


def page(result: Mapping[str, Any]) -> str:
    """The page in Markdown."""
    heads = [
        'sides', 'described', 'thickness', 'presses', 'tips: RMSE [mN]', 'median [mN]', 'place [mm]',
        'contacts: misplaced', 'total rms [N]', 'median', 'centre [mm]', 'shear', 'total covered', 'ok',
        'worst while ok',
    ]  # fmt: skip
    rows = [_row(each) for each in result['rows']]
    frames = result['rows'][0]['contacts']['frames']
    about = ABOUT.format(tips=result['tips'], frames=frames, seed=result['seed'])
    return '\n\n'.join(
        [*opening('Sides and thickness of the gel', result, about), table(heads, rows), reached(AIMS, result)]
    )


def _row(entry: Mapping[str, Any]) -> list[str]:
    tips, contacts = entry['tips'], entry['contacts']
    return [
        entry['sides'], entry['described'], f'{entry["thickness"]:g}', str(entry['presses'] or 'none'),
        f'{1e3 * tips["rmse_n"]:.1f}',
        f'{1e3 * tips["force_n"]:.1f}', f'{tips["place_mm"]:.3f}', share(contacts['misplaced']),
        f'{contacts["total_rms_n"]:.3f}', share(contacts['total_median']), f'{contacts["centre_mm_median"]:.3f}',
        share(contacts['shear_median']), share(contacts['total_held']), share(contacts['ok']),
        shown(contacts['worst_while_ok'], '{:.1f}'),
    ]  # fmt: skip


def _of(result: Mapping[str, Any], sides: str) -> Mapping[str, Any]:
    """The calibrated gel with these sides in its description."""
    return next(
        each for each in result['rows'] if each['sides'] == each['described'] == sides and each['presses']
    )  # fmt: skip


def _times(part: str, name: str, most: float) -> Any:
    """A function for the error of each gel with sides as a multiple of that without."""

    def multiples(result: Mapping[str, Any]) -> dict[str, str]:
        own = _of(result, IGNORED)[part][name]
        found = {sides: _of(result, sides)[part][name] / own for sides in SIDES}
        return {
            sides: f'{each:.2f}' + ('' if each <= most else ', **not reached**') for sides, each in found.items()
        }  # fmt: skip

    return multiples


AIMS = (
    Aim('force of tips, RMSE, over that without sides', f'at most {TIMES:g}', _times('tips', 'rmse_n', TIMES)),
    Aim(
        'misplaced force, over that without sides',
        f'at most {TIMES_MISPLACED:g}',
        _times('contacts', 'misplaced', TIMES_MISPLACED),
    ),
)

BENCHMARK = Benchmark(
    name='sides',
    about=__doc__,
    sources=(
        'benchmarks/sides.py', 'benchmarks/contacts/**', 'benchmarks/stability/chain.py',
        'tactile_nodes/learning/**', 'tactile_nodes/sensors/**', *SENSING, *SIMULATED,
    ),
    page=page,
    measure=measure,
    tasks=True,
    seed=SEED,
    arguments=(
        argument(
            '--each', type=int, default=PER_FAMILY, metavar='N', help=f'contacts of each family (default: {PER_FAMILY})'
        ),
        argument(
            '--presses', type=int, default=PRESSES, metavar='N', help=f'presses to calibrate (default: {PRESSES})'
        ),
        argument('--tips', type=int, default=TIPS, metavar='N', help=f'tips to estimate (default: {TIPS})'),
    ),
    example="""\
examples:
  tactile bench sides -o docs/results
  tactile bench sides --each 1 --tips 20    # a few contacts, to see that it runs""",
)  # fmt: skip
