"""Rest image and features together: what a stream of images is turned into, frame by frame."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from tactile_nodes.errors import ImageError
from tactile_nodes.sensing.features import FeatureEncoding, Features
from tactile_nodes.sensing.flow import DisplacementField, FlowMethod, require_like
from tactile_nodes.sensing.quality import require_picture, require_rest_image
from tactile_nodes.sensing.reference import RestAccumulator, content_id
from tactile_nodes.sensing.registration import Registration
from tactile_nodes.sensing.stillness import StillnessCheck

KNOCK_ROUNDS = 3
"""How often a frame is measured anew when the camera was knocked."""


class FeatureTracker:
    """Takes the rest image when told to, and turns every later image into features against it.

    Args:
        flow: how motion is measured.
        encoding: how it is summed up by region.
        rest_frames: how many frames are averaged into a rest image.
        marked_share: share of the regions that must show structure in a rest image; sparse patterns need less.
        check: tells frames in which nothing touches, whose motion is then zero without being measured.
        registration: takes the motion of the whole picture out; None leaves it in.
    """

    def __init__(
        self,
        flow: FlowMethod,
        encoding: FeatureEncoding,
        *,
        rest_frames: int = 10,
        marked_share: float = 0.1,
        check: StillnessCheck | None = None,
        registration: Registration | None = None,
    ) -> None:
        self.reference: np.ndarray | None = None
        self.reference_id = ''
        self._check = check
        self.registration = registration
        self._still: tuple[DisplacementField, Features] | None = None
        self._flow = flow
        self._encoding = encoding
        self._rest_frames = rest_frames
        self._marked_share = marked_share
        self._rest: RestAccumulator | None = None
        self._left_to_skip = 0

    @property
    def capturing(self) -> bool:
        """Whether the next images go into a rest image."""
        return self._rest is not None

    def begin_capture(self, skip: int = 0) -> None:
        """Make a rest image of the next images that show anything, after leaving out `skip` of all kinds."""
        self._rest = RestAccumulator()
        self._left_to_skip = skip

    def offer_rest(self, image: UInt8[np.ndarray, 'h w']) -> bool:
        """Give an image to the capture under way; true when it completed the rest image.

        Raises:
            ImageError: the image is black or overexposed, and was left out; or the finished rest image cannot be
                measured against, and the capture starts anew.
        """
        assert self._rest is not None
        if self._left_to_skip > 0:
            self._left_to_skip -= 1
            return False
        require_picture(image)
        self._rest.add(image)
        if self._rest.count < self._rest_frames:
            return False
        finished, self._rest = self._rest.image(), RestAccumulator()
        self.use_reference(finished)
        self._rest = None
        return True

    def use_reference(self, image: UInt8[np.ndarray, 'h w']) -> None:
        """Measure against this rest image from now on.

        Raises:
            ImageError: it shows nothing that can be measured against; the one before stays in use.
        """
        self._encoding.set_reference(image)
        still = DisplacementField(np.zeros((*image.shape, 2), np.float32))
        require_rest_image(image, self._encoding.encode(still).confidence, self._marked_share)
        if self._check is not None:
            self._check.set_reference(image)
        self._flow.set_reference(image)
        self._still = None
        self.reference, self.reference_id = image, content_id(image)
        if self.registration:
            self.registration.set_reference(image, self._flow.displacement(image))

    def field(self, image: UInt8[np.ndarray, 'h w'], stamp_ns: int = 0) -> DisplacementField:
        """The displacement of `image`, taken at `stamp_ns`, against the rest image.

        Raises:
            ImageError: there is no rest image, or it has another size.
        """
        if self.reference is None:
            raise ImageError('there is no rest image yet; leave the gel alone while one is captured')
        require_like(self.reference, image)
        straight = self.registration.straightened(image) if self.registration else image
        if self._check is not None and self._check(straight):
            if self.registration:
                self.registration.at_rest(stamp_ns)
            return self._at_rest()[0]
        if self.registration is None:
            return self._flow.displacement(image)
        return self._registered(self.registration, image, straight, stamp_ns)

    def _registered(
        self,
        registration: Registration,
        image: UInt8[np.ndarray, 'h w'],
        straight: UInt8[np.ndarray, 'h w'],
        stamp_ns: int,
    ) -> DisplacementField:
        """What moved beside the whole picture; measured again where that turns out to have moved since."""
        field = registration.without(self._flow.displacement(straight))
        for _ in range(KNOCK_ROUNDS):
            if not registration.look(straight, field, stamp_ns):
                break
            straight = registration.straightened(image)
            field = registration.without(self._flow.displacement(straight))
        return field

    def untouched(self, field: DisplacementField) -> bool:
        """Whether that field is the one of all frames in which nothing touches, and was not measured."""
        return self._still is not None and field is self._still[0]

    def features(self, field: DisplacementField) -> Features:
        """The features of a displacement field."""
        return self._at_rest()[1] if self.untouched(field) else self._encoding.encode(field)

    def _at_rest(self) -> tuple[DisplacementField, Features]:
        """No motion, with the confidence that the rest image has in itself."""
        if self._still is None:
            assert self.reference is not None
            own = self._flow.displacement(self.reference)
            field = DisplacementField(np.zeros_like(own.displacement_px), own.confidence)
            self._still = field, self._encoding.encode(field)
        return self._still


def overlay(
    image: UInt8[np.ndarray, 'h w'],
    field_px: Float32[np.ndarray, 'rows cols 2'],
    *,
    spacing_px: int = 11,
    gain: float = 4.0,
    least_px: float = 0.25,
) -> UInt8[np.ndarray, 'h w 3']:
    """The image with an arrow wherever it moved by `least_px` or more, `gain` times as long as the motion (BGR)."""
    if field_px.shape[:2] != image.shape:
        field_px = cv2.resize(field_px, image.shape[::-1], interpolation=cv2.INTER_NEAREST)
    picture = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    half = spacing_px // 2
    for y in range(half, image.shape[0], spacing_px):
        for x in range(half, image.shape[1], spacing_px):
            dx, dy = (float(part) for part in field_px[y, x])
            if dx * dx + dy * dy >= least_px * least_px:
                tip = (round(x + gain * dx), round(y + gain * dy))
                cv2.arrowedLine(picture, (x, y), tip, (0, 200, 255), 1, cv2.LINE_AA, tipLength=0.3)
    return picture
