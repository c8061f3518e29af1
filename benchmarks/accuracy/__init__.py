"""Compare models: accuracy, stated uncertainty, speed and size.

All models get the same simulated presses (same places, depths and images), each with its own flow and features, one
frame at a time as in the live node. Times are interleaved, so that other load on the machine affects all models alike.
Ratios are between the medians of the same round.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks import PROFILES
from benchmarks.accuracy.page import Results, draw, page
from benchmarks.harness.declaration import SENSING, SIMULATED, Benchmark, Result, argument
from benchmarks.harness.running import Run
from tactile_nodes.errors import ConfigurationError

if TYPE_CHECKING:
    from tactile_nodes.learning.progress import Progress
    from tactile_nodes.model_file import LoadedModel

SEED = 1001


@dataclass(frozen=True)
class Plan:
    """The amount of measurements: presses off the grid, and rounds of images for the times."""

    presses: int = 2000
    rounds: int = 15
    images: int = 12


QUICK = Plan(presses=24, rounds=2, images=2)


def measured(arguments: argparse.Namespace, run: Run) -> Result:
    """Measure the named models, or those of the paper's sensor that ship."""
    curve = _files(arguments.curve) if arguments.curve else []
    found = measure(_files(arguments.model), curve, _plan(arguments), run.progress)
    return {**found.plain, '_page': found}


def measure(models: Sequence[Path], curve: Sequence[Path], plan: Plan, progress: Progress) -> Results:
    """All scores and times.

    Raises:
        ModelError: a model cannot be used, or was trained on the test presses.
    """
    from benchmarks.accuracy.times import stage_times
    from tactile_nodes.learning.evaluation.evaluate import evaluate, evaluate_put_aside
    from tactile_nodes.model_file import load_model

    loaded = {file.stem: load_model(file) for file in models}
    off_grid = [evaluate(file, presses=plan.presses, seed=SEED, progress=progress) for file in models]
    grid = _grid_model(models, loaded)
    aside = [evaluate_put_aside(file, of=grid, progress=progress) for file in models] if grid else []
    along = [evaluate(file, presses=plan.presses, seed=SEED, progress=progress) for file in curve]
    plain = {
        'plan': asdict(plan),
        'models': {name: about(each) for name, each in loaded.items()},
        'off_grid': [each.as_dict() for each in off_grid],
        'put_aside': [each.as_dict() for each in aside],
        'curve': [{**about(load_model(file)), **each.as_dict()} for file, each in zip(curve, along, strict=True)],
        'times_ms': stage_times(loaded, plan.rounds, plan.images),
    }
    return Results(plain, off_grid, aside, along)


def about(loaded: LoadedModel) -> dict[str, Any]:
    """The entries of a model's card for the tables of accuracy."""
    card = loaded.card
    data, training = card['data'], card.get('training', {})
    return {
        'model_id': loaded.model_id,
        'readout': loaded.model.readout.kind,
        'parameters': loaded.model.readout.parameter_count,
        'training_s': training.get('seconds'),
        'device': training.get('device'),
        'plan': data.get('plan', 'random'),
        'presses': collected(data),
        'flow': card['flow']['name'],
        'features': str(loaded.model.layout),
        'command': card.get('command', ''),
    }


def collected(data: Mapping[str, Any]) -> int:
    """Number of presses that a rig must make for a model's data, including those set aside."""
    if data.get('plan', 'random') == 'random':
        return round(float(data['presses']) * (1 - float(data['without_contact'])))
    from tactile_nodes.learning.datasets.plans import DEPTHS, PLACES

    return min(int(data['presses']), PLACES * PLACES * DEPTHS)


def _plan(arguments: argparse.Namespace) -> Plan:
    plan = QUICK if arguments.quick else Plan()
    presses = plan.presses if arguments.presses is None else arguments.presses
    return Plan(presses, plan.rounds, plan.images)


def _files(names: Sequence[str]) -> list[Path]:
    from tactile_nodes.model_file import find_model

    files = [find_model(name) for name in names or PROFILES]
    if len({file.stem for file in files}) < len(files):
        raise ConfigurationError('two models have the same file name, by which tables call them; rename one')
    return files


def _grid_model(models: Sequence[Path], loaded: Mapping[str, LoadedModel]) -> Path | None:
    """The first model that was trained on the paper's grid and set a part of it aside."""
    for file in models:
        data = loaded[file.stem].card['data']
        if data.get('plan') == 'paper' and 'split_id' in data:
            return file
    return None


BENCHMARK = Benchmark(
    name='accuracy',
    about=__doc__,
    sources=('benchmarks/accuracy/**', 'tactile_nodes/learning/evaluation/**', *SENSING, *SIMULATED),
    page=page,
    measure=measured,
    draw=draw,
    quick=True,
    more_than_json=True,
    files=(
        'accuracy.json', 'accuracy.md',
        *(f'accuracy_{of}.png' for of in ('paper', 'fast', 'portable', 'field', 'presses')),
    ),
    arguments=(
        argument('model', nargs='*', help='model files, or names of models that ship (default: all that ship)'),
        argument(
            '--curve', nargs='+', default=[], metavar='MODEL',
            help='models trained with different plans and numbers of presses, for the chart of error against presses',
        ),
        argument('--presses', least=1, type=int, metavar='N', help='presses off the grid (default: 2000)'),
    ),
)  # fmt: skip
