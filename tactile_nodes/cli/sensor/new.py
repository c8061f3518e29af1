"""``tactile sensor new``: a description from rest images, and from answers to what no image shows."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from tactile_nodes.cli.running.session import positive_float
from tactile_nodes.cli.sensor import pictures
from tactile_nodes.cli.sensor.check import tell
from tactile_nodes.cli.sensor.questions import answered, depths, modulus, sides, size

if TYPE_CHECKING:
    from tactile_nodes.drivers.camera.contract import Picture
    from tactile_nodes.sensing.inspection.describing import Understood

PATTERNS = 'auto', 'dots', 'spheres'
"""As in `tactile_nodes.sensing.inspection.describing`, which takes long to import."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    what = 'pictures of the untouched gel: files, folder, video, camera'
    parser.add_argument('pictures', nargs='+', metavar='SOURCE', help=what)
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='FILE.yaml', help='description to write')
    parser.add_argument(
        '--width', type=positive_float, metavar='MM', help='width of the whole picture at the surface of the gel'
    )
    parser.add_argument('--pitch', type=positive_float, metavar='MM', help='distance from one printed dot to the next')
    parser.add_argument('--thickness', type=positive_float, metavar='MM', help='thickness of the gel, down to its base')
    parser.add_argument(
        '--depth', type=depths, metavar='MM', help='depth of the pattern below the surface: 0.3, or 1.5-6'
    )
    parser.add_argument(
        '--stiffness', type=modulus, metavar='MPA', help='shear modulus, or hardness: 0.1, or 10A for Shore A 10'
    )
    parser.add_argument(
        '--sides', type=sides, metavar='WHAT', help='sides of the gel: free, held by a rigid frame, or ignored'
    )
    parser.add_argument(
        '--distance', type=positive_float, metavar='MM', help='distance from the lens to the surface of the gel'
    )
    parser.add_argument(
        '--camera-info', type=Path, metavar='FILE', help="the camera's calibration: OpenCV's YAML or ROS's camera_info"
    )
    parser.add_argument('--fisheye', action='store_true', help="the calibration is for OpenCV's fisheye model")
    parser.add_argument(
        '--pattern', choices=PATTERNS, default='auto', help='pattern in the picture (default: detect it)'
    )
    parser.add_argument('--crop', type=size, metavar='WxH', help='size of the central part of the picture to use')
    parser.add_argument('--mask', metavar='FILE', help="picture that is black where the gel is covered, or 'none'")
    parser.add_argument('--yes', action='store_true', help='ask nothing: use the usual values for what is not given')
    parser.add_argument('--force', action='store_true', help='replace an existing description and figure')
    pictures.add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Look, ask, write and draw; 1 if nothing useful can be measured in these pictures."""
    from tactile_nodes.drivers.camera.pictures import write_png
    from tactile_nodes.errors import ConfigurationError
    from tactile_nodes.paths import check_output, write_whole
    from tactile_nodes.sensing.inspection.describing import describe
    from tactile_nodes.sensing.inspection.drawing import figure
    from tactile_nodes.sensing.inspection.judging import Inspection
    from tactile_nodes.sensors.writing import text_of

    output, drawn = arguments.output, arguments.output.with_suffix('.png')
    if output == drawn:
        raise ConfigurationError(f'{output} is the name of the figure; the name of a description ends in .yaml')
    for each in (output, drawn):
        check_output(each, *map(Path, [*arguments.pictures, arguments.mask or 'none']), arguments.camera_info)
        if each.exists() and not arguments.force:
            raise ConfigurationError(f'{each} exists; choose another name, or replace it with --force')
    shown = pictures.read_pictures(arguments.pictures, arguments)
    size_px = _one_size(shown)
    seen = _seen(shown, arguments, size_px)
    print(f'detected: {seen.summary}')
    answers, sources = answered(arguments, seen, size_px)
    sensor = describe(seen, answers, size_px)
    inspection = Inspection(sensor, shown)
    tell(inspection)
    print(f'wrote {write_png(drawn, figure(inspection))}')
    if not inspection.usable:
        print(
            f'{output} was not written: fix the findings marked bad first, then add --force, which replaces {drawn}',
            file=sys.stderr,
        )
        return 1
    write_whole(output, text_of(sensor, sources).encode())
    name = shlex.quote(str(output))
    print(f'wrote {output}; make a model of it with: tactile calibrate --sensor {name} --model field -o …')
    return 0


def _one_size(shown: Mapping[str, Picture]) -> tuple[int, int]:
    """Width and height of all pictures. Raises ImageError."""
    from tactile_nodes.errors import ImageError

    (first, picture), *_ = shown.items()
    for name, other in shown.items():
        if other.shape != picture.shape:
            raise ImageError(
                f'{name} has {other.shape[1]}x{other.shape[0]} pixels, but {first} has {picture.shape[1]}x'
                f'{picture.shape[0]}; give pictures of the same size'
            )
    return picture.shape[1], picture.shape[0]


def _seen(shown: Mapping[str, Picture], arguments: argparse.Namespace, size_px: tuple[int, int]) -> Understood:
    """What the mean of all pictures shows; the mask as given, or as detected."""
    from dataclasses import replace

    import numpy as np

    from tactile_nodes.sensing.geometry import Crop
    from tactile_nodes.sensing.inspection.describing import understood, usual_crop
    from tactile_nodes.sensing.picture.quality import require_picture
    from tactile_nodes.sensors.covering import mask_of

    crop = Crop.centred(*size_px, *(arguments.crop or usual_crop(*size_px)))
    picture = np.ascontiguousarray(crop.apply(np.rint(np.mean([*shown.values()], axis=0)).astype(np.uint8)))
    require_picture(picture)
    seen = understood(picture, arguments.pattern)
    if arguments.mask is None:
        return seen
    if arguments.mask == 'none':
        return replace(seen, covered=np.zeros_like(seen.covered))
    return replace(seen, covered=crop.apply(mask_of(Path(arguments.mask), *size_px).covers(*size_px)))
