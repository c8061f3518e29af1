"""JPEG pictures as cameras send them, whole or not.

A camera on a bad cable and a cut network stream both send pictures that stop in the middle. A decoder fills the
rest with grey, which a flow method takes for motion; so a picture counts only if its end arrived. The marks are
those of ITU-T T.81, table B.1: FFD8 begins an image, FFD9 ends it.
"""

from __future__ import annotations

import numpy as np

from tactile_nodes.drivers.camera import opencv
from tactile_nodes.drivers.camera.contract import Picture

START = b'\xff\xd8'
END = b'\xff\xd9'
PADDING = b'\x00\r\n-'  # UVC cameras fill up with zeros; a multipart stream leaves line ends and dashes


def is_whole(data: bytes) -> bool:
    """Whether a picture begins and ends where it should; padding after its end is allowed."""
    return data.startswith(START) and data.rstrip(PADDING).endswith(END)


def decode(data: bytes) -> Picture | None:
    """The picture in grey, (h, w); None if it is not whole.

    Nothing here looks at colour. A JPEG holds its grey apart, as it would be made of red, green and blue again, and
    leaving out the colours takes two thirds of the time.
    """
    if not is_whole(data):
        return None
    cv2 = opencv.load()
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    return None if image is None else np.asarray(image, np.uint8)
