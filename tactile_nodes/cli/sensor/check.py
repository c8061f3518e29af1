"""``tactile sensor check``: do pictures fit a description, and are they good enough to measure with?"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from tactile_nodes.cli.sensor import pictures

if TYPE_CHECKING:
    from tactile_nodes.sensing.inspection.judging import Inspection


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('sensor', help='description of the sensor: a YAML file, or the name of a shipped one')
    parser.add_argument(
        'pictures', nargs='+', metavar='SOURCE',
        help='pictures of the untouched gel: files, a folder, a video, a camera, or simulated',
    )  # fmt: skip
    parser.add_argument('-o', '--output', type=Path, metavar='FILE.png', help='figure (default: NAME_check.png)')
    pictures.add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print and draw the findings; 1 if nothing useful can be measured in these pictures."""
    from tactile_nodes.drivers.camera.pictures import write_png
    from tactile_nodes.paths import check_output
    from tactile_nodes.sensing.inspection.drawing import figure
    from tactile_nodes.sensing.inspection.judging import Inspection
    from tactile_nodes.sensors import load_sensor

    sensor = load_sensor(arguments.sensor)
    output = arguments.output or Path(f'{Path(arguments.sensor).stem}_check.png')
    check_output(output, *map(Path, arguments.pictures))
    inspection = Inspection(sensor, pictures.read_pictures(arguments.pictures, arguments, arguments.sensor))
    tell(inspection)
    print(f'wrote {write_png(output, figure(inspection))}')
    return 0 if inspection.usable else 1


def tell(inspection: Inspection) -> None:
    for each in inspection.findings:
        print(f'{each.level:4} {each.subject}: {each.text}')
