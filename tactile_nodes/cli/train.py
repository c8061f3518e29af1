"""``tactile train``: train a force model on simulated or recorded presses, and compare training runs."""

from __future__ import annotations

import argparse
import dataclasses
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactile_nodes.cli.running import cluster
from tactile_nodes.cli.running.session import count

if TYPE_CHECKING:
    from tactile_nodes.learning.config import TrainConfig

PLANS = 'random', 'paper', 'jittered', 'coarse', 'spread'
OF_SIMULATED = {
    'presses': 'is the number of presses to simulate',
    'plan': 'is the plan of simulated presses',
    'on': cluster.PURPOSE,
}
DESCRIPTION = (
    'Train a force model on presses of the simulated gel, or on recorded ones. Each run has a folder with its '
    'settings, curves and state. After an abort, the same command continues. Ctrl-C keeps the best network so far.'
)
EPILOG = """\
examples:
  tactile train config/train/quick.yaml          a small network in seconds, to try things out
  tactile train config/train/paper.yaml          the paper's plan, network and training; run it again to resume
  tactile train config/train/paper.yaml --dataset presses.npz -o my_gel.safetensors
                                                 the same on presses of a rig (see tactile dataset build)
  tactile train --dataset presses.npz --split position
  tactile train --compare runs/paper-* --picture curves.png
                                                 settings that differ, scores, and curves of several runs
  tensorboard --logdir runs                      the curves in a browser, if tensorboard is installed
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('config', nargs='?', type=Path, help='a run, YAML or its name (default: paper, or recorded)')
    parser.add_argument('-o', '--output', type=Path, metavar='FILE', help='model file to write')
    parser.add_argument('--presses', type=int, metavar='N', help='number of presses to simulate')
    parser.add_argument('--plan', choices=PLANS, help='where simulated presses lie')
    parser.add_argument('--seed', type=count, metavar='S', help='seed of the presses and of the training')
    parser.add_argument('--dataset', type=Path, metavar='FILE', help='train on recorded presses; see tactile dataset')
    parser.add_argument('--split', choices=('sample', 'position'), help='how to hold out the test set')
    parser.add_argument(
        '--device', choices=('auto', 'cpu', 'cuda'), help='where to train a network (auto: CUDA if there is one)'
    )
    parser.add_argument(
        '--runs', type=Path, default=Path('runs'), metavar='DIR', help='folder of the runs (default: runs)'
    )
    parser.add_argument('--fresh', action='store_true', help='discard earlier progress of this run')
    parser.add_argument(
        '--force',
        action='store_true',
        help='write the model even if it is no better on recorded presses than their mean',
    )
    parser.add_argument('--compare', nargs='+', type=Path, metavar='RUN', help='compare folders of runs; train nothing')
    parser.add_argument('--picture', type=Path, metavar='FILE.png', help='with --compare: also draw their curves')
    cluster.add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Train as the arguments say; 0 when the model was written."""
    if arguments.compare:
        return compare(arguments)
    from tactile_nodes.errors import ConfigurationError
    from tactile_nodes.learning.progress import TerminalProgress
    from tactile_nodes.learning.tasks import on_cluster
    from tactile_nodes.learning.training.train import train

    if arguments.picture:
        raise ConfigurationError('--picture draws the curves of runs; name them with --compare RUN RUN')
    with on_cluster(arguments.on):
        train(
            chosen_config(arguments),
            progress=TerminalProgress(),
            command=shlex.join(['tactile', *sys.argv[1:]]),
            runs=arguments.runs,
            fresh=arguments.fresh,
            forced=arguments.force,
        )
    return 0


def compare(arguments: argparse.Namespace) -> int:
    from tactile_nodes.learning.run.comparison import draw, table
    from tactile_nodes.learning.run.folder import read_run

    runs = [read_run(path) for path in arguments.compare]
    print(table(runs))
    if arguments.picture:
        draw(runs, arguments.picture)
        print(f'wrote {arguments.picture}')
    return 0


def chosen_config(arguments: argparse.Namespace) -> TrainConfig:
    """The configuration file with the changes from the command line."""
    from tactile_nodes.errors import ConfigurationError
    from tactile_nodes.learning.config import load_train_config

    config = load_train_config(arguments.config or ('recorded' if arguments.dataset else 'paper'))
    if arguments.presses is not None and arguments.presses < 20:
        raise ConfigurationError(f'--presses must be at least 20, got {arguments.presses}')
    data, training = dataclasses.replace(config.data, **_given(arguments, 'plan')), config.training
    if arguments.dataset is not None:
        data = dataclasses.replace(data, file=str(arguments.dataset))
    for option, text in OF_SIMULATED.items():
        if getattr(arguments, option) and data.file:
            raise ConfigurationError(f'--{option} {text}; it cannot be used with a data set')
    if arguments.device and config.readout != 'network':
        raise ConfigurationError(f'--device is for networks; the readout {config.readout} is fitted on the CPU')
    if arguments.split is not None and not data.file and data.plan == 'random':
        raise ConfigurationError(
            '--split needs recorded presses (--dataset FILE) or a simulated grid; random presses have no held-out set'
        )
    data = dataclasses.replace(data, **_given(arguments, 'presses', 'seed', 'split'))
    training = dataclasses.replace(training, **_given(arguments, 'seed', 'device'))
    readouts = {
        name: dataclasses.replace(getattr(config, name), **_given(arguments, 'seed'))
        for name in ('response', 'axisymmetric')
    }
    return dataclasses.replace(config, data=data, training=training, **readouts, **_given(arguments, 'output'))


def _given(arguments: argparse.Namespace, *names: str) -> dict[str, Any]:
    """The arguments that were given on the command line."""
    return {name: value for name in names if (value := getattr(arguments, name)) is not None}
