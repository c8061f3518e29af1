"""Decides whether motion of the whole picture is a knock of the camera, a press, or neither."""

from __future__ import annotations

import math
from enum import Enum, auto

import numpy as np

from tactile_nodes.sensing.picture.motion import TERMS, MotionFit
from tactile_nodes.sensing.picture.quietness import median
from tactile_nodes.shapes import Bool, Float

KNOCK_PX = 0.05
"""Least common motion of a knock of the camera. Presses of the tip to 2 mm reach 0.026 px."""

ALIKE_PX, ALIKE_PART, ALIKE_MOST_PX = 0.05, 1 / 6, 0.22
"""Patches follow a common motion if they are within this much plus this part of it, up to a limit. After a knock by
5 px half of them are within 0.03 px, after a turn by 2° within 0.1 px."""

ALIKE_SHARE = 0.5
"""Share of the patches that must follow the common motion."""

EASED = 0.35
"""A knock is accepted if its removal lowers the median motion below this share: to 0.1 after a knock by 0.1 px under a
tip, to 0.3 under a hard, wide contact, but to 0.4 to 0.7 if such a contact drags the gel."""

BENT = 0.5
"""Largest share of bends in a knock's common motion (root mean square). With a view of 45° to either side it is 0.4 for
a tilt, and less the narrower the view. A contact near a corner of a gel that is thick for its size moves far patches
smoothly, often mostly as bends."""

FAR_PERCENT, FAR_PART = 95, 7
"""If not, one patch in twenty still moves by more than nine times as much on its own (balls of 5 mm and punches of 2 mm
all over `speckle_membrane` and `9dtact_like`, with up to three times the force to which the gel responds linearly)."""

MISSHAPEN_PX, MISSHAPEN_SHARE = 0.35, 0.75
"""No contact on the simulated sensor causes so much common motion (three of 2 mm: 0.07 px), and after a knock or with
another lens 95 % of the patches follow it. A gel that swells by 0.2 mm moves its picture by 0.48 px, and half of the
patches do not follow."""

PRESSED_PERCENT, PRESSED_PART = 80, 1.5
"""On a gel that is thick for its size, contacts cause it, too: a ball with 4 N moves the picture of `speckle_membrane`
by 0.9 px. But one patch in five moves by more than twice as much on its own, in a gel that swells by at most 1.1 times
as much."""


USUAL_NOISE_PX, NOISE_SIGMAS = 0.003, 3.0
"""Patch noise at rest included in the limit (0.0023 px on the simulated gel), and number of standard deviations that
extra noise may add to the common motion. With an eight times noisier camera (0.017 px) presses reach 0.05 px."""


class Common(Enum):
    """The cause of a common motion."""

    NONE = auto()
    KNOCK = auto()
    MISSHAPEN = auto()


def whole_motion(
    fit: MotionFit, motion: Float[np.ndarray, 'n 2'], found: Bool[np.ndarray, ' n'], noise_px: float = 0.0
) -> tuple[Float[np.ndarray, ' terms'], Common]:
    """The common motion of the patches that were `found` in a frame, and its cause."""
    weight = found.astype(float)
    terms = fit.common(motion, weight, rounds=2, about_none=True)
    if fit.size_px(terms) <= 0.7 * KNOCK_PX:
        return terms, Common.NONE
    terms = fit.common(motion, weight)
    carried = fit.carried(terms)
    return terms, judge(motion[found], carried[found], fit.size_px(terms), noise_px, fit.bent(terms))


def judge(
    motion: Float[np.ndarray, 'n 2'],
    carried: Float[np.ndarray, 'n 2'],
    size_px: float,
    noise_px: float = 0.0,
    bent: float = 0.0,
) -> Common:
    """Classify the patches' motion, whose common part `carried` has a root mean square of `size_px`.

    A knock moves most patches alike, and further than any press together with a noise of `noise_px` per patch. Not more
    than a part of its motion are bends, whose share is `bent`.
    """
    left = _lengths(motion - carried)
    of_press_px = np.percentile(left, FAR_PERCENT) / FAR_PART
    if size_px < max(KNOCK_PX + noise_allowance_px(noise_px, len(motion)), of_press_px):
        return Common.NONE
    alike = float((left < min(ALIKE_PX + ALIKE_PART * size_px, ALIKE_MOST_PX)).mean())
    pressed = size_px > MISSHAPEN_PX and np.percentile(left, PRESSED_PERCENT) > PRESSED_PART * size_px
    if size_px > MISSHAPEN_PX and alike < MISSHAPEN_SHARE and not pressed:
        return Common.MISSHAPEN
    eased = median(left) < EASED * median(_lengths(motion))
    return Common.KNOCK if alike >= ALIKE_SHARE and eased and bent <= BENT else Common.NONE


def _lengths(motion: Float[np.ndarray, 'n 2']) -> Float[np.ndarray, ' n']:
    x, y = motion.T
    lengths: np.ndarray = np.hypot(x, y)
    return lengths


def noise_allowance_px(noise_px: float, patches: int) -> float:
    """Common motion of `patches` patches that noise above the usual may cause (root mean square).

    A least-squares fit of eight terms to 100 patches with two numbers each follows 8 / 200 of the noise variance: with
    0.01 px extra noise that is 3 x 0.01 x sqrt(2 x 8 / 200) = 0.0085 px.
    """
    too_much = max(0.0, noise_px - USUAL_NOISE_PX)
    return NOISE_SIGMAS * too_much * math.sqrt(TERMS / patches)
