"""Arguments of both ways to build a data set: measurement of pictures, crop, and label bins."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tactile_nodes.learning.datasets.recordings import RecordedPresses
    from tactile_nodes.learning.progress import Progress
    from tactile_nodes.learning.recorded.building import BuildOptions

FRAMES = ('mean', 'first', 'each')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='FILE', help='the file to write (.npz)')
    parser.add_argument('--gel', default='', help='name of the gel, or the YAML file of a simulated one')
    parser.add_argument(
        '--model', metavar='FILE', help='use the flow, features, bins and crop of this model (file or name)'
    )
    parser.add_argument(
        '--profile', metavar='RUN',
        help='use the settings of this training run: YAML file, or the name of one in config/train (default: portable)',
    )  # fmt: skip
    parser.add_argument('--sensor', metavar='YAML', help='sensor description: crop, bins and picture size')
    parser.add_argument(
        '--frames', choices=FRAMES, default='first',
        help='which images of a window are measured; calibrations need "each" (default: first)',
    )  # fmt: skip


def add_without_contact(parser: argparse.ArgumentParser) -> None:
    """The share of samples of the untouched gel, of bags."""
    parser.add_argument(
        '--without-contact', type=float, default=0.05, metavar='SHARE',
        help='share of samples without contact, if the bags hold such images (default: 0.05)',
    )  # fmt: skip


def require_output(arguments: argparse.Namespace, *read: Path | None) -> None:
    """Refuse an output that cannot be written, or that is an input. Raises ConfigurationError."""
    from tactile_nodes.paths import check_output

    of_methods = arguments.model, arguments.profile, arguments.sensor, arguments.gel
    check_output(arguments.output, *read, *map(Path, filter(None, of_methods)))


def method_options(arguments: argparse.Namespace) -> BuildOptions:
    """How pictures are measured, and of which gel.

    Raises:
        ConfigurationError: an option cannot be used, or excludes another one that was given.
        ModelError: there is no such model.
    """
    from tactile_nodes.errors import ConfigurationError
    from tactile_nodes.learning.recorded.building import BuildOptions
    from tactile_nodes.model_file import find_model, load_model

    if not arguments.model:
        return _of_run(arguments)
    if given := [name for name in ('profile', 'sensor') if getattr(arguments, name)]:
        raise ConfigurationError(f'--{given[0]} cannot be used with --model, which sets it')
    return BuildOptions.of_model(load_model(find_model(arguments.model)), arguments.gel, arguments.frames)


def _of_run(arguments: argparse.Namespace) -> BuildOptions:
    from tactile_nodes.learning.config import load_train_config
    from tactile_nodes.learning.recorded.building import BuildOptions, gel_entry

    run = load_train_config(arguments.profile or 'portable')
    options = BuildOptions(
        run.flow, run.encoding, run.bins, arguments.frames, gel=gel_entry(arguments.gel), crop=run.data.crop
    )
    return of_sensor(options, arguments.sensor)


def of_sensor(options: BuildOptions, name: str | None) -> BuildOptions:
    """Options with crop, bins and picture size of a description, if one is named. Raises ConfigurationError."""
    from tactile_nodes.sensing.geometry import BinGrid
    from tactile_nodes.sensors import load_sensor

    if not name:
        return options
    sensor = load_sensor(name)
    described = sensor.image.width, sensor.image.height
    return replace(options, bins=BinGrid.of_sensor(sensor), crop=sensor.image.crop_px, picture=described)


@contextmanager
def resumable(progress: Progress) -> Iterator[None]:
    """Say at Ctrl-C that nothing measured is lost."""
    try:
        yield
    except KeyboardInterrupt:
        progress.say('stopped; finished measurements are kept, and the same command continues from there')
        raise


def written(presses: RecordedPresses, output: Path) -> int:
    from tactile_nodes.learning.datasets.file import save_dataset
    from tactile_nodes.learning.datasets.report import report

    save_dataset(output, presses)
    print(report(presses))
    if presses.card['left_out']:
        print(f'list them: tactile dataset info {shlex.quote(str(output))} --left-out')
    return 0
