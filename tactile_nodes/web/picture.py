"""Pictures for the page, from messages."""

from __future__ import annotations

import cv2
import numpy as np

from tactile_nodes import conversions
from tactile_nodes.errors import ImageError
from tactile_nodes.messages import types
from tactile_nodes.shapes import Float32

LARGEST_PX = 640
QUALITY = 80
_POLAR, _CARTESIAN = 'polar_mean', 'cartesian_mean'


def jpeg(message: types.Image) -> bytes:
    """The grey picture as JPEG, with no side longer than `LARGEST_PX`.

    Raises:
        ImageError: the image has no pixels.
    """
    picture = conversions.image_array(message)
    longest = max(picture.shape)
    if not picture.size:
        raise ImageError('received an image without pixels; check the node that publishes it')
    if longest > LARGEST_PX:
        scale = LARGEST_PX / longest
        picture = np.asarray(cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
    encoded, data = cv2.imencode('.jpg', picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    assert encoded
    return data.tobytes()


def arrows(message: types.FlowFeatures) -> Float32[np.ndarray, 'rows cols 3'] | None:
    """Motion of each region (dx right, dy down [px]) and its confidence; None if the encoding is not a motion.

    A region of 5 px at 0.9273 rad (polar_mean) moves by (3, 4) px.

    Raises:
        MessageError: the arrays do not fill their grid.
    """
    features = conversions.features_array(message)
    values = features.values
    if features.encoding == _POLAR:
        dx, dy = values[..., 0] * np.cos(values[..., 1]), values[..., 0] * np.sin(values[..., 1])
    elif features.encoding == _CARTESIAN:
        dx, dy = values[..., 0], values[..., 1]
    else:
        return None
    return np.stack([dx, dy, features.confidence], axis=-1).astype(np.float32)
