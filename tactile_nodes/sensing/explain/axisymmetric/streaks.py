"""What it changes that a region of the image sees its markers in a streak.

Away from the middle the camera looks aslant through the gel. A region then sees the markers near the surface further
out than the deep ones below them, in a streak that points to the middle. Two things follow. Near a press, where what
lies at the surface moves most, the region looks elsewhere than it does far from one: a shift. And what it shows is the
mean over the streak's length, as if distances along the streak were shorter: a squeeze.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

STREAK_MM = 15.0
"""How far from the middle a region looks whose streak counts as 1; the shift grows with that, the squeeze squared."""
NEAR_MM, WIDE_MM = 3.0, 6.0
"""From about these distances to a press on, of the order of the gel's thickness, shift and squeeze fade."""


@dataclass(frozen=True)
class Streak:
    """Where regions that look aslant see a press: further out by `shift_mm`, nearer along the streak by `squeeze`.

    With a squeeze of 0.1 a press 1 mm further out than a region that is 15 mm from the middle shows as if it were
    0.9 mm away (a little more: 1 mm is not nothing against `WIDE_MM`), and one 1 mm beside it as it is.
    """

    shift_mm: float = 0.0
    squeeze: float = 0.0

    @staticmethod
    def aslant(places: Float[np.ndarray, '*n 2']) -> Float[np.ndarray, '*n 2']:
        """Direction and size of the streaks of regions at these places (mm)."""
        aslant: np.ndarray = places / STREAK_MM
        return aslant

    def shown(self, away: Float[np.ndarray, '*n 2'], places: Float[np.ndarray, '*m 2']) -> Float[np.ndarray, '*n 2']:
        """Vectors from regions to presses (mm) as the regions show them."""
        aslant = self.aslant(places)
        square, along = _product(away, away), _product(away, aslant)
        further = self.shift_mm / (1 + square / NEAR_MM**2) - self.squeeze * along / (1 + square / WIDE_MM**2)
        shown: np.ndarray = away + further[..., None] * aslant
        return shown

    def slopes(self, away: Float[np.ndarray, '*n 2'], places: Float[np.ndarray, '*m 2']) -> Float[np.ndarray, '*n 2']:
        """How much further along the streak (mm, of a streak of 1) a press shows for each mm along x and y."""
        by_shift, by_squeeze = self.levers(away, places)
        square = _product(away, away)
        near, wide = (1 / (1 + square / each**2) for each in (NEAR_MM, WIDE_MM))
        fading = by_shift * near * self.shift_mm / NEAR_MM**2 + by_squeeze * wide * self.squeeze / WIDE_MM**2
        slopes: np.ndarray = -2 * fading[..., None] * away - (self.squeeze * wide)[..., None] * self.aslant(places)
        return slopes

    def levers(
        self, away: Float[np.ndarray, '*n 2'], places: Float[np.ndarray, '*m 2']
    ) -> tuple[Float[np.ndarray, '*n'], Float[np.ndarray, '*n']]:
        """How much further along the streak (mm, of a streak of 1) a press shows for a shift and a squeeze of 1."""
        square, along = _product(away, away), _product(away, self.aslant(places))
        return 1 / (1 + square / NEAR_MM**2), -along / (1 + square / WIDE_MM**2)


def _product(a: Float[np.ndarray, '*n 2'], b: Float[np.ndarray, '*m 2']) -> Float[np.ndarray, '*n']:
    """Of vectors in pairs: several times as fast as a sum over an axis of two."""
    product: np.ndarray = a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1]
    return product
