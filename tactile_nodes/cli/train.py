"""``tactile train``: make a force model from simulated or recorded presses."""

from __future__ import annotations

import argparse
import dataclasses
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tactile_nodes.learning.config import TrainConfig

DESCRIPTION = (
    'Train a force model on presses of the simulated gel, or recorded ones. Ctrl-C keeps the best network so far.'
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of the verb."""
    parser.add_argument('config', nargs='?', type=Path, help='a run as YAML (default: paper, or recorded)')
    parser.add_argument('-o', '--output', type=Path, metavar='FILE', help='model file to write')
    parser.add_argument('--presses', type=int, metavar='N', help='number of presses to simulate')
    parser.add_argument('--seed', type=int, metavar='S', help='seed of the presses and of the training')
    parser.add_argument('--dataset', type=Path, metavar='FILE', help='train on recorded presses; see tactile dataset')
    parser.add_argument('--split', choices=('sample', 'position'), help='what to put aside of FILE for the test')


def run(arguments: argparse.Namespace) -> int:
    """Train as the arguments say; 0 when the model is written."""
    from tactile_nodes.learning.progress import TerminalProgress
    from tactile_nodes.learning.train import import_torch, train

    import_torch()  # before any press is rendered
    config = chosen_config(arguments)
    train(config, progress=TerminalProgress(), command=shlex.join(['tactile', *sys.argv[1:]]))
    return 0


def chosen_config(arguments: argparse.Namespace) -> TrainConfig:
    """The configuration file with what the command line changes."""
    from tactile_nodes import paths
    from tactile_nodes.errors import ConfigurationError
    from tactile_nodes.learning.config import load_train_config

    default = 'recorded.yaml' if arguments.dataset else 'paper.yaml'
    config = load_train_config(arguments.config or paths.share_directory() / 'config' / 'train' / default)
    if arguments.presses is not None and arguments.presses < 20:
        raise ConfigurationError(f'--presses must be at least 20, got {arguments.presses}')
    config = _with_file(config, arguments)
    if arguments.presses is not None and config.data.file:
        raise ConfigurationError('--presses says how many presses to simulate; a data set holds what it holds')
    if arguments.output is not None:
        config = dataclasses.replace(config, output=arguments.output)
    if arguments.presses is not None:
        config = dataclasses.replace(config, data=dataclasses.replace(config.data, presses=arguments.presses))
    if arguments.seed is not None:
        data = dataclasses.replace(config.data, seed=arguments.seed)
        training = dataclasses.replace(config.training, seed=arguments.seed)
        config = dataclasses.replace(config, data=data, training=training)
    return config


def _with_file(config: TrainConfig, arguments: argparse.Namespace) -> TrainConfig:
    from tactile_nodes.errors import ConfigurationError

    data = config.data
    if arguments.dataset is not None:
        data = dataclasses.replace(data, file=str(arguments.dataset))
    if arguments.split is not None:
        if not data.file:
            raise ConfigurationError('--split says how to part recorded presses; give them with --dataset FILE')
        data = dataclasses.replace(data, split=arguments.split)
    return dataclasses.replace(config, data=data)
