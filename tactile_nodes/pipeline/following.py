"""From the camera's frames to the messages that the force estimator reads: all that is remembered between frames.

Who feeds it, a node, a test or a bench, gets what the node publishes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import UInt8

from tactile_nodes import conversions
from tactile_nodes.clock import perf_ns
from tactile_nodes.errors import ImageError
from tactile_nodes.messages import stamp_ns, types
from tactile_nodes.params import parameter
from tactile_nodes.pipeline.methods import (
    MethodParams,
    RegistrationParams,
    StillnessParams,
    make_check,
    make_measuring,
    make_registration,
    told,
)
from tactile_nodes.pipeline.rest_images import RestImages
from tactile_nodes.sensing.features import Features
from tactile_nodes.sensing.flow.methods import DisplacementField
from tactile_nodes.sensing.flow.overlay import overlay
from tactile_nodes.sensing.judge.freshness import Freshness
from tactile_nodes.sensing.picture.quality import picture_faults
from tactile_nodes.sensing.rest.renewal import RenewalOptions
from tactile_nodes.sensing.tracking import FeatureTracker

FORCE = types.ForceDistribution
ANOTHER_TIME_S = 60.0
"""Stamps further away than this are not of this time base, and say nothing of a frame's age."""


@dataclass(frozen=True)
class FollowingParams(MethodParams):
    """How frames are turned into features."""

    reference_frames: int = parameter(10, 'frames averaged into a captured rest image', minimum=1)
    marked_share: float = parameter(
        0.1, 'share of regions that must show a pattern in a rest image', minimum=0.0, maximum=1.0
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

    It computes by `compiled` loops, or by numpy.
    """

    def __init__(self, params: FollowingParams, *, compiled: bool = False) -> None:
        self._compiled = compiled
        measuring = make_measuring(params, compiled=compiled)
        flow, encoding = measuring.flow, measuring.encoding
        self._encoding, self._method = encoding, told(flow)
        self._tracker = FeatureTracker(
            flow,
            encoding,
            rest_frames=params.reference_frames,
            marked_share=params.marked_share,
            check=make_check(params.stillness),
            registration=make_registration(params.registration, flow),
            compiled=compiled,
        )
        renewal = RenewalOptions(after_s=params.renew_after_s) if params.renew else None
        self._rest_images = RestImages(self._tracker, flow.name, renewal)
        self._freshness = Freshness(params.stale_after_s)
        self._last: tuple[np.ndarray, DisplacementField] | None = None
        self._trouble = ''

    @property
    def trouble(self) -> str:
        """Why frames are not measured; empty while all is well."""
        return self._trouble or self._rest_images.trouble

    @property
    def renewed(self) -> bool:
        """Whether the rest image in use was taken by itself."""
        return self._rest_images.renewed

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
        self._rest_images.use(image, head)
        self._trouble = ''

    def announced(self) -> types.Image | None:
        """The rest image that came into use since this was asked last, if one did: to be published."""
        return self._rest_images.announced()

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
        self._rest_images.take_coming(head)
        image = self._rest_images.mended(image)
        faults = picture_faults(image, compiled=self._compiled)
        dark = faults.dark * FORCE.REASON_DARK_IMAGE | faults.saturated * FORCE.REASON_SATURATED_IMAGE
        stale = self._freshness.stale(stamp_ns(head.stamp), _age_s(acquire_s, waited_s)) * FORCE.REASON_STALE
        if missing := dark | self._missing(image, head, faults.level):
            return self._message(image, head, self._nothing(), faults.level, reasons=missing | stale)
        field_px = self._tracker.field(image, stamp_ns(head.stamp))
        flow_ns = perf_ns()
        features = self._tracker.features(field_px)
        features_ns = perf_ns()
        self._last = image, field_px
        untouched = self._tracker.untouched(field_px)
        reasons = stale | self._rest_images.judge(image, faults.level, head)
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

    def _missing(self, image: UInt8[np.ndarray, 'h w'], head: types.Header, level: float) -> int:
        """Why a frame cannot be measured, if it cannot."""
        if self._tracker.capturing:
            self._rest_images.offer(image, head)
            self._trouble = ''
            return FORCE.REASON_NO_REFERENCE
        if self._tracker.reference is None:
            return FORCE.REASON_NO_REFERENCE
        if image.shape == self._tracker.reference.shape:
            return self._rest_images.faint(level) * FORCE.REASON_DARK_IMAGE
        (height, width), (known_height, known_width) = image.shape, self._tracker.reference.shape
        self._trouble = (
            f'an image of {width}x{height} pixels came, and the rest image has {known_width}x{known_height}; '
            'set camera and crop as they were, or capture the rest image again'
        )
        return FORCE.REASON_OTHER_IMAGE

    def _nothing(self) -> Features:
        """No motion, in which nobody believes: what is said of a frame that was not measured."""
        rows, cols = (int(str(self._encoding.options[name])) for name in ('rows', 'cols'))
        still = np.zeros((rows, cols, len(self._encoding.channels)), np.float32)
        return Features(self._encoding.name, still, np.zeros((rows, cols), np.float32))

    def _beside(self) -> dict[str, Any]:
        """What a message says of the rest image in use, and of how motion is measured beside it."""
        return {'method': self._method, 'reference_id': self._tracker.reference_id}

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
            image_level=level,
            **self._beside(),
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
