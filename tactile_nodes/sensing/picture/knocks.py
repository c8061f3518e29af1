"""Which motion of a whole picture is a knock of its camera, which a press, and which neither."""

from __future__ import annotations

import math
from enum import Enum, auto

import numpy as np
from jaxtyping import Float

from tactile_nodes.sensing.picture.motion import TERMS
from tactile_nodes.sensing.picture.quietness import median

KNOCK_PX = 0.05
"""Common motion from which the camera was knocked: presses of the tip to 2 mm reach 0.026 px."""

ALIKE_PX, ALIKE_PART, ALIKE_MOST_PX = 0.05, 1 / 6, 0.22
"""Patches follow a common motion to within this much and this part of it, up to a limit: of a knock by 5 px half of
them are off by less than 0.03 px, of a turn by 2° by less than 0.1 px."""

ALIKE_SHARE = 0.5
"""Share of the patches that must follow it."""

EASED = 0.35
"""It explains what is seen when the median motion falls below this share of what it was: to 0.1 where the camera was
knocked by 0.1 px under a tip, to 0.3 under a hard, wide contact; to 0.4 to 0.7 where such a contact drags the gel."""

MISSHAPEN_PX, MISSHAPEN_SHARE = 0.35, 0.75
"""No contacts make so much common motion (three of 2 mm 0.07 px), and of a knock or another lens 95 % of the patches
follow it. A gel that swells by 0.2 mm moves all of its picture by 0.48 px, and half of the patches otherwise."""


USUAL_NOISE_PX, NOISE_SIGMAS = 0.003, 3.0
"""Noise of a patch at rest that the limit knows (0.0023 px on the simulated gel), and how far more of it may carry what
is common: by so many standard deviations. A camera eight times as noisy has 0.017 px, and presses reach 0.05 px."""


class Common(Enum):
    """What a common motion is."""

    NONE = auto()
    KNOCK = auto()
    MISSHAPEN = auto()


def judge(
    motion: Float[np.ndarray, 'n 2'], carried: Float[np.ndarray, 'n 2'], size_px: float, noise_px: float = 0.0
) -> Common:
    """What the patches' motion is, of which `carried` is common, with a root mean square of `size_px`.

    A knock moves most patches alike, and further than any press, and a noise of `noise_px` in each patch, moves them.
    """
    if size_px < KNOCK_PX + noise_allowance_px(noise_px, len(motion)):
        return Common.NONE
    left = _lengths(motion - carried)
    alike = float((left < min(ALIKE_PX + ALIKE_PART * size_px, ALIKE_MOST_PX)).mean())
    if size_px > MISSHAPEN_PX and alike < MISSHAPEN_SHARE:
        return Common.MISSHAPEN
    eased = median(left) < EASED * median(_lengths(motion))
    return Common.KNOCK if alike >= ALIKE_SHARE and eased else Common.NONE


def _lengths(motion: Float[np.ndarray, 'n 2']) -> Float[np.ndarray, ' n']:
    x, y = motion.T
    lengths: np.ndarray = np.hypot(x, y)
    return lengths


def noise_allowance_px(noise_px: float, patches: int) -> float:
    """How far noise beyond the usual may carry what is common to so many patches (root mean square).

    Least squares lets eight terms follow 8 / 200 of what 100 patches, two numbers each, move by chance along either
    axis: with 0.01 px too much in each that is 3 x 0.01 x sqrt(2 x 8 / 200) = 0.0085 px.
    """
    too_much = max(0.0, noise_px - USUAL_NOISE_PX)
    return NOISE_SIGMAS * too_much * math.sqrt(TERMS / patches)
