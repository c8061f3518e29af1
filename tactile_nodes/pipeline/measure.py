"""The second stage: motion against the rest image, without the motion of the whole image, and its features."""

from __future__ import annotations

from tactile_nodes.clock import perf_ns
from tactile_nodes.pipeline.frame import Frame
from tactile_nodes.sensing.flow.methods import DisplacementField
from tactile_nodes.sensing.picture.moved_dots import MovedDots
from tactile_nodes.sensing.picture.registration import Registration
from tactile_nodes.sensing.rest.in_use import RestInUse
from tactile_nodes.sensing.rest.prepared import PreparedRest

KNOCK_ROUNDS = 3
"""How often a frame is measured again when the camera was knocked."""


class MeasureMemory:
    """The state of `measure`: how the whole image moved, and whether bands roll over it.

    `registration` is None if the motion of the whole image is not removed, or, with printed dots, by `dots`.
    """

    def __init__(self, registration: Registration | None, dots: MovedDots | None = None) -> None:
        self.registration, self.dots = registration, dots
        self.banded = False

    def begin(self, rest: RestInUse) -> None:
        """Measure against this rest image from now on."""
        self.banded = False
        if self.registration and rest.prepared.registering:
            self.registration.set_reference(rest.prepared.registering, rest.offset, rest.motion)
        if self.dots:
            self.dots.at_rest()


def measure(memory: MeasureMemory, rest: PreparedRest, frame: Frame) -> None:
    """Find what moved, and its features. An untouched frame gets no motion and is not measured."""
    registration = memory.registration
    _straighten(memory, rest, frame)
    assert frame.straight is not None
    frame.still, frame.stillness = rest.check.judged(frame.straight) if rest.check else (False, None)
    if frame.still:
        if registration:
            registration.at_rest(frame.at_ns)
        if memory.dots:
            memory.dots.at_rest()
        frame.motion = rest.still
    elif registration:
        frame.motion = _beside_whole(memory, registration, rest, frame)
    else:
        frame.motion = rest.flow.displacement(frame.image)
        if memory.dots:
            assert rest.own.confidence is not None
            shape = frame.image.shape
            frame.motion = memory.dots.without(frame.motion, rest.own.confidence, shape, compiled=rest.compiled)
    frame.dots = memory.dots
    frame.banded, frame.untouched, frame.found_ns = memory.banded, frame.motion is rest.still, perf_ns()
    frame.features = rest.still_features if frame.untouched else rest.encoding.encode(frame.motion)


def _straighten(memory: MeasureMemory, rest: PreparedRest, frame: Frame) -> None:
    """Register the image to the rest image, and remove bands while there are any."""
    straight = memory.registration.straightened(frame.image) if memory.registration else frame.image
    frame.straight = straight
    if memory.banded:
        frame.straight = rest.bands.without(straight)
        memory.banded = frame.straight is not straight


def _beside_whole(
    memory: MeasureMemory, registration: Registration, rest: PreparedRest, frame: Frame
) -> DisplacementField:
    """Motion relative to the whole image; measured again if the whole image turns out to have moved since."""
    assert frame.straight is not None
    found = rest.flow.displacement(frame.straight)
    if _bands_begin(memory, rest, frame, found):
        found = rest.flow.displacement(frame.straight)
    field = registration.without(found)
    for _ in range(KNOCK_ROUNDS):
        if not registration.look(frame.straight, field, frame.at_ns):
            break
        frame.stillness = None
        _straighten(memory, rest, frame)
        field = registration.without(rest.flow.displacement(frame.straight))
    # A dense search mistakes noise for motion, and models mistake that for a force; patches beside it do not.
    seen_at_rest = rest.check is not None and registration.watches and registration.free
    return rest.still if seen_at_rest else field


def _bands_begin(memory: MeasureMemory, rest: PreparedRest, frame: Frame, found: DisplacementField) -> bool:
    """Check for new bands if few patches are found again, and remove them; returns whether there are any."""
    if found.confidence is None or memory.banded or found.confidence.sum() >= rest.least_sure:
        return False
    assert frame.straight is not None
    straight, frame.straight = frame.straight, rest.bands.without(frame.straight)
    memory.banded = frame.straight is not straight
    return memory.banded
