"""Pictures named on the command line: files, folders, videos, cameras, the simulated camera."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from tactile_nodes.cli.running.session import count, positive_int

if TYPE_CHECKING:
    from tactile_nodes.drivers.camera.contract import Picture

FRAMES = 16
WAIT_S = 5.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """How many pictures of a video or camera are used."""
    parser.add_argument(
        '--frames', type=positive_int, default=FRAMES, metavar='N',
        help='pictures of a camera, video or folder that are used (default: %(default)s)',
    )  # fmt: skip
    parser.add_argument(
        '--skip', type=count, default=0, metavar='N', help='pictures skipped before them, e.g. dark ones at the start'
    )


def read_pictures(sources: Sequence[str], arguments: argparse.Namespace, sensor: str = '') -> dict[str, Picture]:
    """Grey pictures by their names; the simulated camera is that of `sensor`.

    Raises:
        ConfigurationError, DeviceError, ImageError: a source is none of these, or holds no picture.
    """
    found: dict[str, Picture] = {}
    for source in sources:
        found |= _read(source, arguments, sensor)
    return found


def _read(source: str, arguments: argparse.Namespace, sensor: str) -> dict[str, Picture]:
    from tactile_nodes.drivers.camera.file import read_image
    from tactile_nodes.paths import OF_PICTURES
    from tactile_nodes.sensing.geometry import grey

    if Path(source).suffix.lower() in OF_PICTURES and Path(source).is_file():  # else a camera may have such a name
        return {source: grey(read_image(Path(source)))}
    return _watched(source, arguments, sensor)


def _watched(source: str, arguments: argparse.Namespace, sensor: str) -> dict[str, Picture]:
    from tactile_nodes.clock import SystemClock
    from tactile_nodes.drivers.camera.contract import CameraSettings
    from tactile_nodes.drivers.camera.opening import open_camera
    from tactile_nodes.errors import ImageError
    from tactile_nodes.sensing.geometry import grey

    found: dict[str, Picture] = {}
    with closing(open_camera(CameraSettings(source=source, rate=0.0, sensor=sensor), SystemClock())) as camera:
        for number in range(arguments.skip + arguments.frames):
            frame = camera.read(WAIT_S)
            if frame is None:
                break
            if number >= arguments.skip:
                found[f'picture {number} of {source}'] = grey(frame.image)
    if not found:
        raise ImageError(f'{source} ends before picture {arguments.skip}; choose a smaller --skip')
    return found
