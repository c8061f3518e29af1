"""``tactile evaluate``: score force models on simulated or recorded presses that were not used for training."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from tactile_nodes.cli.running import cluster
from tactile_nodes.cli.running.session import count

if TYPE_CHECKING:
    from tactile_nodes.learning.evaluation.evaluate import Evaluation

DESCRIPTION = (
    'Score models at continuous random positions and depths: metrics of the paper, position and force errors, light '
    'touches, and the calibration of the stated uncertainties.'
)
EPILOG = """\
examples:
  tactile evaluate paper fast portable                     several side by side
  tactile evaluate fast --picture fast.png --json fast.json
  tactile evaluate gel-7.safetensors --dataset presses.npz  on the recorded presses held out by the training
  tactile evaluate gel-7.safetensors --dataset presses.npz --table told.csv  press by press
"""
PRESSES, SEED, MOST_PRESSES = 2000, 1001, 1_000_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('model', nargs='+', help='model files, or names of shipped models; several are compared')
    parser.add_argument('--presses', type=int, metavar='N', help=f'presses to score (default: {PRESSES})')
    parser.add_argument('--seed', type=count, metavar='S', help=f'seed of the presses (default: {SEED})')
    parser.add_argument(
        '--put-aside', nargs='?', const='', metavar='MODEL',
        help='score the presses of the simulated grid that the training of MODEL held out (the same for all models)',
    )  # fmt: skip
    parser.add_argument('--dataset', type=Path, metavar='FILE', help='score recorded presses instead of simulated ones')
    parser.add_argument(
        '--split', choices=('sample', 'position'), help='which test set of FILE (default: the held-out one)'
    )
    parser.add_argument('--picture', type=Path, metavar='FILE.png', help='also draw error maps and curves')
    parser.add_argument('--table', type=Path, metavar='FILE.csv', help='also write estimate and truth of each sample')
    parser.add_argument('--json', type=Path, metavar='FILE', help='also write the scores as JSON')
    cluster.add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    from tactile_nodes.learning.evaluation.tables import report
    from tactile_nodes.learning.tasks import on_cluster
    from tactile_nodes.paths import write_whole

    _check(arguments)
    with on_cluster(arguments.on):
        evaluated = _distinct([_evaluated(name, arguments) for name in arguments.model])
    print(report(evaluated))
    if arguments.json:
        scores = [each.as_dict() for each in evaluated]
        written = json.dumps(scores[0] if len(scores) == 1 else scores, indent=2)
        write_whole(arguments.json, f'{written}\n'.encode())
    for each in evaluated if arguments.table else ():
        _tell(each, _named(arguments.table, each, evaluated))
    if arguments.picture:
        _draw(evaluated, arguments.picture)
    return 0


def _check(arguments: argparse.Namespace) -> None:
    from tactile_nodes.errors import ConfigurationError
    from tactile_nodes.paths import check_output

    for output in filter(None, (arguments.json, arguments.table, arguments.picture)):
        check_output(output, arguments.dataset, *map(Path, arguments.model))
    if arguments.presses is not None and not 1 <= arguments.presses <= MOST_PRESSES:
        raise ConfigurationError(f'--presses must be from 1 to {MOST_PRESSES}')
    for name in ('presses', 'seed'):
        if getattr(arguments, name) is not None and (arguments.dataset or arguments.put_aside is not None):
            raise ConfigurationError(f'--{name} is for random simulated presses; a held-out set is scored as a whole')
    if arguments.dataset and arguments.put_aside is not None:
        raise ConfigurationError('--put-aside is for simulated presses; --dataset FILE scores held-out presses anyway')
    if arguments.on and arguments.dataset:
        raise ConfigurationError(f'--on {cluster.PURPOSE}; it cannot be used with a data set')
    if arguments.split and not arguments.dataset:
        raise ConfigurationError('--split chooses a part of recorded presses; give them with --dataset FILE')


def _evaluated(name: str, arguments: argparse.Namespace) -> Evaluation:
    from tactile_nodes.learning.evaluation.evaluate import evaluate, evaluate_put_aside, evaluate_recorded
    from tactile_nodes.learning.progress import TerminalProgress
    from tactile_nodes.model_file import find_model

    model, progress = find_model(name), TerminalProgress()
    if arguments.dataset:
        return evaluate_recorded(model, arguments.dataset, split=arguments.split)
    if arguments.put_aside is not None:
        of = find_model(arguments.put_aside) if arguments.put_aside else None
        return evaluate_put_aside(model, of=of, progress=progress)
    given = {name: value for name in ('presses', 'seed') if (value := getattr(arguments, name)) is not None}
    return evaluate(model, progress=progress, **given)


def _distinct(evaluated: list[Evaluation]) -> list[Evaluation]:
    """The same, with the id in the names of models whose files have the same name."""
    often = Counter(each.name for each in evaluated)
    return [replace(each, name=f'{each.name}_{each.model_id}') if often[each.name] > 1 else each for each in evaluated]


def _named(file: Path, one: Evaluation, evaluated: list[Evaluation]) -> Path:
    """A file name for each of several models."""
    return file if len(evaluated) == 1 else file.with_name(f'{file.stem}_{one.name}{file.suffix}')


def _tell(evaluated: Evaluation, table: Path) -> None:
    from tactile_nodes.learning.evaluation.tables import write_estimates

    write_estimates(evaluated.answers, table)
    print(f'wrote {table}: estimates of {evaluated.name} for {len(evaluated.answers)} samples')


def _draw(evaluated: list[Evaluation], picture: Path) -> None:
    from tactile_nodes.learning.evaluation.picture import draw

    for each in evaluated:
        name = _named(picture, each, evaluated)
        draw(each.answers, f'{each.name} ({each.model_id})', name)
        print(f'wrote {name}: figure of {each.name}')
