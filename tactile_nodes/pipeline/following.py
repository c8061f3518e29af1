"""From camera frames to the messages that the force estimator reads, with all state that is kept between frames.

Nodes, tests and benchmarks that use it get what the node publishes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from tactile_nodes import conversions
from tactile_nodes.clock import perf_ns
from tactile_nodes.errors import ImageError
from tactile_nodes.messages import stamp_ns, types
from tactile_nodes.params import parameter
from tactile_nodes.pipeline.frame import Frame
from tactile_nodes.pipeline.judge import judge
from tactile_nodes.pipeline.measure import MeasureMemory, measure
from tactile_nodes.pipeline.memory import Memory
from tactile_nodes.pipeline.mend import mend
from tactile_nodes.pipeline.methods import (
    RegistrationParams,
    StillnessParams,
    describe_flow,
    make_measuring,
    stillness_options,
)
from tactile_nodes.pipeline.reasons import UNMEASURED
from tactile_nodes.pipeline.rest_images import RestMemory, due, given, keep, offered
from tactile_nodes.pipeline.tell import no_motion, tell
from tactile_nodes.sensing.flow.overlay import overlay
from tactile_nodes.sensing.judge.freshness import Freshness
from tactile_nodes.sensing.picture.moved_dots import MovedDots
from tactile_nodes.sensing.picture.registration import Registration, RegistrationOptions
from tactile_nodes.sensing.rest.in_use import RestInUse
from tactile_nodes.sensing.rest.renewal import RenewalOptions
from tactile_nodes.shapes import UInt8

FORCE = types.ForceDistribution
ANOTHER_TIME_S = 60.0
"""Stamps further from now than this belong to another time base, so that no age of the frame follows from them."""

DENTED = (
    'something touched the gel when the rest image was captured; leave the gel untouched until the rest image is '
    'renewed, or call capture_reference'
)


@dataclass(frozen=True)
class FollowingParams:
    """How frames are turned into features."""

    READ_ONLY: ClassVar[bool] = True

    model: str = parameter('fast', 'model whose flow method and features are used: name of a shipped model, or a file')
    reference_frames: int = parameter(10, 'frames averaged into a captured rest image', minimum=1)
    marked_share: float = parameter(
        0.1, 'share of the regions of a rest image that must show a pattern', minimum=0.0, maximum=1.0
    )
    stillness: StillnessParams = field(default_factory=StillnessParams)
    registration: RegistrationParams = field(default_factory=RegistrationParams)
    renew: bool = parameter(True, 'renew the rest image while nothing touches, after light or sharpness changed')
    renew_after_s: float = parameter(
        60.0, 'time after which slow changes renew the rest image while nothing touches', minimum=1.0
    )
    stale_after_s: float = parameter(0.2, 'age from which on a frame is reported as stale', minimum=0.001)


class Following:
    """Turns each frame into a message of features. The stages are mend, measure, judge, keep and tell, each run once.

    It computes with compiled loops if `compiled` is set, else with NumPy.
    """

    def __init__(self, params: FollowingParams, *, compiled: bool = False) -> None:
        measuring = make_measuring(
            params.model, compiled=compiled, check=stillness_options(params.stillness),
            registers=params.registration.check, marked_share=params.marked_share,
        )  # fmt: skip
        registration, renewal = (
            params.registration,
            RenewalOptions(after_s=params.renew_after_s) if params.renew else None,
        )
        options = RegistrationOptions(registration.most_px, registration.most_turn_deg, registration.follow_s)
        self.memory = Memory(
            Freshness(params.stale_after_s),
            MeasureMemory(
                Registration(options) if measuring.registers else None,
                MovedDots(registration.most_px) if measuring.follows_dots and registration.check else None,
            ),
            RestMemory(measuring, params.reference_frames, renewal),
        )
        self._compiled = compiled
        self._method, self._nothing = describe_flow(measuring.flow), no_motion(measuring.encoding)
        self._announced: types.Image | None = None
        self._last: Frame | None = None
        self._trouble = ''

    @property
    def trouble(self) -> str:
        """Why frames are not measured, or are measured against a bad rest image; empty while all is well."""
        moved = self.memory.measure.registration
        return self._trouble or self.memory.rest.trouble or (DENTED if moved and moved.dent.dented else '')

    @property
    def renewed(self) -> bool:
        """Whether the rest image in use came from a renewal."""
        return (rest := self.memory.rest.in_use) is not None and rest.renewed

    @property
    def doubtful(self) -> bool:
        """Whether the rest image in use was captured from images that never came to rest."""
        return (rest := self.memory.rest.in_use) is not None and rest.unsteady

    @property
    def reference(self) -> UInt8[np.ndarray, 'h w'] | None:
        """The rest image in use."""
        return None if (rest := self.memory.rest.in_use) is None else rest.prepared.image

    @property
    def reference_id(self) -> str:
        return '' if (rest := self.memory.rest.in_use) is None else rest.prepared.reference_id

    def begin_capture(self, skip: int = 0) -> None:
        """Start a capture: skip the next `skip` images of any kind, then average usable ones into a rest image."""
        self.memory.rest.begin_capture(skip)

    def use_reference(self, image: UInt8[np.ndarray, 'h w'], head: types.Header) -> None:
        """Measure against this rest image from now on.

        Raises:
            ImageError: nothing can be measured against it; the previous rest image stays in use.
        """
        self._begin(given(self.memory.rest, image, stamp_ns(head.stamp)), head)
        self._trouble = ''

    def announced(self) -> types.Image | None:
        """The rest image to publish, if another one came into use since the last call."""
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
        start_ns, memory = perf_ns(), self.memory
        frame = Frame(image, head, stamp_ns(head.stamp), registration=memory.measure.registration)
        self._begin(due(memory.rest, frame.at_ns), head)
        rest = None if memory.rest.capture else memory.rest.in_use
        noisy = rest and rest.added  # of a camera without noise, images may be equal
        if memory.freshness.stale(frame.at_ns, _age_s(acquire_s, waited_s), image if noisy else None):
            frame.reasons |= FORCE.REASON_STALE
        mend(memory.rest.dead, rest, frame, compiled=self._compiled)
        self._trouble = _other_size(frame, rest) if rest and frame.reasons & FORCE.REASON_OTHER_IMAGE else ''
        if memory.rest.capture:
            self._begin(offered(memory.rest, frame), head)
        if rest is None or frame.reasons & UNMEASURED:
            return tell(frame, self._method, self.reference_id, self._nothing, _times(acquire_s, waited_s))
        measure(memory.measure, rest.prepared, frame)
        flow_s, features_s = (frame.found_ns - start_ns) * 1e-9, (perf_ns() - frame.found_ns) * 1e-9
        stages = _times(acquire_s, waited_s, flow_s, features_s)
        judge(memory.judge, rest, frame, memory.rest.dead.count)
        self._begin(keep(memory.rest, frame, memory.judge.noise_grey), head)
        memory.judge.odd, self._last = frame.odd, frame
        return tell(frame, self._method, self.reference_id, self._nothing, stages)

    def overlay(self) -> UInt8[np.ndarray, 'h w 3']:
        """An image of the last frame's motion.

        Raises:
            ImageError: no frame has been measured yet.
        """
        if self._last is None or self._last.motion is None:
            raise ImageError('no frame has been measured yet; is the camera running?')
        return overlay(np.array(self._last.image), self._last.motion.displacement_px)

    def _begin(self, rest: RestInUse | None, head: types.Header) -> None:
        """Go on with another rest image, if there is one."""
        if rest is not None:
            self.memory.begin(rest)
            self._announced = conversions.image_message(rest.prepared.image, head)


def _times(
    acquire_s: float, waited_s: float, flow_s: float = math.nan, features_s: float = math.nan
) -> types.StageTimes:
    """The times of the stages up to the features."""
    return types.StageTimes(
        acquire=acquire_s, flow=flow_s, features=features_s, predict=math.nan, transport=max(0.0, waited_s)
    )


def _other_size(frame: Frame, rest: RestInUse) -> str:
    """What to do about an image of another size than the rest image."""
    (height, width), (known_height, known_width) = frame.image.shape, rest.prepared.image.shape
    return (
        f'the image has {width}x{height} pixels, but the rest image has {known_width}x{known_height}; '
        'set camera and crop as they were, or capture the rest image again'
    )


def _age_s(acquire_s: float, waited_s: float) -> float:
    """Time from capture until now; NaN if the stamps are of another time base, as in an old recording."""
    age_s = acquire_s + waited_s
    return math.nan if abs(age_s) > ANOTHER_TIME_S else age_s
