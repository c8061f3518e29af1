"""``tactile dataset build``: a data set from the bags of a collection."""

from __future__ import annotations

import argparse
import dataclasses
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from tactile_nodes.cli.dataset import methods

if TYPE_CHECKING:
    from tactile_nodes.learning.recorded.building import BuildOptions

LIMITS = {
    'max_force_rate': ('force_rate_n_per_s', 'N/s', 'leave out presses whose force changed faster in the window'),
    'max_deviation': ('force_deviation_n', 'N', 'leave out presses whose force spread more in the window'),
    'max_depth_error': ('depth_error_mm', 'MM', 'leave out presses with a larger error from the commanded depth'),
    'max_force': ('largest_force_n', 'N', 'leave out presses with a larger force'),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('bags', nargs='+', type=Path, metavar='BAG', help='a bag of a collection')
    methods.add_arguments(parser)
    methods.add_without_contact(parser)
    parser.add_argument(
        '--separate-runs', action='store_true', help='bags of one plan are separate runs, not one resumed run'
    )
    parser.add_argument('--namespace', help='namespace of the sensor, if the bags hold several')
    parser.add_argument(
        '--reference-clock',
        metavar='RECORDER',
        help='recorder whose clock the others are converted to (default: the machine)',
    )
    for name, (_, unit, line) in LIMITS.items():
        parser.add_argument(f'--{name.replace("_", "-")}', type=float, metavar=unit, help=line)


def run(arguments: argparse.Namespace) -> int:
    from tactile_nodes.learning.progress import TerminalProgress
    from tactile_nodes.learning.recorded.building import build

    methods.require_output(arguments, *arguments.bags)
    progress = TerminalProgress()
    command = shlex.join(['tactile', *sys.argv[1:]])
    with methods.resumable(progress):
        presses = build(arguments.bags, build_options(arguments), progress, command=command)
    return methods.written(presses, arguments.output)


def build_options(arguments: argparse.Namespace) -> BuildOptions:
    """The options given on the command line.

    Raises:
        ConfigurationError: one of them cannot be used.
    """
    from tactile_nodes.learning.recorded.exclusions import Limits

    given = {field: value for name, (field, *_) in LIMITS.items() if (value := getattr(arguments, name)) is not None}
    return dataclasses.replace(
        methods.method_options(arguments),
        without_contact=arguments.without_contact,
        limits=dataclasses.replace(Limits(), **given),
        separate_runs=arguments.separate_runs,
        namespace=arguments.namespace,
        reference_clock=arguments.reference_clock,
    )
