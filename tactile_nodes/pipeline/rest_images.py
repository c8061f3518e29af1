"""The last stage: the rest image for the next frame. It is captured, and renewed while nothing touches."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np

from tactile_nodes.clock import NS_PER_S
from tactile_nodes.errors import ImageError
from tactile_nodes.pipeline.frame import Frame
from tactile_nodes.pipeline.judge import MOST_NOISE, apart
from tactile_nodes.sensing.picture.dead_pixels import DeadPixels
from tactile_nodes.sensing.picture.motion import PictureMotion
from tactile_nodes.sensing.picture.quality import PictureLikeness, sharpness
from tactile_nodes.sensing.picture.quietness import EXPLAINED
from tactile_nodes.sensing.picture.registration import Registration
from tactile_nodes.sensing.picture.stillness import steady
from tactile_nodes.sensing.rest.capture import RestCapture
from tactile_nodes.sensing.rest.coming import Coming
from tactile_nodes.sensing.rest.in_use import RestInUse
from tactile_nodes.sensing.rest.prepared import Measuring, PreparedRest
from tactile_nodes.sensing.rest.renewal import Renewal, RenewalOptions, Rested
from tactile_nodes.shapes import UInt8

ELSEWHERE_PX = 0.15
"""An image of 3 px markers that moved by half a pixel is changed by registration: patches then read its motion up to
2 % wrong, most of all those at full size."""

PREPARE_S = 0.2
"""Time from the last frame of a renewed rest image until its use, so that its first frame does not depend on chance."""


class RestMemory:
    """The rest image in use, and the state of the next one.

    `captured` is the one that was captured or given; `trouble` says why there is none. `dead` are the camera's pixels
    that are filled in. The functions below change `in_use`; their caller informs the other stages.
    """

    DERIVED: ClassVar = ('measuring',)

    def __init__(self, measuring: Measuring, frames: int, renewal: RenewalOptions | None) -> None:
        self.measuring, self.frames = measuring, frames
        self.in_use: RestInUse | None = None
        self.captured: RestInUse | None = None
        self.capture: RestCapture | None = None
        self.renewal = Renewal(renewal) if renewal else None
        self.coming: Coming | None = None
        self.dead = DeadPixels()
        self.trouble = self.refused = ''

    def begin_capture(self, skip: int = 0) -> None:
        """Start a capture: skip the next `skip` images of any kind, then average usable ones into a rest image."""
        self.capture, self.refused = RestCapture(self.frames, skip), ''

    def take(self, rest: RestInUse, at_ns: int) -> RestInUse:
        """Measure against this rest image from now on."""
        self.in_use, self.trouble = rest, ''
        self.dead.beside(rest.prepared.image)
        if not rest.renewed:
            self.captured, self.coming = rest, None
        if self.renewal is not None:
            self.renewal.taken(at_ns, renewed=rest.renewed)
        return rest


def given(memory: RestMemory, image: UInt8[np.ndarray, 'h w'], at_ns: int) -> RestInUse:
    """Use a given rest image; its dead pixels are not filled in yet.

    Raises:
        ImageError: nothing can be measured against it; the previous rest image stays in use.
    """
    prepared = _prepared(memory, image)
    likeness = PictureLikeness.of(prepared.image, memory.measuring.flow.name)
    return memory.take(RestInUse(prepared, likeness, likeness), at_ns)


def offered(memory: RestMemory, frame: Frame) -> RestInUse | None:
    """Give a frame to the running capture; returns the rest image once it is complete."""
    try:
        rest = _captured(memory, frame)
        memory.trouble = memory.refused or (memory.capture.waiting if memory.capture else '')
    except ImageError as error:
        memory.trouble = str(error)
        return None
    return rest


def due(memory: RestMemory, at_ns: int) -> RestInUse | None:
    """The renewed rest image, once a frame's stamp has reached the time from which on it is used."""
    coming, captured = memory.coming, memory.captured
    if coming is None or captured is None or 0 <= coming.due_ns - at_ns <= 2 * PREPARE_S * NS_PER_S:
        return None
    memory.coming = None
    try:
        prepared = coming.prepared()
    except ImageError as error:
        memory.trouble = str(error)
        return None
    likeness = PictureLikeness.of(prepared.image, memory.measuring.flow.name, captured.added, renewed=True)
    rest = replace(
        captured, prepared=prepared, likeness=likeness, renewed=True, another=True,
        offset=coming.offset, motion=coming.motion,
    )  # fmt: skip
    return memory.take(rest, at_ns)


def keep(memory: RestMemory, frame: Frame, noise_grey: float) -> RestInUse | None:
    """Update rest image and dead pixels from a measured frame; returns another rest image if it has to change.

    `noise_grey` is the usual noise of a pixel.
    """
    assert memory.in_use is not None
    if frame.as_before:
        assert memory.captured is not None
        rest = replace(memory.captured, renewed=True, offset=PictureMotion(), motion=PictureMotion())
        return memory.take(rest, frame.at_ns)
    if frame.odd and _found_dead(memory, memory.in_use, frame, noise_grey):
        frame.odd = False
    else:
        _offer_renewal(memory, memory.in_use, frame)
    return None


def _captured(memory: RestMemory, frame: Frame) -> RestInUse | None:
    """Raises ImageError: the frame shows nothing, or the rest image cannot be used and the capture starts again."""
    capture = memory.capture
    assert capture is not None
    if (finished := capture.offer(frame.image)) is None:
        return None
    try:
        prepared = _prepared(memory, finished)
    except ImageError as error:
        memory.refused = str(error)
        raise
    memory.capture, memory.refused = None, ''
    image = memory.dead.mended(frame.image)
    added, stillness = sharpness(image) - sharpness(prepared.image), prepared.stillness(image)
    likeness = PictureLikeness.of(prepared.image, memory.measuring.flow.name, added)
    noise_grey = stillness.noise_grey if stillness else 0.0
    rest = RestInUse(
        prepared, likeness, likeness, unsteady=capture.unsteady, added=added, noise_grey=noise_grey
    )  # fmt: skip
    return memory.take(rest, frame.at_ns)


def _prepared(memory: RestMemory, image: UInt8[np.ndarray, 'h w']) -> PreparedRest:
    """Prepare an image with its dead pixels, which are filled in from now on. Raises ImageError."""
    dead = DeadPixels()
    prepared = memory.measuring.beside(dead.captured(image))
    memory.dead = dead
    return prepared


def _found_dead(memory: RestMemory, rest: RestInUse, frame: Frame, noise_grey: float) -> bool:
    """Whether dead pixels were found in this frame: they alone may explain why an image at rest looks odd.

    They are filled in from the next frame on, and frames collected for a rest image are discarded.
    """

    def still(image: UInt8[np.ndarray, 'h w']) -> bool:
        """Whether an image shows the same as the rest image, as sharply, and nothing touches."""
        stillness = rest.prepared.stillness(image)
        if (
            stillness is None
            or stillness.unexplained
            or stillness.noise_grey > MOST_NOISE * (noise_grey or stillness.noise_grey)
        ):
            return False
        return steady(stillness)

    registration = frame.registration
    if registration is None or registration.straightening is not None or not memory.dead.look(frame.image, still):
        return False
    memory.coming = None
    registration.begin_anew()
    if memory.renewal is not None:
        memory.renewal.taken(frame.at_ns, renewed=False)
    return True


def _offer_renewal(memory: RestMemory, rest: RestInUse, frame: Frame) -> None:
    """Give the frame to the renewal; a new rest image is prepared in the background during the next frames."""
    moved, straight = frame.registration, frame.straight
    if memory.renewal is None or moved is None or straight is None or memory.coming is not None:
        return
    other = apart(rest, moved) or _elsewhere(rest, moved) or moved.dent.dented or frame.blurred
    changed = other or (not frame.still and (frame.changed or moved.explained < EXPLAINED))
    fit = moved.settled and not frame.banded
    like, changed = (frame.still and not other, changed) if fit else (True, False)
    rested = Rested(moved.surely, moved.maybe, like, changed)
    image = memory.renewal.offer(straight, frame.at_ns, rested, moved.straightening)
    if image is not None:
        image = memory.dead.renewed(image) if moved.straightening is None else image
        memory.coming = Coming(image, frame.at_ns + round(PREPARE_S * NS_PER_S), moved.beside_frame, moved.motion)
        memory.coming.begin(memory.measuring)


def _elsewhere(rest: RestInUse, moved: Registration) -> bool:
    """Whether the image lies at another sub-pixel position than the rest image, in a way that disturbs patches.

    The residual then exceeds the noise, above all after a gel was seated again, and a new rest image is due anyway.
    """
    return not rest.dense and moved.apart_px > ELSEWHERE_PX
