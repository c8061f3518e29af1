"""``tactile tune``: the smallest configuration that is accurate or fast enough on this machine and on your presses."""

from __future__ import annotations

import argparse
import dataclasses
import os
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from tactile_nodes.cli.dataset import methods
from tactile_nodes.cli.running import cluster

if TYPE_CHECKING:
    from tactile_nodes.learning.config import TrainConfig
    from tactile_nodes.learning.tuning.search import RecordedSource, SimulatedSource

DESCRIPTION = (
    'Compare flow methods, scales, grids and readouts on the same presses, and write the smallest one that meets the '
    'requirement: a model for the live node, and the run that trains it again. Presses come from the bags of a '
    'collection, or from the simulator. A data set (.npz) cannot be used: it holds the features of one flow and grid, '
    'not images. Times are CPU times per frame in contact, on one thread of this machine, with compiled loops if numba '
    'is installed, as in the nodes.'
)
EPILOG = """\
examples:
  tactile tune --max-error 0.01 -o small.safetensors             simulated: the fastest with an aRMSE of at most 0.01 N
  tactile tune collected_1 collected_2 --max-ms 0.8 -o mine.safetensors    your gel: the most accurate within 0.8 ms
  tactile tune collected_1 --max-error 0.01 --metric total_rmse_n -o mine.safetensors
  tactile tune collected_1 --sensor mine.yaml --max-ms 0.8 -o tuned.safetensors    bins and crop of your own sensor
  tactile tune --train my_gel.yaml --presses 4000 --max-ms 1.5 -o mine.safetensors
  tactile launch live model:=mine.safetensors                    flow and grid come from the model
  tactile train mine.yaml                                        train the same again, or with more presses
"""
SIMULATED_PRESSES = 1500


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('bags', nargs='*', type=Path, metavar='BAG', help='bags of a collection (default: simulate)')
    parser.add_argument('--max-error', type=float, metavar='E', help='choose the fastest with at most this error')
    parser.add_argument(
        '--max-ms', type=float, metavar='MS', help='choose the most accurate within this CPU time per frame'
    )
    parser.add_argument(
        '--metric', default='armse_n', choices=('armse_n', 'rmse_mc_n', 'd_loc_mm', 'total_rmse_n'),
        help='the error to compare, on held-out presses (default: armse_n, the paper\'s, in N)',
    )  # fmt: skip
    parser.add_argument(
        '-o', '--output', type=Path, required=True, metavar='FILE', help='model to write (.safetensors)'
    )
    parser.add_argument(
        '--train', type=Path, metavar='RUN.yaml', help='training run with all other settings: gel, plan, split'
    )
    parser.add_argument('--presses', type=int, metavar='N', help=f'presses to simulate (default: {SIMULATED_PRESSES})')
    parser.add_argument('--only', metavar='TEXT', help='try only configurations whose name contains this, e.g. "ours"')
    parser.add_argument('--gel', default='', help='name of the gel in the bags, or the YAML file of a simulated one')
    methods.add_without_contact(parser)
    parser.add_argument('--sensor', metavar='YAML', help='sensor description: crop, bins and picture size')
    parser.add_argument('--namespace', help='namespace of the sensor, if the bags hold several')
    cluster.add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    # Before numpy is imported: the live node also runs with one linear-algebra thread.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    from tactile_nodes.errors import ConfigurationError
    from tactile_nodes.learning.progress import TerminalProgress
    from tactile_nodes.learning.tasks import on_cluster
    from tactile_nodes.learning.tuning.search import (
        RecordedSource,
        Wish,
        candidates,
        files_of,
        said_of,
        table_of,
        tune,
        write_profile,
    )
    from tactile_nodes.paths import check_output

    wish = Wish(arguments.max_error, arguments.max_ms, arguments.metric)
    among = [each for each in candidates() if arguments.only is None or arguments.only in each.name]
    if not among:
        names = ', '.join(each.name for each in candidates())
        raise ConfigurationError(f'no configuration name contains {arguments.only!r}; available: {names}')
    described = [Path(each) for each in (arguments.gel, arguments.sensor) if each]
    for file in files_of(arguments.output, recorded=bool(arguments.bags)):
        check_output(file, *arguments.bags, arguments.train, *described)
    command, progress = shlex.join(['tactile', *sys.argv[1:]]), TerminalProgress()
    source = _source(arguments)
    with on_cluster(arguments.on):
        tuned = tune(source, wish, progress, command, among)
    print(table_of(tuned).markdown())
    presses = None
    if isinstance(source, RecordedSource):
        presses = source.presses(tuned.chosen.candidate, progress, command)
    files = write_profile(tuned.chosen, arguments.output, command, presses)
    print(f'\n{said_of(tuned, arguments.metric)}\nwritten: {", ".join(map(str, files))}')
    return 0


def _source(arguments: argparse.Namespace) -> SimulatedSource | RecordedSource:
    from tactile_nodes.errors import ConfigurationError
    from tactile_nodes.learning.recorded.building import BuildOptions, gel_entry
    from tactile_nodes.learning.tuning.search import RecordedSource, SimulatedSource

    if data_sets := [path for path in arguments.bags if path.suffix == '.npz']:
        raise ConfigurationError(
            f'{data_sets[0]} is a data set, which holds features of one flow and one grid, not images; give the bags '
            'that it was built from'
        )
    base = _base(arguments)
    if not arguments.bags:
        if given := [name for name in ('gel', 'sensor', 'namespace') if getattr(arguments, name)]:
            raise ConfigurationError(f'--{given[0]} is for bags; the gel to simulate stands in the run of --train')
        return SimulatedSource(base)
    if arguments.on:
        raise ConfigurationError(f'--on {cluster.PURPOSE}; it cannot be used with bags')
    if arguments.presses is not None:
        raise ConfigurationError('--presses is the number of presses to simulate; it cannot be used with bags')
    options = BuildOptions(
        bins=base.bins, gel=gel_entry(arguments.gel), namespace=arguments.namespace, crop=base.data.crop,
        without_contact=arguments.without_contact,
    )  # fmt: skip
    return RecordedSource(arguments.bags, methods.of_sensor(options, arguments.sensor), base)


def _base(arguments: argparse.Namespace) -> TrainConfig:
    from tactile_nodes.errors import ConfigurationError
    from tactile_nodes.learning.config import load_train_config

    config = load_train_config(arguments.train or ('recorded' if arguments.bags else 'fast'))
    # The tried configurations replace the flow and features of the run, so they are removed from it.
    config = dataclasses.replace(config, stated=frozenset())
    if arguments.presses is not None and arguments.presses < 20:
        raise ConfigurationError(f'--presses must be at least 20, got {arguments.presses}')
    presses = SIMULATED_PRESSES if arguments.presses is None and arguments.train is None else arguments.presses
    data = config.data if presses is None else dataclasses.replace(config.data, presses=presses)
    if arguments.train is None:  # the validation set decides here; a tenth of few presses would be too noisy
        config = dataclasses.replace(config, training=dataclasses.replace(config.training, validation=0.2))
    return dataclasses.replace(config, data=data)
