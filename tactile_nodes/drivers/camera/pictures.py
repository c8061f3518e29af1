"""Single pictures on disk: rest images and drawings of the motion."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from tactile_nodes.decoding import decode
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.files import PICTURE_BYTES, read_plain

Picture = npt.NDArray[np.uint8]


def read_grey(file: str | Path) -> Picture:
    """A picture as (h, w) grey levels.

    Raises:
        ConfigurationError: no file is named, or it is no picture, or too large a one.
    """
    if not str(file):
        raise ConfigurationError('no picture is named that the rest image could be read from; set reference_file')
    try:
        picture = decode(read_plain(file, PICTURE_BYTES), grey=True)
    except OSError as error:
        raise ConfigurationError(
            f'cannot read the picture {file} ({error.strerror}); check the path and the picture'
        ) from error
    if picture is None:
        raise ConfigurationError(f'cannot read the picture {file}; it is no PNG or the like')
    return picture


def write_png(file: Path, picture: Picture) -> Path:
    """Write a picture, making its folder; returns its full path.

    Raises:
        ConfigurationError: the place cannot be written to.
    """
    encoded, data = cv2.imencode('.png', picture)
    assert encoded
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(data.tobytes())
    except OSError as error:
        raise ConfigurationError(f'cannot write {file} ({error.strerror}); choose another place') from error
    return file.resolve()
