"""``tactile dataset import``: a data set from pictures, or a video, and a table that lists the presses."""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from tactile_nodes.cli.dataset import methods

if TYPE_CHECKING:
    from tactile_nodes.learning.agreement.known import Known


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        'tables', nargs='+', type=Path, metavar='TABLE', help='CSV or Parquet, each with its rest images'
    )
    parser.add_argument(
        '--pictures', type=Path, metavar='FOLDER|VIDEO', help='where the pictures are, if not beside the table'
    )
    parser.add_argument(
        '--untouched-below', type=float, default=0.0, metavar='N', help='forces up to this value count as no contact'
    )
    parser.add_argument(
        '--force', action='store_true', help='accept tables that contradict the pictures, and dots for a texture flow'
    )
    methods.add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    from tactile_nodes.errors import ConfigurationError
    from tactile_nodes.learning.imported.importing import Imported, import_presses
    from tactile_nodes.learning.progress import TerminalProgress
    from tactile_nodes.learning.tables.pictures import pictures_of
    from tactile_nodes.learning.tables.presses import read_table

    if arguments.pictures is not None and not arguments.pictures.exists():
        raise ConfigurationError(f'no folder or video {arguments.pictures}; give the path of the pictures')
    methods.require_output(arguments, *arguments.tables, arguments.pictures)
    options = methods.method_options(arguments)
    tables = [read_table(file, options.bins.reach_mm, arguments.untouched_below) for file in arguments.tables]
    progress = TerminalProgress()
    with methods.resumable(progress):
        presses = import_presses(
            [Imported(table, pictures_of(table, arguments.pictures)) for table in tables],
            options,
            _known(arguments),
            progress,
            command=shlex.join(['tactile', *sys.argv[1:]]),
            forced=arguments.force,
        )
    return methods.written(presses, arguments.output)


def _known(arguments: argparse.Namespace) -> Known:
    """The description of the sensor: as given, or the one in the model that the pictures are measured for."""
    from tactile_nodes.learning.agreement.known import Known
    from tactile_nodes.model_file import find_model, load_model
    from tactile_nodes.sensors import load_sensor

    if arguments.model:
        return Known.of(load_model(find_model(arguments.model)))
    return Known(load_sensor(arguments.sensor) if arguments.sensor else None)
