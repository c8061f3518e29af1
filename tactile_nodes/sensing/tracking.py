"""Rest image and features together: what a stream of images is turned into, frame by frame."""

from __future__ import annotations

import numpy as np
from jaxtyping import UInt8

from tactile_nodes.errors import ImageError
from tactile_nodes.sensing.features import FeatureEncoding, Features, make_encoding
from tactile_nodes.sensing.flow.methods import DisplacementField, FlowMethod, require_like
from tactile_nodes.sensing.picture.dead_pixels import DeadPixels
from tactile_nodes.sensing.picture.motion import PictureMotion
from tactile_nodes.sensing.picture.quality import require_rest_image
from tactile_nodes.sensing.picture.registered import Registered
from tactile_nodes.sensing.picture.registration import Registration
from tactile_nodes.sensing.picture.rolling_bands import RollingBands
from tactile_nodes.sensing.picture.stillness import Stillness, StillnessCheck
from tactile_nodes.sensing.rest.capture import RestCapture
from tactile_nodes.sensing.rest.prepared import Measuring, PreparedRest
from tactile_nodes.sensing.rest.reference import content_id

LEAST_CONFIDENT = 0.93
"""Share of the rest image's confidence in itself below which a frame is looked at for bands: presses leave 0.96."""

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
        compiled: whether compiled loops do what `flow` is asked for, and all that is done beside it for each frame.
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
        compiled: bool = False,
    ) -> None:
        self.compiled = compiled
        self.reference: np.ndarray | None = None
        self.reference_id = ''
        self.straight: np.ndarray | None = None
        self.rest: PreparedRest | None = None
        self._check = check
        self.registration = registration
        self.dead = DeadPixels()
        self._still: tuple[DisplacementField, Features] | None = None
        self._seen: Stillness | None = None
        self._measuring = Measuring(flow, encoding, compiled)
        self._bands: RollingBands
        self._least_sure = 0.0
        self._flow, self._encoding = flow, encoding
        self._rest_frames = rest_frames
        self._marked_share = marked_share
        self._capture: RestCapture | None = None
        self.unsteady = self.still = False
        self.refused = ''
        """Why the last rest image of the capture under way could not be measured against."""

    @property
    def capturing(self) -> bool:
        """Whether the next images go into a rest image."""
        return self._capture is not None

    def begin_capture(self, skip: int = 0) -> None:
        """Make a rest image of the next images that show anything, after leaving out `skip` of all kinds."""
        self._capture = RestCapture(self._rest_frames, skip)
        self.unsteady, self.refused = False, ''

    @property
    def waiting(self) -> str:
        """Why the capture under way has not ended yet; empty while it is not late."""
        return self._capture.waiting if self._capture else ''

    def offer_rest(self, image: UInt8[np.ndarray, 'h w']) -> bool:
        """Give an image to the capture under way; true when it completed the rest image.

        `unsteady`: no frames that show the same came for too long, and any were taken.

        Raises:
            ImageError: the image is black or overexposed, and was left out; or the finished rest image cannot be
                measured against, and the capture starts anew.
        """
        assert self._capture is not None
        finished = self._capture.offer(image)
        self.unsteady = self._capture.unsteady
        if finished is None:
            return False
        try:
            self.use_captured(finished)
        except ImageError as error:
            self.refused = str(error)
            raise
        self._capture, self.refused = None, ''
        return True

    def use_captured(self, image: UInt8[np.ndarray, 'h w']) -> None:
        """As `use_reference`, of frames as the camera delivered them, with its dead pixels."""
        dead = DeadPixels()
        self.use_reference(dead.captured(image))
        self.dead = dead

    def use_reference(self, image: UInt8[np.ndarray, 'h w']) -> None:
        """Measure against this rest image from now on.

        Raises:
            ImageError: it shows nothing that can be measured against; the one before stays in use.
        """
        self.use(self.prepared(image))

    def prepared(self, image: UInt8[np.ndarray, 'h w']) -> PreparedRest:
        """All that is computed of a rest image beforehand, some 0.1 s; in any thread, beside the one in use.

        Raises:
            ImageError: it shows nothing that can be measured against.
        """
        encoding = make_encoding(self._measuring.encoding.name, self._measuring.encoding.options)
        encoding.set_reference(image)
        still = DisplacementField(np.zeros((*image.shape, 2), np.float32))
        require_rest_image(image, encoding.encode(still).confidence, self._marked_share)
        check = None if self._check is None else StillnessCheck(self._check.options, compiled=self.compiled)
        if check is not None:
            check.set_reference(image)
        flow = self._measuring.flow_beside(image)
        own = flow.displacement(image)
        registering = None if self.registration is None else Registered(image, own, compiled=self.compiled)
        return PreparedRest(image, flow, encoding, check, own, registering)

    def use(
        self, rest: PreparedRest, *, offset: PictureMotion | None = None, motion: PictureMotion | None = None
    ) -> None:
        """Measure against a prepared rest image from now on.

        `offset`: it was made of straightened images, and lies so far beside the first one. None: it is a first one.
        `motion` is that of the whole picture when they were taken.
        """
        self._flow, self._encoding, self._check = rest.flow, rest.encoding, rest.check
        self.rest, self._still, self._seen = rest, None, None
        sure = rest.own.confidence
        self._least_sure = 0.0 if sure is None else LEAST_CONFIDENT * float(sure.sum())
        self.reference, self.reference_id = rest.image, content_id(rest.image)
        self._bands = RollingBands(rest.image)
        if self.registration and rest.registering:
            self.registration.set_reference(rest.registering, offset, motion)

    def field(self, image: UInt8[np.ndarray, 'h w'], stamp_ns: int = 0) -> DisplacementField:
        """The displacement of `image`, taken at `stamp_ns`, against the rest image.

        Raises:
            ImageError: there is no rest image, or it has another size.
        """
        if self.reference is None:
            raise ImageError('there is no rest image yet; leave the gel alone while one is captured')
        require_like(self.reference, image)
        straight = self._straightened(image)
        self.still, self._seen = self._check.judged(straight) if self._check else (False, None)
        if self.still:
            if self.registration:
                self.registration.at_rest(stamp_ns)
            return self._at_rest()[0]
        if self.registration is None:
            return self._flow.displacement(image)
        return self._registered(self.registration, image, straight, stamp_ns)

    def stillness(self, straight: UInt8[np.ndarray, 'h w'] | None) -> Stillness | None:
        """How still a straightened frame is; None where nothing is there to tell."""
        if self._check is None or not self._check.able or straight is None:
            return None
        if straight is self.straight and self._seen is not None:
            return self._seen
        return self._check.look(straight)

    def _registered(
        self,
        registration: Registration,
        image: UInt8[np.ndarray, 'h w'],
        straight: UInt8[np.ndarray, 'h w'],
        stamp_ns: int,
    ) -> DisplacementField:
        """What moved beside the whole picture; measured again where that turns out to have moved since."""
        found = self._flow.displacement(straight)
        if self._begin_bands(straight, found):
            straight = self._straightened(image)
            found = self._flow.displacement(straight)
        field = registration.without(found)
        for _ in range(KNOCK_ROUNDS):
            if not registration.look(straight, field, stamp_ns):
                break
            straight, self._seen = self._straightened(image), None
            field = registration.without(self._flow.displacement(straight))
        # A dense search takes noise for motion, and models take that for a force; patches that watch beside it do not.
        seen_at_rest = self._check is not None and registration.watches and registration.free
        if seen_at_rest:
            return self._at_rest()[0]
        return field

    def _straightened(self, image: UInt8[np.ndarray, 'h w']) -> UInt8[np.ndarray, 'h w']:
        """The image where the rest image has it, and without bands while there are any."""
        straight = self.registration.straightened(image) if self.registration else image
        self.straight = self._bands.without(straight) if self._bands.seen else straight
        return self.straight

    def _begin_bands(self, straight: UInt8[np.ndarray, 'h w'], found: DisplacementField) -> bool:
        """Whether bands are there that were not there before, asked where little is found again."""
        if found.confidence is not None and not self._bands.seen and found.confidence.sum() < self._least_sure:
            self._bands.without(straight)
            return self._bands.seen
        return False

    @property
    def banded(self) -> bool:
        """Whether bands were taken out of the last frame."""
        return self._bands.seen

    def untouched(self, field: DisplacementField) -> bool:
        """Whether that field is the one of all frames in which nothing touches, whose motion is not asked for."""
        return self._still is not None and field is self._still[0]

    def features(self, field: DisplacementField) -> Features:
        """The features of a displacement field."""
        return self._at_rest()[1] if self.untouched(field) else self._encoding.encode(field)

    def _at_rest(self) -> tuple[DisplacementField, Features]:
        """No motion, with the confidence that the rest image has in itself."""
        if self._still is None:
            assert self.rest is not None
            own = self.rest.own
            field = DisplacementField(np.zeros_like(own.displacement_px), own.confidence)
            self._still = field, self._encoding.encode(field)
        return self._still
