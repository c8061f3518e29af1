"""Measures against a rest image although the camera has moved since, by an image of the untouched gel after the move.

Live sensing follows the camera from frame to frame (`registration`). Recorded presses have only images from right
before them. If the camera moves by a thousandth of a millimetre (0.014 px) between rest image and press, that would be
learned as an effect of the force, all over the gel.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from tactile_nodes.errors import ImageError
from tactile_nodes.sensing.features import Features, as_motion
from tactile_nodes.sensing.flow.methods import DisplacementField, require_like
from tactile_nodes.sensing.picture.knocks import KNOCK_PX
from tactile_nodes.sensing.picture.motion import MotionFit, PictureMotion
from tactile_nodes.sensing.picture.registration import FOUND, LEAST_FOUND
from tactile_nodes.sensing.rest.prepared import PreparedRest
from tactile_nodes.shapes import UInt8


class MovedCamera:
    """Measures images of a camera that has moved since the rest image, to where it was when it took `untouched`.

    The motion of the whole picture is subtracted, and after a knock that of each region: other pixels show the same
    motion a little differently, but single regions have more noise.
    """

    def __init__(self, rest: PreparedRest, untouched: UInt8[np.ndarray, 'h w']) -> None:
        self._rest, self._untouched = rest, untouched

    def features(self, image: UInt8[np.ndarray, 'h w']) -> Features:
        """The features of an image, without the motion of the camera.

        Raises:
            ImageError: the image has another size, or the untouched gel does not show the pattern of the rest image.
        """
        require_like(self._rest.image, image)
        field = self._rest.flow.displacement(image)
        return self._rest.encoding.encode(DisplacementField(field.displacement_px - self._moved_px, field.confidence))

    @cached_property
    def _moved_px(self) -> np.ndarray:
        field = self._rest.flow.displacement(self._untouched)
        motion, size_px = common_motion(self._rest, self._rest.encoding.encode(field))
        rows, cols = field.displacement_px.shape[:2]
        return field.displacement_px if size_px > KNOCK_PX else motion.field_px(self._rest.image.shape, rows, cols)


def common_motion(rest: PreparedRest, features: Features) -> tuple[PictureMotion, float]:
    """The motion that most regions share, and its root mean square over the picture (px).

    Raises:
        ImageError: they do not show the pattern of the rest image.
    """
    known = rest.own_features.confidence >= FOUND
    found = known & (features.confidence >= FOUND)
    if found.sum() < LEAST_FOUND * known.sum():
        raise ImageError(
            'an image of the untouched gel does not show the pattern of the rest image; was the camera knocked, or the '
            'gel changed?'
        )
    motion = as_motion(features.encoding, features.values.astype(np.float32))
    fit = MotionFit(rest.image.shape, *found.shape)
    motion = np.where(found[..., None], motion, 0).reshape(-1, 2).astype(float)
    terms = fit.common(motion, found.ravel().astype(float))
    return PictureMotion.of(terms), fit.size_px(terms)
