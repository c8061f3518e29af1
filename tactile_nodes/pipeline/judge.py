"""The stage after `measure`: checks of the image, apart from its motion, that give reasons to doubt its force."""

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
"""Growth of the image that no zoom explains: a gel that swells by 0.1 mm moves the rim by 0.3 px and is read wrong."""

LOOK_EVERY, NO_TOUCH = 4, 40.0
"""Of the frames that are not at rest, one in `LOOK_EVERY` is checked more closely. The check counts up to a motion of
`NO_TOUCH`, about 25 mN (in units of the motion that noise causes)."""

MOST_LIGHT_SHARE = 0.05
"""A dense search mistakes light for motion: it is off if any block of the image is brighter or darker by more."""

MOST_NOISE = 1.3
"""Residual of the middle of the image after motion and light, over the residual at the capture, which grows with the
light: within 2 % of 1 at rest. JPEG of quality 90 gives 1.34, a blur of 0.5 px 2.6, one stuck pixel in a thousand
3.3."""

BEYOND_NOISE = 4.5
"""From this ratio on the image counts as another one. Four times the noise gives 3.7, eight times 7.1. JPEG of quality
30 gives 5.0; half-size patches then read 4 % too little, although they find the image hardly less sharp."""

MOST_DEAD = 0.01
"""Share of dead, filled-in pixels from which on the image counts as another one: with 5 % the error is up to 1.8 times
as large, with 2 % 1.6 times."""


class JudgeMemory:
    """The state of `judge`: what it found in the frames that it checked more closely.

    `told` are the reasons found. `noise_grey` is the usual noise of a pixel. `odd` says that dead pixels may have
    changed the image, `gone` that a part of it changed, `soft` that it was less sharp than at the capture. `unlooked`
    counts the frames not at rest since the last check.
    """

    def __init__(self) -> None:
        self.told, self.noise_grey, self.unlooked = 0, 0.0, 0
        self.odd = self.gone = self.soft = False

    def begin(self, rest: RestInUse) -> None:
        """Compare against this rest image from now on."""
        if not rest.renewed:
            self.told, self.noise_grey = 0, rest.noise_grey
            self.odd = self.gone = self.soft = False


def judge(memory: JudgeMemory, rest: RestInUse, frame: Frame, guessed: int) -> None:
    """Add reasons to a measured frame; `guessed` of its pixels are filled in."""
    frame.reasons |= _of_motion(rest, frame)
    if not frame.still or memory.told & FORCE.REASON_BLURRED:  # a little blur leaves frames still
        frame.reasons |= _of_picture(memory, rest, frame)
    if frame.banded or guessed > MOST_DEAD * frame.image.size:
        frame.reasons |= FORCE.REASON_LIGHT_CHANGED
    _look_closer(memory, rest, frame)
    frame.reasons |= memory.told
    frame.odd = memory.odd


def apart(rest: RestInUse, registration: Registration) -> bool:
    """Whether the image moved so far since the rest image that a dense search is off.

    Errors of a dense search depend on the sub-pixel position.
    """
    return rest.dense and registration.apart_px > KNOCK_PX


def _of_motion(rest: RestInUse, frame: Frame) -> int:
    """Reasons that follow from the motion of the whole image, for the frame and the rest image."""
    moved = frame.registration
    if moved is None:
        lost = frame.dots is not None and frame.dots.lost
        return rest.unsteady * FORCE.REASON_REST_DOUBTFUL | lost * FORCE.REASON_PICTURE_LOST
    reasons = {
        FORCE.REASON_PICTURE_LOST: moved.lost,
        FORCE.REASON_FOREIGN_MOTION: not moved.settled or apart(rest, moved) or moved.grown_px > GROWN_PX,
        FORCE.REASON_LOW_CONFIDENCE: moved.found < FEW_FOUND,
        FORCE.REASON_REST_DOUBTFUL: rest.unsteady or moved.dent.dented,
    }
    return sum(reason for reason, present in reasons.items() if present)


def _of_picture(memory: JudgeMemory, rest: RestInUse, frame: Frame) -> int:
    """Reasons that follow from comparing the image with the rest image in use and with the captured one."""
    sharp = sharpness(frame.image, compiled=rest.prepared.compiled)
    level = _level(rest, frame)
    beside = rest.likeness.near(level, sharp)
    frame.changed, frame.blurred = beside.light or beside.blurred, beside.blurred
    difference = beside | rest.captured.far(level, sharp)
    memory.soft = difference.blurred
    other = beside or rest.captured.as_sharp(sharp, of=rest.likeness.sharpness)
    frame.as_before = rest.another and bool(other) and not rest.captured.near(level, sharp)
    # Noise that was not seen at rest may be a sharper image, whose motion is too large. Dots are not checked at rest.
    checked = frame.registration is not None and rest.added is not None
    sharper = checked and beside.noisy and not memory.told & FORCE.REASON_BLURRED
    another = difference.light or rest.likeness.much_blurred(sharp) or sharper
    return another * FORCE.REASON_LIGHT_CHANGED | (difference.blurred or difference.noisy) * FORCE.REASON_BLURRED


def _level(rest: RestInUse, frame: Frame) -> float:
    """Mean grey value of the part that the rest image shows too: magnified by 1 %, an image loses its dark rim and is
    2.5 % brighter."""
    if frame.straight is None or frame.straight is frame.image:
        return frame.level
    return picture_faults(frame.straight, compiled=rest.prepared.compiled).level


def _look_closer(memory: JudgeMemory, rest: RestInUse, frame: Frame) -> None:
    """Check the image apart from its motion: each frame at rest, and one in `LOOK_EVERY` of the others."""
    moved = frame.registration
    memory.odd |= moved is not None and (moved.lost or not moved.settled)
    memory.unlooked = 0 if moved is None or moved.maybe else memory.unlooked + 1
    if moved is None or not moved.settled or memory.unlooked % LOOK_EVERY:
        return
    assert frame.straight is not None
    stillness = frame.stillness or rest.prepared.stillness(frame.straight)
    if stillness is None or stillness.motion > NO_TOUCH:
        return
    gone = stillness.unexplained or moved.explained < EXPLAINED
    memory.gone = memory.gone or gone if rest.another else gone
    memory.noise_grey = memory.noise_grey or stillness.noise_grey
    usual = memory.noise_grey * max(1.0, frame.level / max(rest.captured.level, 1.0))
    noisy = stillness.noise_grey > MOST_NOISE * usual
    memory.odd = stillness.unexplained or noisy
    other_light = rest.dense and stillness.light_share > MOST_LIGHT_SHARE
    frame.changed |= other_light
    # Contrast that blur has removed does not return with more light.
    lit = other_light or (memory.gone and not memory.soft) or stillness.noise_grey > BEYOND_NOISE * usual
    memory.told = lit * FORCE.REASON_LIGHT_CHANGED | noisy * FORCE.REASON_BLURRED
