"""JPEG pictures as cameras send them, whole or not.

A camera on a bad cable and a cut network stream both send pictures that stop in the middle. A decoder fills the
rest with grey, which a flow method takes for motion; so a picture counts only if its end arrived. The marks are
those of ITU-T T.81, table B.1: FFD8 begins an image, FFD9 ends it.
"""

from __future__ import annotations

from tactile_nodes import decoding
from tactile_nodes.drivers.camera.contract import Picture

START = b'\xff\xd8'
END = b'\xff\xd9'
PADDING = b'\x00\r\n-'  # UVC cameras fill up with zeros; a multipart stream leaves line ends and dashes


def is_whole(data: bytes) -> bool:
    """Whether a picture begins and ends where it should; padding after its end is allowed."""
    return data.startswith(START) and data.rstrip(PADDING).endswith(END)


def decode(data: bytes) -> Picture | None:
    """The picture in grey, (h, w); None if it is not whole, or larger than any camera's.

    Nothing here looks at colour. A JPEG holds its grey apart, as it would be made of red, green and blue again, and
    leaving out the colours takes two thirds of the time.
    """
    if not is_whole(data):
        return None
    try:
        return decoding.decode(data, grey=True)
    except OSError:  # a damaged header may claim any size, and costs this picture alone
        return None
