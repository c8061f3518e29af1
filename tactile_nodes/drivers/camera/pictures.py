"""Single pictures on disk: rest images and drawings of the motion."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from tactile_nodes.decoding import read_picture
from tactile_nodes.errors import ConfigurationError

Picture = npt.NDArray[np.uint8]


def read_grey(file: str | Path) -> Picture:
    """A picture as (h, w) grey levels.

    Raises:
        ConfigurationError: no file is given, or it is not a picture, or too large.
    """
    if not str(file):
        raise ConfigurationError('no file for the rest image; set reference_file')
    try:
        return read_picture(file, grey=True)
    except OSError as error:
        raise ConfigurationError(
            f'cannot read the picture {file} ({error.strerror}); check the path and the picture'
        ) from error


def write_png(file: Path, picture: Picture) -> Path:
    """Write a picture, creating its folder; returns its full path.

    Raises:
        ConfigurationError: the file cannot be written.
    """
    encoded, data = cv2.imencode('.png', picture)
    assert encoded
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(data.tobytes())
    except OSError as error:
        raise ConfigurationError(f'cannot write {file} ({error.strerror}); choose another folder') from error
    return file.resolve()
