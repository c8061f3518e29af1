"""Last: the rest image that the next frame is measured against; captured, and taken anew while nothing touches."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np
from jaxtyping import UInt8

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

ELSEWHERE_PX = 0.15
"""Moved by half a pixel and straightened, a picture of markers of three pixels is not what it was: patches read motion
in it up to two percent off, most of all those at full size."""

PREPARE_S = 0.2
"""From the last frame of a renewed rest image until it is used, so that which frame is the first is no chance."""


class RestMemory:
    """Which rest image is in use, and what is known of the next one.

    `captured` is the one that was captured or given; `trouble` says why there is none. `dead` are the pixels of the
    camera that are filled in. Functions below change what is `in_use`; whoever calls them tells the other stages.
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
        """Make a rest image of the next images that show anything, after leaving out `skip` of all kinds."""
        self.capture, self.refused = RestCapture(self.frames, skip), ''

    def take(self, rest: RestInUse, at_ns: int) -> RestInUse:
        """Measure against this one from now on."""
        self.in_use, self.trouble = rest, ''
        self.dead.beside(rest.prepared.image)
        if not rest.renewed:
            self.captured, self.coming = rest, None
        if self.renewal is not None:
            self.renewal.taken(at_ns, renewed=rest.renewed)
        return rest


def given(memory: RestMemory, image: UInt8[np.ndarray, 'h w'], at_ns: int) -> RestInUse:
    """Take a rest image of frames as the camera delivered them, with its dead pixels.

    Raises:
        ImageError: it shows nothing that can be measured against; the one before stays in use.
    """
    prepared = _prepared(memory, image)
    likeness = PictureLikeness.of(prepared.image, memory.measuring.flow.name)
    return memory.take(RestInUse(prepared, likeness, likeness), at_ns)


def offered(memory: RestMemory, frame: Frame) -> RestInUse | None:
    """Give a frame to the capture under way; the rest image, once it is complete."""
    try:
        rest = _captured(memory, frame)
        memory.trouble = memory.refused or (memory.capture.waiting if memory.capture else '')
    except ImageError as error:
        memory.trouble = str(error)
        return None
    return rest


def due(memory: RestMemory, at_ns: int) -> RestInUse | None:
    """The renewed rest image, from the first frame on for which it is due."""
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
    """Take what a frame that was measured says of rest image and dead pixels; another rest image, if it says so.

    `noise_grey` is the noise of a pixel that is usual.
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
    """Raises ImageError: the frame shows nothing, or the rest image cannot be used and the capture begins anew."""
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
    added, seen = sharpness(image) - sharpness(prepared.image), prepared.stillness(image)
    likeness = PictureLikeness.of(prepared.image, memory.measuring.flow.name, added)
    noise_grey = seen.noise_grey if seen else 0.0
    rest = RestInUse(
        prepared, likeness, likeness, unsteady=capture.unsteady, added=added, noise_grey=noise_grey
    )  # fmt: skip
    return memory.take(rest, frame.at_ns)


def _prepared(memory: RestMemory, image: UInt8[np.ndarray, 'h w']) -> PreparedRest:
    """Of frames as the camera delivered them, whose dead pixels are filled in from now on. Raises ImageError."""
    dead = DeadPixels()
    prepared = memory.measuring.beside(dead.captured(image))
    memory.dead = dead
    return prepared


def _found_dead(memory: RestMemory, rest: RestInUse, frame: Frame, noise_grey: float) -> bool:
    """A picture that is odd at rest may be so by dead pixels alone; whether some were found in this frame.

    They are filled in from the next one on, and what was collected for a rest image is forgotten.
    """

    def still(image: UInt8[np.ndarray, 'h w']) -> bool:
        """Whether a picture shows what the rest image shows, as sharply as it did, and nothing touches."""
        seen = rest.prepared.stillness(image)
        if seen is None or seen.unexplained or seen.noise_grey > MOST_NOISE * (noise_grey or seen.noise_grey):
            return False
        return steady(seen)

    registration = frame.registration
    if registration is None or registration.straightening is not None or not memory.dead.look(frame.image, still):
        return False
    memory.coming = None
    registration.begin_anew()
    if memory.renewal is not None:
        memory.renewal.taken(frame.at_ns, renewed=False)
    return True


def _offer_renewal(memory: RestMemory, rest: RestInUse, frame: Frame) -> None:
    """Give the frame to the renewal of the rest image; what comes of it is prepared beside the next frames."""
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
    """Whether patches read a picture that fell elsewhere on the camera's pixels than the rest image's.

    More than its noise is left over then, above all where a gel was seated anew, and it gets a rest image anyway.
    """
    return not rest.dense and moved.apart_px > ELSEWHERE_PX
