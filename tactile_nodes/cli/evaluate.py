"""``tactile evaluate``: score a force model on presses that it never saw, simulated or recorded."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tactile_nodes.learning.evaluate import Evaluation

DESCRIPTION = 'Score a model at continuous random places and depths, with the metrics of the paper and more.'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of the verb."""
    parser.add_argument('model', type=Path, help='a model file')
    parser.add_argument('--presses', type=int, default=2000, metavar='N', help='presses to score (default: 2000)')
    parser.add_argument('--seed', type=int, default=1001, metavar='S', help='seed of the presses (default: 1001)')
    parser.add_argument('--dataset', type=Path, metavar='FILE', help='score recorded presses instead of simulated ones')
    parser.add_argument(
        '--split', choices=('sample', 'position'), help='which test set of FILE (default: what the training put aside)'
    )
    parser.add_argument('--json', type=Path, metavar='FILE', help='also write the scores as JSON')


def run(arguments: argparse.Namespace) -> int:
    """Print the table of scores."""
    from tactile_nodes.errors import ConfigurationError
    from tactile_nodes.learning.evaluate import table

    if arguments.presses < 1:
        raise ConfigurationError(f'--presses must be at least 1, got {arguments.presses}')
    scores = _scores(arguments)
    print(table(scores))
    if arguments.json:
        arguments.json.write_text(json.dumps(scores.as_dict(), indent=2) + '\n', encoding='utf-8')
    return 0


def _scores(arguments: argparse.Namespace) -> Evaluation:
    from tactile_nodes.errors import ConfigurationError
    from tactile_nodes.learning.evaluate import evaluate, evaluate_recorded
    from tactile_nodes.learning.progress import TerminalProgress

    if arguments.dataset:
        return evaluate_recorded(arguments.model, arguments.dataset, split=arguments.split)
    if arguments.split:
        raise ConfigurationError('--split says which part of recorded presses to score; give them with --dataset FILE')
    return evaluate(arguments.model, presses=arguments.presses, seed=arguments.seed, progress=TerminalProgress())
