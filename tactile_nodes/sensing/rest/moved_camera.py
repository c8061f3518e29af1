"""Removes the motion of the camera from the images of recorded presses.

Live sensing follows the camera from frame to frame (`registration`). A recorded press has only images of the untouched
gel from right before it. If the camera moves by a thousandth of a millimetre (0.014 px) between the rest image and a
press, a model would learn that as an effect of the force, all over the gel.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from tactile_nodes.errors import ImageError
from tactile_nodes.sensing.features import Features, as_motion
from tactile_nodes.sensing.flow.methods import DisplacementField, require_like
from tactile_nodes.sensing.picture.knocks import KNOCK_PX, Common, whole_motion
from tactile_nodes.sensing.picture.motion import PictureMotion, motion_fit
from tactile_nodes.sensing.picture.registration import FOUND, LEAST_FOUND, LEAST_KNOWN, Registered, coarse
from tactile_nodes.sensing.rest.prepared import PreparedRest
from tactile_nodes.shapes import UInt8


class MovedCamera:
    """Measures images of a camera that has moved since the rest image.

    `untouched` is an image of the untouched gel, taken after the move; None: it has not moved. A small motion of the
    whole picture is subtracted as a whole, because single regions have more noise. After a knock, the motion of each
    region is subtracted: other pixels show the same motion a little differently.
    """

    def __init__(self, rest: PreparedRest, untouched: UInt8[np.ndarray, 'h w'] | None = None) -> None:
        self._rest, self.untouched = rest, untouched

    def features(self, image: UInt8[np.ndarray, 'h w'], *, pressed: bool = False) -> Features:
        """The features of an image, without the motion of the camera.

        If it is `pressed`, a motion of the whole picture that live sensing would take for a knock is removed as well:
        few mountings hold a camera still under a force.

        Raises:
            ImageError: the image has another size, or the untouched gel does not show the pattern of the rest image.
        """
        require_like(self._rest.image, image)
        found = self._rest.flow.displacement(image)
        field = DisplacementField(found.displacement_px - self._moved_px, found.confidence)
        if pressed and self._rest.registering is not None:
            knock = self._knock(self._rest.registering, image, field)
            field = DisplacementField(field.displacement_px - self._field_of(knock, field), field.confidence)
        return self._rest.encoding.encode(field)

    def _knock(
        self, registered: Registered, image: UInt8[np.ndarray, 'h w'], field: DisplacementField
    ) -> PictureMotion:
        """The motion of the whole picture, if it is a knock."""
        motion, confidence = coarse(registered.watch.displacement(image) if registered.watch else field)
        motion = motion - self._watched_px
        found = registered.known & (confidence >= FOUND)
        if found.sum() < max(LEAST_FOUND * registered.known_count, LEAST_KNOWN * found.size):
            return PictureMotion()
        terms, cause = whole_motion(registered.fit, motion, found)
        return PictureMotion.of(terms) if cause is Common.KNOCK else PictureMotion()

    def _field_of(self, motion: PictureMotion, field: DisplacementField) -> np.ndarray:
        return motion.field_px(self._rest.image.shape, *field.displacement_px.shape[:2])

    @cached_property
    def _moved_px(self) -> np.ndarray | float:
        """The motion of the untouched gel, of each region or pixel."""
        if self.untouched is None:
            return 0.0
        field = self._rest.flow.displacement(self.untouched)
        motion, size_px = common_motion(self._rest, self._rest.encoding.encode(field))
        return field.displacement_px if size_px > KNOCK_PX else self._field_of(motion, field)

    @cached_property
    def _watched_px(self) -> np.ndarray | float:
        """The same, of the separate patches."""
        registered = self._rest.registering
        if self.untouched is None or registered is None or registered.watch is None:
            return 0.0
        return coarse(registered.watch.displacement(self.untouched))[0]


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
    fit = motion_fit(rest.image.shape, *found.shape)
    terms = fit.common_of_regions(as_motion(features.encoding, features.values.astype(np.float32)), found)
    return PictureMotion.of(terms), fit.size_px(terms)
