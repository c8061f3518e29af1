"""What both ways to a data set ask: how pictures are measured, what is cut from them, and the bins of the labels."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tactile_nodes.learning.config import Choice
    from tactile_nodes.learning.datasets.recordings import RecordedPresses
    from tactile_nodes.sensing.geometry import BinGrid

FRAMES = ('mean', 'first', 'each')
CROP, BINS, SURFACE = 440, '9x9', '32x32'
OWN = 'profile', 'flow', 'flow_options', 'encoding', 'rows', 'cols', 'bins', 'surface', 'crop', 'sensor'
"""What a model decides."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Their arguments."""
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='FILE', help='the file to write (.npz)')
    parser.add_argument('--gel', default='', help='name of the gel, or the YAML file of a simulated one')
    parser.add_argument(
        '--model', metavar='FILE', help='measure as this model does: flow, features, bins and crop (file or name)'
    )
    parser.add_argument('--sensor', metavar='YAML', help='description of the sensor: crop, bins and size of pictures')
    parser.add_argument(
        '--profile', metavar='NAME',
        help='flow and features of a run in config/train: fast, portable, paper, ... (default: fast)',
    )  # fmt: skip
    parser.add_argument('--flow', metavar='NAME', help='how motion is measured, if not as in the profile')
    parser.add_argument('--flow-options', nargs='+', default=[], metavar='NAME=VALUE', help='options of the flow')
    parser.add_argument('--encoding', metavar='NAME', help='how motion is summed up, if not as in the profile')
    parser.add_argument('--rows', type=int, help='regions of the image along y, if not as in the profile')
    parser.add_argument('--cols', type=int, help='regions of the image along x, if not as in the profile')
    parser.add_argument('--bins', metavar='ROWSxCOLS', help=f'bins of the labels (default: {BINS})')
    parser.add_argument('--surface', metavar='MMxMM', help=f'what the bins divide (default: {SURFACE})')
    parser.add_argument('--crop', type=int, metavar='PX', help=f'side of the images (default: {CROP})')
    parser.add_argument(
        '--frames', choices=FRAMES, default='first',
        help='which images of a window are measured; for calibrations: each (default: first)',
    )  # fmt: skip


def method_options(arguments: argparse.Namespace) -> dict[str, Any]:
    """`flow`, `encoding`, `bins`, `crop`, `frames` and `gel`, as `BuildOptions` takes them.

    Raises:
        ConfigurationError: one of them cannot be used, or goes beside another one.
        ModelError: there is no such model.
    """
    from tactile_nodes.learning.recorded.building import gel_told

    flow, encoding, bins, crop = (_of_model if arguments.model else _chosen)(arguments)
    told = {'flow': flow, 'encoding': encoding, 'bins': bins, 'crop': crop, 'frames': arguments.frames}
    return {**told, 'gel': gel_told(arguments.gel)}


Measuring = tuple['Choice', 'Choice', 'BinGrid', 'int | tuple[int, int]']


def _of_model(arguments: argparse.Namespace) -> Measuring:
    from tactile_nodes.errors import ConfigurationError
    from tactile_nodes.learning.config import Choice
    from tactile_nodes.model_file import find_model, load_model

    if given := [name for name in OWN if getattr(arguments, name)]:
        raise ConfigurationError(f'--{given[0].replace("_", "-")} does not go with --model, which decides it')
    loaded = load_model(find_model(arguments.model))
    return Choice(*loaded.flow), Choice(*loaded.encoding), loaded.model.bins, loaded.image_size


def _chosen(arguments: argparse.Namespace) -> Measuring:
    from tactile_nodes.errors import ConfigurationError
    from tactile_nodes.learning.datasets.labels import parse_bins
    from tactile_nodes.sensing.geometry import BinGrid
    from tactile_nodes.sensors import load_sensor

    flow, encoding = _choices(arguments)
    if not arguments.sensor:
        bins = parse_bins(arguments.bins or BINS, arguments.surface or SURFACE)
        return flow, encoding, bins, _at_least_one('crop', CROP if arguments.crop is None else arguments.crop)
    if given := [name for name in ('bins', 'surface', 'crop') if getattr(arguments, name)]:
        raise ConfigurationError(f'--{given[0]} does not go with --sensor, whose description says it')
    sensor = load_sensor(arguments.sensor)
    return flow, encoding, BinGrid.of_sensor(sensor), sensor.image.crop_px


def _choices(arguments: argparse.Namespace) -> tuple[Choice, Choice]:
    """Flow and features: the profile's, with what the command line changes."""
    from tactile_nodes import paths
    from tactile_nodes.learning.config import Choice, load_train_config

    profile = load_train_config(paths.share_directory() / 'config' / 'train' / f'{arguments.profile or "fast"}.yaml')
    flow, encoding = profile.flow, profile.encoding
    if arguments.flow and arguments.flow != flow.name:
        flow = Choice(arguments.flow)
    if arguments.encoding and arguments.encoding != encoding.name:
        encoding = Choice(arguments.encoding, encoding.options)
    asked = {'rows': arguments.rows, 'cols': arguments.cols}
    given = {name: _at_least_one(name, value) for name, value in asked.items() if value is not None}
    regions = {**encoding.options, **given}
    sides = {name: regions[name] for name in ('rows', 'cols')}
    patches = {'inverse_compositional': regions, 'dots': sides}.get(flow.name, {})
    return (
        Choice(flow.name, {**flow.options, **patches, **_flow_options(arguments.flow_options)}),
        Choice(encoding.name, regions),
    )


def _at_least_one(name: str, value: int) -> int:
    from tactile_nodes.errors import ConfigurationError

    if value < 1:
        raise ConfigurationError(f'--{name} must be at least 1, got {value}')
    return value


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


def written(presses: RecordedPresses, output: Path) -> int:
    """Write the file, and say what it holds."""
    from tactile_nodes.learning.datasets.file import save_dataset
    from tactile_nodes.learning.datasets.report import report

    save_dataset(output, presses)
    print(report(presses))
    if presses.card['left_out']:
        print(f'each of them: tactile dataset info {output} --left-out')
    return 0
