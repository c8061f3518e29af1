"""Which motion of a whole picture is a knock of its camera, which a press, and which neither."""

from __future__ import annotations

from enum import Enum, auto

import numpy as np
from jaxtyping import Float

KNOCK_PX = 0.05
"""Common motion from which the camera was knocked: presses of the tip to 2 mm reach 0.026 px."""

ALIKE_PX, ALIKE_PART, ALIKE_MOST_PX = 0.05, 1 / 6, 0.22
"""Patches follow a common motion to within this much and this part of it, up to a limit: of a knock by 5 px half of
them are off by less than 0.03 px, of a turn by 2° by less than 0.1 px."""

ALIKE_SHARE = 0.5
"""Share of the patches that must follow it."""

EASED = 0.6
"""It explains what is seen when the median motion falls below this share of what it was."""

MISSHAPEN_PX, MISSHAPEN_SHARE = 0.35, 0.75
"""No contacts make so much common motion (three of 2 mm 0.07 px), and of a knock or another lens 95 % of the patches
follow it. A gel that swells by 0.2 mm moves all of its picture by 0.48 px, and half of the patches otherwise."""


class Common(Enum):
    """What a common motion is."""

    NONE = auto()
    KNOCK = auto()
    MISSHAPEN = auto()


def judge(motion: Float[np.ndarray, 'n 2'], carried: Float[np.ndarray, 'n 2'], size_px: float) -> Common:
    """What the patches' motion is, of which `carried` is common, with a root mean square of `size_px`.

    A knock moves most patches alike, and further than any press moves them.
    """
    if size_px < KNOCK_PX:
        return Common.NONE
    left = np.hypot(*(motion - carried).T)
    alike = float((left < min(ALIKE_PX + ALIKE_PART * size_px, ALIKE_MOST_PX)).mean())
    if size_px > MISSHAPEN_PX and alike < MISSHAPEN_SHARE:
        return Common.MISSHAPEN
    eased = float(np.median(left)) < EASED * float(np.median(np.hypot(*motion.T)))
    return Common.KNOCK if alike >= ALIKE_SHARE and eased else Common.NONE
