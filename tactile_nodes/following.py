"""From the camera's frames to the messages that the force estimator reads: all that is remembered between frames.

Who feeds it, a node, a test or a bench, gets what the node publishes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import UInt8

from tactile_nodes import conversions
from tactile_nodes.clock import NS_PER_S, perf_ns
from tactile_nodes.errors import ImageError
from tactile_nodes.messages import stamp_ns, types
from tactile_nodes.methods import (
    MethodParams,
    RegistrationParams,
    StillnessParams,
    make_check,
    make_methods,
    make_registration,
    told,
)
from tactile_nodes.params import parameter
from tactile_nodes.sensing.compiling import use_compiled
from tactile_nodes.sensing.features import Features
from tactile_nodes.sensing.flow import DisplacementField
from tactile_nodes.sensing.freshness import Freshness
from tactile_nodes.sensing.picture_motion import PictureMotion
from tactile_nodes.sensing.quality import PictureLikeness, picture_faults, sharpness
from tactile_nodes.sensing.registration import FEW_FOUND, KNOCK_PX
from tactile_nodes.sensing.renewal import Renewal, RenewalOptions, Rested
from tactile_nodes.sensing.tracking import Coming, FeatureTracker, PreparedRest, overlay

FORCE = types.ForceDistribution
PREPARE_S = 0.2
"""From the last frame of a renewed rest image until it is used, so that which frame is the first is no chance."""

ANOTHER_TIME_S = 60.0
"""Stamps further away than this are not of this time base, and say nothing of a frame's age."""


@dataclass(frozen=True)
class FollowingParams(MethodParams):
    """How frames are turned into features."""

    reference_frames: int = parameter(10, 'frames averaged into a captured rest image', minimum=1)
    marked_share: float = parameter(
        0.1, 'share of regions that must show a pattern in a rest image', minimum=0.0, maximum=1.0
    )
    compiled: bool = parameter(
        False, "run inner loops compiled by numba (pip install 'tactile_nodes[compiled]')", read_only=True
    )
    stillness: StillnessParams = field(default_factory=StillnessParams)
    registration: RegistrationParams = field(default_factory=RegistrationParams)
    renew: bool = parameter(
        True, 'take the rest image anew, while nothing touches, when light or sharpness have changed', read_only=True
    )
    renew_after_s: float = parameter(
        60.0, 'time after which slow changes renew the rest image, while nothing touches', minimum=1.0, read_only=True
    )
    stale_after_s: float = parameter(0.2, 'age from which a frame is called stale', minimum=0.001)


class Following:
    """Answers each frame with a message of features; there is nothing else to hand on from frame to frame.

    Raises:
        ConfigurationError: compiled loops are asked for, and numba is not installed.
    """

    def __init__(self, params: FollowingParams) -> None:
        if params.compiled:
            use_compiled()
        flow, self._encoding = make_methods(params)
        self._method = told(flow)
        self._tracker = FeatureTracker(
            flow,
            self._encoding,
            rest_frames=params.reference_frames,
            marked_share=params.marked_share,
            check=make_check(params.stillness),
            registration=make_registration(params.registration),
        )
        self._flow = flow.name
        self._freshness = Freshness(params.stale_after_s)
        self._now: PictureLikeness | None = None
        self._captured: PictureLikeness | None = None
        self._first: PreparedRest | None = None
        self._changed = False
        self._renewal = Renewal(RenewalOptions(after_s=params.renew_after_s)) if params.renew else None
        self._coming: Coming | None = None
        self._announced: types.Image | None = None
        self._last: tuple[np.ndarray, DisplacementField] | None = None
        self.trouble, self.renewed = '', False

    @property
    def reference(self) -> UInt8[np.ndarray, 'h w'] | None:
        """The rest image in use."""
        return self._tracker.reference

    @property
    def reference_id(self) -> str:
        return self._tracker.reference_id

    def begin_capture(self, skip: int = 0) -> None:
        """Make a rest image of the next images that show anything, after leaving out `skip` of all kinds."""
        self._tracker.begin_capture(skip=skip)

    def use_reference(self, image: UInt8[np.ndarray, 'h w'], head: types.Header) -> None:
        """Measure against this rest image from now on.

        Raises:
            ImageError: nothing can be measured against it; the one before stays in use.
        """
        self._tracker.use_reference(image)
        self._announce(head)

    def announced(self) -> types.Image | None:
        """The rest image that came into use since this was asked last, if one did: to be published."""
        message, self._announced = self._announced, None
        return message

    def answer(
        self,
        image: UInt8[np.ndarray, 'h w'],
        head: types.Header,
        *,
        acquire_s: float = math.nan,
        waited_s: float = 0.0,
    ) -> types.FlowFeatures:
        """The features of one frame.

        Args:
            image: the frame.
            head: its header, with the stamp of its capture.
            acquire_s: from that stamp to its publication; NaN: not known.
            waited_s: from its publication until now.
        """
        start_ns = perf_ns()
        self._take_coming(head)
        faults = picture_faults(image)
        dark = faults.dark * FORCE.REASON_DARK_IMAGE | faults.saturated * FORCE.REASON_SATURATED_IMAGE
        stale = self._freshness.stale(stamp_ns(head.stamp), _age_s(acquire_s, waited_s)) * FORCE.REASON_STALE
        if missing := dark | self._missing(image, head):
            return self._message(image, head, self._nothing(), faults.level, reasons=missing | stale)
        field_px = self._tracker.field(image, stamp_ns(head.stamp))
        flow_ns = perf_ns()
        features = self._tracker.features(field_px)
        features_ns = perf_ns()
        self._last = image, field_px
        untouched = self._tracker.untouched(field_px)
        unlike = 0 if untouched else self._unlike(image, faults.level, head)
        self._offer_renewal(stamp_ns(head.stamp), untouched)
        reasons = stale | self._moved() | unlike
        stages = types.StageTimes(
            acquire=acquire_s,
            flow=(flow_ns - start_ns) * 1e-9,
            features=(features_ns - flow_ns) * 1e-9,
            predict=math.nan,
            transport=max(0.0, waited_s),
        )
        return self._message(
            image, head, features, faults.level,
            untouched=untouched, reasons=reasons, stages=stages,
        )  # fmt: skip

    def overlay(self) -> UInt8[np.ndarray, 'h w 3']:
        """A picture of the last frame's motion.

        Raises:
            ImageError: none has been measured yet.
        """
        if self._last is None:
            raise ImageError('no frame has been measured yet; is the camera running?')
        image, field_px = self._last
        return overlay(np.array(image), field_px.displacement_px)

    def _missing(self, image: UInt8[np.ndarray, 'h w'], head: types.Header) -> int:
        """Why a frame cannot be measured, if it cannot."""
        if self._tracker.capturing:
            self._offer_rest(image, head)
            return FORCE.REASON_NO_REFERENCE
        if self._tracker.reference is None:
            return FORCE.REASON_NO_REFERENCE
        if image.shape == self._tracker.reference.shape:
            return 0
        (height, width), (known_height, known_width) = image.shape, self._tracker.reference.shape
        self.trouble = (
            f'an image of {width}x{height} pixels came, and the rest image has {known_width}x{known_height}; '
            'set camera and crop as they were, or capture the rest image again'
        )
        return FORCE.REASON_OTHER_IMAGE

    def _moved(self) -> int:
        """What there is to say of the whole picture's motion."""
        registration = self._tracker.registration
        if registration is None:
            return 0
        told = {
            FORCE.REASON_PICTURE_LOST: registration.lost,
            FORCE.REASON_FOREIGN_MOTION: not registration.settled
            or (self._flow == 'dis' and registration.size_px > KNOCK_PX),  # what it is off by depends on motion
            FORCE.REASON_LOW_CONFIDENCE: registration.found < FEW_FOUND,
        }
        return sum(reason for reason, present in told.items() if present)

    def _unlike(self, image: UInt8[np.ndarray, 'h w'], level: float, head: types.Header) -> int:
        """What there is to say of the picture as a picture, beside the rest image and beside the one captured."""
        if self._now is None or self._captured is None:
            return 0
        sharp = sharpness(image)
        beside = self._now.near(level, sharp)
        self._changed = beside.light or beside.blurred
        told = beside | self._captured.far(level, sharp)
        if beside and self._tracker.rest is not self._first and not self._captured.near(level, sharp):
            assert self._first is not None
            self._tracker.use(self._first, offset=PictureMotion())  # all is as it was
            self._announce(head, renewed=True)
        return told.light * FORCE.REASON_LIGHT_CHANGED | (told.blurred | told.noisy) * FORCE.REASON_BLURRED

    def _offer_renewal(self, at_ns: int, untouched: bool) -> None:
        """Give the frame to the renewal of the rest image; what comes of it is prepared beside the next frames."""
        registration, straight = self._tracker.registration, self._tracker.straight
        if self._renewal is None or registration is None or straight is None or self._coming is not None:
            return
        like = untouched or not registration.steady
        rested = Rested(registration.surely, registration.maybe, like, self._changed and not untouched)
        image = self._renewal.offer(straight, at_ns, rested)
        if image is not None:
            self._coming = Coming(self._tracker, image, at_ns + round(PREPARE_S * NS_PER_S))

    def _take_coming(self, head: types.Header) -> None:
        """Measure against the renewed rest image from the first frame on that is due."""
        coming, at_ns = self._coming, stamp_ns(head.stamp)
        if coming is None or 0 <= coming.due_ns - at_ns <= 2 * PREPARE_S * NS_PER_S:
            return
        self._coming = None
        try:
            self._tracker.use(coming.prepared(), offset=coming.offset)
        except ImageError as error:
            self.trouble = str(error)
            return
        self._announce(head, renewed=True)

    def _offer_rest(self, image: UInt8[np.ndarray, 'h w'], head: types.Header) -> None:
        try:
            if self._tracker.offer_rest(image):
                self._announce(head)
        except ImageError as error:
            self.trouble = str(error)

    def _announce(self, head: types.Header, *, renewed: bool = False) -> None:
        image = self._tracker.reference
        assert image is not None
        self.trouble, self.renewed = '', renewed
        self._now = PictureLikeness(image, self._flow)
        if not renewed:
            self._coming, self._captured, self._first = None, self._now, self._tracker.rest
        if self._renewal is not None:
            self._renewal.taken(stamp_ns(head.stamp), renewed=renewed)
        self._announced = conversions.image_message(image, head)

    def _nothing(self) -> Features:
        """No motion, in which nobody believes: what is said of a frame that was not measured."""
        rows, cols = (int(str(self._encoding.options[name])) for name in ('rows', 'cols'))
        still = np.zeros((rows, cols, len(self._encoding.channels)), np.float32)
        return Features(self._encoding.name, still, np.zeros((rows, cols), np.float32))

    def _message(
        self,
        image: UInt8[np.ndarray, 'h w'],
        head: types.Header,
        features: Features,
        level: float,
        *,
        untouched: bool = False,
        reasons: int = 0,
        stages: types.StageTimes | None = None,
    ) -> types.FlowFeatures:
        registration = self._tracker.registration
        moved_px = registration.size_px if registration else 0.0
        return types.FlowFeatures(
            header=head,
            image_width=image.shape[1],
            image_height=image.shape[0],
            method=self._method,
            reference_id=self._tracker.reference_id,
            image_level=level,
            untouched=untouched,
            moved=moved_px,
            picture_motion=np.array(registration.since_rest.terms if registration and moved_px else (), np.float32),
            reasons=reasons,
            stages=stages or types.StageTimes(),
            **conversions.feature_fields(features),
        )


def _age_s(acquire_s: float, waited_s: float) -> float:
    """From capture until now; NaN where the stamps are of another time base, as those of an old recording."""
    age_s = acquire_s + waited_s
    return math.nan if abs(age_s) > ANOTHER_TIME_S else age_s
