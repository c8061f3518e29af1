"""Detects a rest image that was captured during a touch, from the frames after the touch has ended.

A press moves the gel around it away from the place. Relative to a pressed rest image, a gel at rest moves towards the
place, and no press causes such motion. So the frames after the rest image are averaged until their mean shows it. A
touch held still since the capture looks like rest, so such frames prove little, and each of them restarts the average.
"""

from __future__ import annotations

import numpy as np

from tactile_nodes.sensing.picture.quietness import PATCHES, PLACES, QUIET_NOISE, noise_of, none_away
from tactile_nodes.shapes import Bool, Float

TOWARDS_NOISE, TOWARDS_OVER_AWAY = 8.0, 2.0
"""Limits of a dent: mean motion towards a place, in units of its noise, and its ratio to the motion away from any.

Over eight frames the first is 18 after a touch of 15 mN, 34 after 29 mN, and 3 to 6 without a touch (7.5 if the blur
changed). The second is 4 or more after a touch, and 1.3 without. When tips, balls and punches are released the second
is 3.8 to 8.6. While anything presses, a ring of 3 to 8 mm and dragged tips included, it is 0.1 to 0.8.
"""

LEAST_NOISE_PX = 0.0003
LEAST_FRAMES, PROVEN_FRAMES, LASTING_FRAMES = 4, 8, 30
"""Frames averaged before a dent is accepted; number of frames surely at rest after which more are needed; that larger
number. A gel that sticks to a body that leaves is pulled for a moment."""


class DentedRest:
    """Judges a rest image from the frames after it.

    `dented`: it was captured during a touch. `dent` is the resulting motion of the patches, px.
    """

    def __init__(self) -> None:
        self.dented = False
        self.dent: Float[np.ndarray, 'patches 2'] = np.zeros((PATCHES * PATCHES, 2))
        self._count = self._clean = 0

    def rested(self, surely: bool) -> None:
        """Take whether one more frame is surely at rest."""
        self._clean += surely
        if surely:
            self._average_anew()

    def without(
        self, left: Float[np.ndarray, 'patches 2'], found: Bool[np.ndarray, ' patches'], *, settled: bool
    ) -> Float[np.ndarray, 'patches 2']:
        """The residual motion of the patches without the dent. The dent is learnt only while `settled`."""
        if settled:
            self._take(left, found)
        return left - self.dent if self.dented else left

    def _take(self, left: Float[np.ndarray, 'patches 2'], found: Bool[np.ndarray, ' patches']) -> None:
        """Take one more frame. A frame with a press is skipped, unless it looks like rest without the dent."""
        beside = left - self.dent if self.dented else left
        away, towards = _most(beside, found)
        quiet = QUIET_NOISE * noise_of(beside[found])
        if away > max(quiet, towards):
            self.dented = self.dented and not none_away(left, found, QUIET_NOISE)
            self._average_anew()
            return
        if self.dented and towards > quiet:  # the release is still going on
            self._count = 0
        self._count += 1
        mean = self.dent + (left - self.dent) / self._count
        self.dent = np.where(found[:, None], mean, self.dent)
        self.dented = self.dented or self._shows(found)

    def _average_anew(self) -> None:
        """Restart the average, as a touch held still may be released from now on."""
        if self._clean >= PROVEN_FRAMES and not self.dented:
            self._count = 0

    def _shows(self, found: Bool[np.ndarray, ' patches']) -> bool:
        """Whether the mean motion shows a dent."""
        if self._count < (LEAST_FRAMES if self._clean < PROVEN_FRAMES else LASTING_FRAMES):
            return False
        away, towards = _most(self.dent, found)
        return towards > max(TOWARDS_NOISE * noise_of(self.dent, LEAST_NOISE_PX), TOWARDS_OVER_AWAY * away)


def _most(motion: Float[np.ndarray, 'patches 2'], found: Bool[np.ndarray, ' patches']) -> tuple[float, float]:
    """The largest motion away from any place, and towards any place."""
    away = PLACES.away(np.where(found[:, None], motion, 0.0).astype(np.float32))
    return float(away.max()), float(-away.min())
