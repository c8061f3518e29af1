"""Was the rest image taken while something touched? The frames beside it tell, once that has gone.

A press moves what is around it away; beside a rest image that was pressed a gel at rest moves towards the place, and
nothing that presses makes such motion. So frames are averaged, from the rest image on, until their mean shows it. What
is held still since then looks at rest, so frames that do prove little: from each of them on frames are averaged anew.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from tactile_nodes.sensing.picture.quietness import PATCHES, PLACES, QUIET_NOISE, noise_of, none_away

TOWARDS_NOISE, TOWARDS_OVER_AWAY = 8.0, 2.0
"""Motion of the mean of frames towards a place, in units of its noise and over that away from any, that shows a dent.

Of eight frames the first is 18 after a touch of 15 mN and 34 after one of 29 mN, and 3 to 6 without any (7.5 where blur
changed); the second is 4 or more, and 1.3 without any. Of tips, balls and punches that are let go the second is 3.8 to
8.6; of whatever presses, a ring of 3 to 8 mm and dragged tips included, 0.1 to 0.8.
"""

LEAST_NOISE_PX = 0.0003
LEAST_FRAMES, PROVEN_FRAMES, LASTING_FRAMES = 4, 8, 30
"""Frames averaged before a dent is believed, frames surely at rest after which that takes longer, and how many then: a
gel that sticks to what leaves it is pulled for a moment."""


class DentedRest:
    """What the frames since a rest image say of it.

    `dented`: it was taken while something touched. `dent` is what patches move by for that, px.
    """

    def __init__(self) -> None:
        self.dented = False
        self.dent: Float[np.ndarray, 'patches 2'] = np.zeros((PATCHES * PATCHES, 2))
        self._count = self._clean = 0

    def rested(self, surely: bool) -> None:
        """Take whether one frame more is surely at rest."""
        self._clean += surely
        if surely:
            self._average_anew()

    def without(
        self, left: Float[np.ndarray, 'patches 2'], found: Bool[np.ndarray, ' patches'], *, settled: bool
    ) -> Float[np.ndarray, 'patches 2']:
        """The motion of patches beside the whole picture's, if that is `settled`, without what the dent makes of it."""
        if settled:
            self._take(left, found)
        return left - self.dent if self.dented else left

    def _take(self, left: Float[np.ndarray, 'patches 2'], found: Bool[np.ndarray, ' patches']) -> None:
        """One frame more. Those in which something presses say nothing, unless that is what no dent would look like."""
        beside = left - self.dent if self.dented else left
        away, towards = _most(beside, found)
        quiet = QUIET_NOISE * noise_of(beside[found])
        if away > max(quiet, towards):
            self.dented = self.dented and not none_away(left, found, QUIET_NOISE)
            self._average_anew()
            return
        if self.dented and towards > quiet:  # it is still being let go
            self._count = 0
        self._count += 1
        mean = self.dent + (left - self.dent) / self._count
        self.dent = np.where(found[:, None], mean, self.dent)
        self.dented = self.dented or self._shows(found)

    def _average_anew(self) -> None:
        """What is held still may be let go from now on."""
        if self._clean >= PROVEN_FRAMES and not self.dented:
            self._count = 0

    def _shows(self, found: Bool[np.ndarray, ' patches']) -> bool:
        """Whether the mean is a dent."""
        if self._count < (LEAST_FRAMES if self._clean < PROVEN_FRAMES else LASTING_FRAMES):
            return False
        away, towards = _most(self.dent, found)
        return towards > max(TOWARDS_NOISE * noise_of(self.dent, LEAST_NOISE_PX), TOWARDS_OVER_AWAY * away)


def _most(motion: Float[np.ndarray, 'patches 2'], found: Bool[np.ndarray, ' patches']) -> tuple[float, float]:
    """The most that goes away from any place, and towards any."""
    away = PLACES.away(np.where(found[:, None], motion, 0.0).astype(np.float32))
    return float(away.max()), float(-away.min())
