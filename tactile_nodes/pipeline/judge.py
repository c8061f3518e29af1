"""Then: what there is to say of the picture beside its motion, that its force may be doubted for."""

from __future__ import annotations

from tactile_nodes.messages import types
from tactile_nodes.pipeline.frame import Frame
from tactile_nodes.sensing.picture.knocks import KNOCK_PX
from tactile_nodes.sensing.picture.quality import picture_faults, sharpness
from tactile_nodes.sensing.picture.quietness import EXPLAINED
from tactile_nodes.sensing.picture.registration import FEW_FOUND, Registration
from tactile_nodes.sensing.rest.in_use import RestInUse

FORCE = types.ForceDistribution
GROWN_PX = 0.15
"""What no camera magnified: a gel that swells by 0.1 mm moves the rim by 0.3 px, and is read wrong."""

LOOK_EVERY, NO_TOUCH = 4, 40.0
"""Of frames that are not at rest one in so many is looked at more closely, and believed where no more than 25 mN touch
(motion in units of what noise makes of it)."""

MOST_LIGHT_SHARE = 0.05
"""A dense search takes light for motion: where any block of the picture is brighter or darker by more, it is off."""

MOST_NOISE = 1.3
"""What is left of the middle of the picture, beside motion and light, over what the captured rest image leaves: at rest
within 2 %. JPEG of quality 90 leaves 1.34, a blur of 0.5 px 2.6, one stuck pixel of a thousand 3.3."""

BEYOND_NOISE = 4.5
"""So many times as much is another picture: noise of four times leaves 3.7, of eight 7.1, JPEG of quality 30 leaves 5.0
and is read 4 % short by half-size patches, which find it hardly less sharp."""

MOST_DEAD = 0.01
"""Share of the pixels from which a picture with dead ones filled in is another: of 5 % a frame is up to 1.8 times as
wrong, of 2 % 1.6 times."""


class JudgeMemory:
    """What `judge` remembers of the frames that it looked at more closely.

    `told` are the reasons that it found, `noise_grey` the noise of a pixel that is usual, `odd` whether the picture may
    be another one by dead pixels, `gone` whether a part of it is another, `soft` whether it was less sharp than at the
    capture, and `unlooked` how many frames not at rest came since.
    """

    def __init__(self) -> None:
        self.told, self.noise_grey, self.unlooked = 0, 0.0, 0
        self.odd = self.gone = self.soft = False

    def begin(self, rest: RestInUse) -> None:
        """Compare with this rest image from now on."""
        if not rest.renewed:
            self.told, self.noise_grey = 0, rest.noise_grey
            self.odd = self.gone = self.soft = False


def judge(memory: JudgeMemory, rest: RestInUse, frame: Frame, guessed: int) -> None:
    """Add what there is to say of a frame that was measured, of which `guessed` pixels are filled in."""
    frame.reasons |= _of_motion(rest, frame)
    if not frame.still or memory.told & FORCE.REASON_BLURRED:  # a little blur leaves frames still
        frame.reasons |= _of_picture(memory, rest, frame)
    if frame.banded or guessed > MOST_DEAD * frame.image.size:
        frame.reasons |= FORCE.REASON_LIGHT_CHANGED
    _look_closer(memory, rest, frame)
    frame.reasons |= memory.told
    frame.odd = memory.odd


def apart(rest: RestInUse, registration: Registration) -> bool:
    """Whether a dense search, whose errors depend on where pixels fall, is off since the rest image was taken."""
    return rest.dense and registration.apart_px > KNOCK_PX


def _of_motion(rest: RestInUse, frame: Frame) -> int:
    """What there is to say of the whole picture's motion, and of the rest image by it."""
    moved = frame.registration
    if moved is None:
        return rest.unsteady * FORCE.REASON_REST_DOUBTFUL
    told = {
        FORCE.REASON_PICTURE_LOST: moved.lost,
        FORCE.REASON_FOREIGN_MOTION: not moved.settled or apart(rest, moved) or moved.grown_px > GROWN_PX,
        FORCE.REASON_LOW_CONFIDENCE: moved.found < FEW_FOUND,
        FORCE.REASON_REST_DOUBTFUL: rest.unsteady or moved.dent.dented,
    }
    return sum(reason for reason, present in told.items() if present)


def _of_picture(memory: JudgeMemory, rest: RestInUse, frame: Frame) -> int:
    """What there is to say of the picture as a picture, beside the rest image and beside the one captured."""
    sharp = sharpness(frame.image, compiled=rest.prepared.compiled)
    level = _level(rest, frame)
    beside = rest.likeness.near(level, sharp)
    frame.changed, frame.blurred = beside.light or beside.blurred, beside.blurred
    told = beside | rest.captured.far(level, sharp)
    memory.soft = told.blurred
    other = beside or rest.captured.as_sharp(sharp, of=rest.likeness.sharpness)
    frame.as_before = rest.another and bool(other) and not rest.captured.near(level, sharp)
    return told.light * FORCE.REASON_LIGHT_CHANGED | (told.blurred | told.noisy) * FORCE.REASON_BLURRED


def _level(rest: RestInUse, frame: Frame) -> float:
    """Mean grey of what the rest image shows, too: magnified by 1 % a picture without its dark rim has 2.5 % more."""
    if frame.straight is None or frame.straight is frame.image:
        return frame.level
    return picture_faults(frame.straight, compiled=rest.prepared.compiled).level


def _look_closer(memory: JudgeMemory, rest: RestInUse, frame: Frame) -> None:
    """What frames show of the picture beside motion: those at rest, and of the others one in so many."""
    moved = frame.registration
    memory.odd |= moved is not None and (moved.lost or not moved.settled)
    memory.unlooked = 0 if moved is None or moved.maybe else memory.unlooked + 1
    if moved is None or not moved.settled or memory.unlooked % LOOK_EVERY:
        return
    assert frame.straight is not None
    seen = frame.seen or rest.prepared.stillness(frame.straight)
    if seen is None or seen.motion > NO_TOUCH:
        return
    gone = seen.unexplained or moved.explained < EXPLAINED
    memory.gone = memory.gone or gone if rest.another else gone
    usual = memory.noise_grey = memory.noise_grey or seen.noise_grey
    noisy = seen.noise_grey > MOST_NOISE * usual
    memory.odd = seen.unexplained or noisy
    other_light = rest.dense and seen.light_share > MOST_LIGHT_SHARE
    frame.changed |= other_light
    # What blur takes of the pattern no lamp brings back.
    lit = other_light or (memory.gone and not memory.soft) or seen.noise_grey > BEYOND_NOISE * usual
    memory.told = lit * FORCE.REASON_LIGHT_CHANGED | noisy * FORCE.REASON_BLURRED
