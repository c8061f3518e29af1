"""``tactile dataset``: training sets from the bags of a collection."""

from __future__ import annotations

import argparse
import dataclasses
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from tactile_nodes.cli.session import Verbs

if TYPE_CHECKING:
    from tactile_nodes.learning.config import Choice
    from tactile_nodes.learning.datasets.recordings import RecordedPresses
    from tactile_nodes.learning.recorded.building import BuildOptions

DESCRIPTION = 'Make a training set of the bags of a collection, and say what it holds.'
EPILOG = """\
examples:
  tactile dataset build collected_1 collected_2 -o presses.npz --gel gel-7
  tactile dataset build collected_1 -o presses.npz --profile portable
  tactile dataset build collected_1 -o presses.npz --flow dis --encoding cartesian_mean --rows 20 --cols 20
  tactile dataset info presses.npz --picture presses.png
  tactile dataset build new_gel_bag -o new_gel.npz --profile portable --frames each    # for tactile calibrate
  tactile train --dataset presses.npz -o gel-7.safetensors
"""
FRAMES = ('mean', 'first', 'each')
LIMITS = {
    'max_force_rate': ('force_rate_n_per_s', 'N/s', 'leave out presses whose force changed faster in the window'),
    'max_deviation': ('force_deviation_n', 'N', 'leave out presses whose force spread more in the window'),
    'max_depth_error': ('depth_error_mm', 'MM', 'leave out presses that were that far from the depth commanded'),
    'max_force': ('largest_force_n', 'N', 'leave out presses with more force'),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of the verb."""
    verbs = Verbs(parser)
    _add_build(verbs.add('build', _build, 'make a data set of bags'))
    info = verbs.add('info', _info, 'say what a data set holds')
    info.add_argument('file', type=Path, help='a data set')
    info.add_argument(
        '--picture', type=Path, metavar='FILE.png', help='draw coverage, force over depth, forces, a label'
    )
    info.add_argument('--left-out', action='store_true', help='list every attempt that was left out')


def _add_build(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('bags', nargs='+', type=Path, metavar='BAG', help='a bag of a collection')
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='FILE', help='the file to write (.npz)')
    parser.add_argument('--gel', default='', help='name of the gel, or the YAML file of a simulated one')
    parser.add_argument(
        '--profile', default='fast', metavar='NAME',
        help='flow and features of a run in config/train: fast, portable, paper, ... (default: fast)',
    )  # fmt: skip
    parser.add_argument('--flow', metavar='NAME', help='how motion is measured, if not as in the profile')
    parser.add_argument('--flow-options', nargs='+', default=[], metavar='NAME=VALUE', help='options of the flow')
    parser.add_argument('--encoding', metavar='NAME', help='how motion is summed up, if not as in the profile')
    parser.add_argument('--rows', type=int, help='regions of the image along y, if not as in the profile')
    parser.add_argument('--cols', type=int, help='regions of the image along x, if not as in the profile')
    parser.add_argument('--bins', default='9x9', metavar='ROWSxCOLS', help='bins of the labels (default: 9x9)')
    parser.add_argument('--surface', default='32x32', metavar='MMxMM', help='what the bins divide (default: 32x32)')
    parser.add_argument('--crop', type=int, default=440, metavar='PX', help='side of the images (default: 440)')
    parser.add_argument(
        '--frames', choices=FRAMES, default='first',
        help='which images of a window are measured; for calibrations: each (default: first)',
    )  # fmt: skip
    parser.add_argument(
        '--without-contact', type=float, default=0.05, metavar='SHARE',
        help='share of samples of the untouched gel, where the bags hold such images (default: 0.05)',
    )  # fmt: skip
    parser.add_argument('--separate-runs', action='store_true', help='bags of one plan are runs, not one run resumed')
    parser.add_argument('--namespace', help='of the sensor, if the bags hold several')
    parser.add_argument(
        '--reference-clock',
        metavar='RECORDER',
        help='recorder whose clock the others are brought to (default: the machine)',
    )
    for name, (_, unit, line) in LIMITS.items():
        parser.add_argument(f'--{name.replace("_", "-")}', type=float, metavar=unit, help=line)


def run(arguments: argparse.Namespace) -> int:
    """Do what the second word says."""
    status: int = arguments.action(arguments)
    return status


def _build(arguments: argparse.Namespace) -> int:
    from tactile_nodes.learning.datasets.file import save_dataset
    from tactile_nodes.learning.datasets.report import report
    from tactile_nodes.learning.progress import TerminalProgress
    from tactile_nodes.learning.recorded.building import build
    from tactile_nodes.paths import check_output

    check_output(arguments.output, *arguments.bags)
    progress = TerminalProgress()
    command = shlex.join(['tactile', *sys.argv[1:]])
    try:
        presses = build(arguments.bags, build_options(arguments), progress, command=command)
    except KeyboardInterrupt:
        progress.say('stopped; what was measured is kept, and the same command goes on from there')
        raise
    save_dataset(arguments.output, presses)
    print(report(presses))
    _point_to_the_list(presses, arguments.output)
    return 0


def _point_to_the_list(presses: RecordedPresses, file: Path) -> None:
    if presses.card['left_out']:
        print(f'each of them: tactile dataset info {file} --left-out')


def _info(arguments: argparse.Namespace) -> int:
    from tactile_nodes.learning.datasets.file import load_dataset
    from tactile_nodes.learning.datasets.report import left_out_table, report

    presses = load_dataset(arguments.file)
    print(report(presses))
    if arguments.left_out:
        print(left_out_table(presses.card['left_out'], presses.card['bag_names']))
    if arguments.picture:
        from tactile_nodes.learning.datasets.picture import draw

        draw(presses, arguments.picture)
        print(f'drawn: {arguments.picture}')
    return 0


def build_options(arguments: argparse.Namespace) -> BuildOptions:
    """The options that the command line says.

    Raises:
        ConfigurationError: one of them cannot be used.
    """
    from tactile_nodes.errors import ConfigurationError
    from tactile_nodes.learning.datasets.labels import parse_bins
    from tactile_nodes.learning.recorded.building import BuildOptions, gel_told
    from tactile_nodes.learning.recorded.exclusions import Limits

    if not 0 <= arguments.without_contact <= 0.5:
        raise ConfigurationError(f'--without-contact is a share between 0 and 0.5, got {arguments.without_contact}')
    given = {field: value for name, (field, *_) in LIMITS.items() if (value := getattr(arguments, name)) is not None}
    flow, encoding = _choices(arguments)
    return BuildOptions(
        flow=flow,
        encoding=encoding,
        bins=parse_bins(arguments.bins, arguments.surface),
        frames=arguments.frames,
        without_contact=arguments.without_contact,
        limits=dataclasses.replace(Limits(), **given),
        gel=gel_told(arguments.gel),
        crop=arguments.crop,
        separate_runs=arguments.separate_runs,
        namespace=arguments.namespace,
        reference_clock=arguments.reference_clock,
    )


def _choices(arguments: argparse.Namespace) -> tuple[Choice, Choice]:
    """Flow and features: the profile's, with what the command line changes."""
    from tactile_nodes import paths
    from tactile_nodes.errors import ConfigurationError
    from tactile_nodes.learning.config import Choice, load_train_config

    profile = load_train_config(paths.share_directory() / 'config' / 'train' / f'{arguments.profile}.yaml')
    flow, encoding = profile.flow, profile.encoding
    if arguments.flow and arguments.flow != flow.name:
        flow = Choice(arguments.flow)
    if arguments.encoding and arguments.encoding != encoding.name:
        encoding = Choice(arguments.encoding, encoding.options)
    asked = {'rows': arguments.rows, 'cols': arguments.cols}
    given = {name: value for name, value in asked.items() if value is not None}
    if min([*given.values(), arguments.crop]) < 1:
        raise ConfigurationError('--rows, --cols and --crop must be at least 1')
    regions = {**encoding.options, **given}
    patches = regions if flow.name == 'inverse_compositional' else {}
    return (
        Choice(flow.name, {**flow.options, **patches, **_flow_options(arguments.flow_options)}),
        Choice(encoding.name, regions),
    )


def _flow_options(words: list[str]) -> dict[str, object]:
    from tactile_nodes.errors import ConfigurationError
    from tactile_nodes.params import parse_scalar

    options: dict[str, object] = {}
    for text in words:
        name, equals, value = text.partition('=')
        if not equals:
            raise ConfigurationError(f'{text!r} is no option of the flow; write NAME=VALUE, for example preset=medium')
        options[name] = parse_scalar(value)
    return options
