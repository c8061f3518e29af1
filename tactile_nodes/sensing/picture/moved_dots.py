"""Removes the motion of the whole picture from that of printed dots.

A touch on a few dozen dots moves most of them. So the number of dots that move alike does not tell whether the camera
was knocked, as that of patches does (`registration`). Here it was knocked if the motion of the whole picture explains
that of all dots: then nothing touches. This motion is removed from then on, in contact too, until dots at rest show
another one.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from tactile_nodes.sensing.flow.methods import DisplacementField
from tactile_nodes.sensing.picture.motion import MotionFit, PictureMotion
from tactile_nodes.shapes import Bool, Float, Float32

KNOCK_PX = 0.15
"""Least motion of a knock (root mean square). Readouts find smaller motion of the camera together with the forces."""

LEFT_PX, LEFT_PART = 0.04, 0.02
"""Largest motion that a knock leaves in the regions (root mean square), and part of its own motion on top of that.

Knocks by 0.3 to 3 px, turns to 1° and growth by 1 % leave 0.02 to 0.04 px in simulated pictures of dots. Touches leave
a third of their common motion or more in recordings of a GelSight Mini, and a tip more than all of it. Only a body that
covers the whole gel and drags it leaves as little as a knock.
"""

MOST_BENT = 0.25
"""Largest share of bends in it. A knock that tilts a camera with a view of 60° has 0.13."""

LEAST_FOUND, FOUND = 0.5, 0.4
"""Least share of the regions with dots, and the confidence from which on a region has some."""

SETTLE_FRAMES = 8
"""Frames after a knock over which the motion of each region is averaged. The knock's own may show it on its way."""


class MovedDots:
    """The motion of the whole picture since the rest image, which is removed from that of dots.

    `motion` is its common part, and `size_px` the root mean square of that over the picture. More than `most_px` is not
    removed.
    """

    def __init__(self, most_px: float = 8.0) -> None:
        self._most_px = most_px
        self.at_rest()

    def at_rest(self) -> None:
        """The picture is where it was in the rest image."""
        self.motion, self.size_px = PictureMotion(), 0.0
        self._moved: Float32[np.ndarray, 'rows cols 2'] | None = None
        self._settled = SETTLE_FRAMES

    def without(self, field: DisplacementField, shape: tuple[int, ...], *, compiled: bool = False) -> DisplacementField:
        """The motion of dots since the rest image, in a picture of `shape`, without that of the whole picture."""
        assert field.confidence is not None
        motion, found = field.displacement_px, field.confidence >= FOUND
        beside = motion if self._moved is None else motion - self._moved
        fit = _fit(shape, *found.shape, compiled)
        terms = self._untouched(beside, found, fit)
        knocked = terms is not None and fit.size_px(terms) >= KNOCK_PX
        self._settled = 0 if knocked else self._settled + 1
        if terms is None or not (knocked or self._settled <= SETTLE_FRAMES):
            return DisplacementField(beside, field.confidence)
        share = np.float32(1 / max(self._settled, 1))
        self._moved = (motion - beside) + share * np.where(found[:, :, None], beside, _carried(terms, fit, found.shape))
        self.motion = self.motion + PictureMotion.of(float(share) * terms)
        self.size_px = fit.size_px(np.array(self.motion.terms))
        return DisplacementField(motion - self._moved, field.confidence)

    def _untouched(
        self, motion: Float32[np.ndarray, 'rows cols 2'], found: Bool[np.ndarray, 'rows cols'], fit: MotionFit
    ) -> Float[np.ndarray, ' terms'] | None:
        """The motion of the whole picture, if it explains that of all dots."""
        if found.mean() < LEAST_FOUND or not np.isfinite(motion[found]).all():
            return None
        terms = fit.common(
            np.where(found[:, :, None], motion, 0).reshape(-1, 2).astype(float), found.ravel().astype(float)
        )
        size_px, left = fit.size_px(terms), (motion - _carried(terms, fit, found.shape))[found]
        if math.sqrt(float(np.square(left).sum(axis=1).mean())) > LEFT_PX + LEFT_PART * size_px:
            return None
        if size_px >= KNOCK_PX and fit.bent(terms) > MOST_BENT:
            return None
        return terms if fit.size_px(terms + np.array(self.motion.terms)) <= self._most_px else None


def _carried(
    terms: Float[np.ndarray, ' terms'], fit: MotionFit, shape: tuple[int, ...]
) -> Float32[np.ndarray, 'rows cols 2']:
    return fit.carried(terms).reshape(*shape, 2).astype(np.float32)


@lru_cache(maxsize=8)
def _fit(shape: tuple[int, ...], rows: int, cols: int, compiled: bool) -> MotionFit:
    return MotionFit(shape, rows, cols, compiled=compiled)
