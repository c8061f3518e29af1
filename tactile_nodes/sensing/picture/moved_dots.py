"""Removes the motion of the whole picture from that of printed dots.

A touch on a few dozen dots moves most of them. So the number of dots that move alike does not tell whether the camera
was knocked, as that of patches does (`registration`). Here it was knocked if the motion of the whole picture explains
that of all dots: then nothing touches. This motion is removed from then on, in contact too, until dots at rest show
another one.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tactile_nodes.sensing.flow.methods import DisplacementField
from tactile_nodes.sensing.picture.motion import MotionFit, PictureMotion, motion_fit
from tactile_nodes.shapes import Float, Float32

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
"""Least share found of the regions with dots at rest, and the confidence from which on a region has some."""

SETTLE_FRAMES = 8
"""Frames after a knock over which the motion of each region is averaged. The knock's own may show it on its way."""


class MovedDots:
    """The motion of the whole picture since the rest image, which is removed from that of dots.

    `motion` is its common part, and `size_px` the root mean square of that over the picture. `lost`: it is more than
    `most_px`, and is not removed.
    """

    def __init__(self, most_px: float = 8.0) -> None:
        self._most_px = most_px
        self.at_rest()

    def at_rest(self) -> None:
        """The picture is where it was in the rest image."""
        self.motion, self.size_px, self.lost = PictureMotion(), 0.0, False
        self._moved = np.zeros((1, 1, 2), np.float32)
        self._settled = SETTLE_FRAMES

    def without(
        self,
        field: DisplacementField,
        at_rest: Float32[np.ndarray, 'rows cols'],
        shape: tuple[int, ...],
        *,
        compiled: bool = False,
    ) -> DisplacementField:
        """The motion of dots since the rest image, in a picture of `shape`, without that of the whole picture.

        `at_rest` is the confidence of the regions in the rest image itself; covered ones have none.
        """
        assert field.confidence is not None
        motion, found = field.displacement_px, field.confidence >= FOUND
        beside = motion - self._moved
        self._settled += 1
        if found.sum() >= LEAST_FOUND * (at_rest >= FOUND).sum() and np.isfinite(motion[found]).all():
            fit = motion_fit(shape, *found.shape, compiled=compiled)
            terms = fit.common_of_regions(beside, found)
            carried = fit.carried(terms).reshape(beside.shape).astype(np.float32)
            self.lost = fit.size_px(terms + np.array(self.motion.terms)) > self._most_px
            if not self.lost and self._knocked(fit, terms, (beside - carried)[found]):
                self._take(fit, terms, np.where(found[:, :, None], beside, carried))
        return replace(field, displacement_px=motion - self._moved)

    def _knocked(
        self, fit: MotionFit, terms: Float[np.ndarray, ' terms'], left: Float32[np.ndarray, 'found 2']
    ) -> bool:
        """Whether a motion of the whole picture that leaves so much is a knock, or the camera settles after one."""
        size_px = fit.size_px(terms)
        if math.sqrt(float(np.square(left).sum(axis=1).mean())) > LEFT_PX + LEFT_PART * size_px:
            return False
        if size_px < KNOCK_PX:
            return self._settled <= SETTLE_FRAMES
        if fit.bent(terms) > MOST_BENT:
            return False
        self._settled = 0
        return True

    def _take(
        self, fit: MotionFit, terms: Float[np.ndarray, ' terms'], moved: Float32[np.ndarray, 'rows cols 2']
    ) -> None:
        """Remove this motion, or the mean of it and of that since the knock."""
        share = np.float32(1 / max(self._settled, 1))
        self._moved = self._moved + share * moved
        self.motion = self.motion + PictureMotion.of(float(share) * terms)
        self.size_px = fit.size_px(np.array(self.motion.terms))
