"""JPEG pictures from cameras, complete or truncated.

A bad cable or an interrupted network stream gives truncated pictures. A decoder fills the missing part with grey, which
a flow method would mistake for motion. So a picture counts only if its end marker arrived. The markers are those of
ITU-T T.81, table B.1: FFD8 begins an image, FFD9 ends it.
"""

from __future__ import annotations

from tactile_nodes import decoding
from tactile_nodes.drivers.camera.contract import Picture

START = b'\xff\xd8'
END = b'\xff\xd9'
PADDING = b'\x00\r\n-'  # UVC cameras pad with zeros; a multipart stream leaves line ends and dashes


def is_complete(data: bytes) -> bool:
    """Whether a picture has its begin and end markers; padding after its end is allowed."""
    return data.startswith(START) and data.rstrip(PADDING).endswith(END)


def decode(data: bytes) -> Picture | None:
    """The picture in grey, (h, w); None if it is truncated, or larger than any camera's.

    Colour is not used here. JPEG stores luminance separately, with the same weights as a conversion from RGB. Skipping
    the colours saves two thirds of the time.
    """
    if not is_complete(data):
        return None
    try:
        return decoding.decode(data, grey=True)
    except OSError:  # a damaged header may state any size; only this picture is lost
        return None
