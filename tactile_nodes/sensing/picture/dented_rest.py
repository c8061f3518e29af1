"""Was the rest image taken while something touched? The first frames beside it tell, once that has gone.

A press moves what is around it away; beside a rest image that was pressed a gel at rest moves towards the place, and
nothing that presses makes such motion. So frames are averaged, from the rest image on, until some are surely at rest or
their mean shows it.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from tactile_nodes.sensing.picture.quietness import PATCHES, PLACES, QUIET_NOISE, noise_of

TOWARDS_NOISE, TOWARDS_OVER_AWAY = 8.0, 2.0
"""Motion of the mean of frames towards a place, in units of its noise and over that away from any, that shows a dent.

Of eight frames the first is 18 after a touch of 15 mN and 34 after one of 29 mN, and 3 to 6 without any (7.5 where blur
changed); the second is 4 or more, and 1.3 without any.
"""

LEAST_NOISE_PX = 0.0003
LEAST_FRAMES, PROVEN_FRAMES = 4, 8
"""Frames averaged before a dent is believed, and frames surely at rest after which there is none."""


class DentedRest:
    """What the frames since a rest image say of it.

    `dented`: it was taken while something touched. `dent` is what patches move by for that, px.
    """

    def __init__(self) -> None:
        self.dented = False
        self.dent: Float[np.ndarray, 'patches 2'] = np.zeros((PATCHES * PATCHES, 2))
        self._count = self._clean = 0

    @property
    def known(self) -> bool:
        """Whether there is nothing more to find out."""
        return self.dented or self._clean >= PROVEN_FRAMES

    def rested(self, surely: bool) -> None:
        """Take whether one frame more is surely at rest."""
        self._clean += surely

    def without(
        self, left: Float[np.ndarray, 'patches 2'], found: Bool[np.ndarray, ' patches'], *, settled: bool
    ) -> Float[np.ndarray, 'patches 2']:
        """The motion of patches beside the whole picture's, if that is `settled`, without what the dent makes of it."""
        if settled and not self.known:
            self._take(left, found)
        return left - self.dent if self.dented else left

    def _take(self, left: Float[np.ndarray, 'patches 2'], found: Bool[np.ndarray, ' patches']) -> None:
        """One frame more; those in which something presses say nothing."""
        away = PLACES.away(np.where(found[:, None], left, 0.0).astype(np.float32))
        if float(away.max()) > max(QUIET_NOISE * noise_of(left[found]), float(-away.min())):
            return
        self._count += 1
        mean = self.dent + (left - self.dent) / self._count
        self.dent = np.where(found[:, None], mean, self.dent)
        if self._count < LEAST_FRAMES:
            return
        away = PLACES.away(self.dent.astype(np.float32))
        towards, noise_px = float(-away.min()), noise_of(self.dent, LEAST_NOISE_PX)
        self.dented = towards > max(TOWARDS_NOISE * noise_px, TOWARDS_OVER_AWAY * float(away.max()))
