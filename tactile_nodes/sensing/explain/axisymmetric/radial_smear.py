"""Radial smear: away from the middle a region of the image sees its markers along a radial line.

There the camera looks obliquely through the gel. A region sees markers near the surface further out than the deep
markers below them, along a line that points to the middle. This has two effects. Near a press, where the surface moves
most, the region effectively looks at another place than far from a press: a shift. And it shows the mean over the
length of the line, as if distances along the line were shorter: a squeeze.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_nodes.shapes import Float

SMEAR_MM = 15.0
"""Distance from the middle at which a smear counts as 1; the shift grows with it, the squeeze with its square."""
NEAR_MM, WIDE_MM = 3.0, 6.0
"""Distances to a press, of the order of the gel's thickness, from which on shift and squeeze decay."""


@dataclass(frozen=True)
class RadialSmear:
    """Where regions that look obliquely see a press: further out by `shift_mm`, nearer along the smear by `squeeze`.

    With a squeeze of 0.1, a region 15 mm from the middle shows a press 1 mm further out as if it were 0.9 mm away (a
    little more, since 1 mm is not negligible against `WIDE_MM`). A press 1 mm to the side is not changed.
    """

    shift_mm: float = 0.0
    squeeze: float = 0.0

    @staticmethod
    def aslant(places: Float[np.ndarray, '*n 2']) -> Float[np.ndarray, '*n 2']:
        """Direction and size of the smear of regions at these places [mm]."""
        aslant: np.ndarray = places / SMEAR_MM
        return aslant

    def shown(self, away: Float[np.ndarray, '*n 2'], places: Float[np.ndarray, '*m 2']) -> Float[np.ndarray, '*n 2']:
        """Vectors from regions to presses [mm] as the regions show them."""
        aslant = self.aslant(places)
        square, along = _product(away, away), _product(away, aslant)
        further = self.shift_mm / (1 + square / NEAR_MM**2) - self.squeeze * along / (1 + square / WIDE_MM**2)
        shown: np.ndarray = away + further[..., None] * aslant
        return shown

    def slopes(self, away: Float[np.ndarray, '*n 2'], places: Float[np.ndarray, '*m 2']) -> Float[np.ndarray, '*n 2']:
        """Derivatives of the shift of a press along the smear (for a smear of 1) with respect to x and y."""
        by_shift, by_squeeze = self.levers(away, places)
        square = _product(away, away)
        near, wide = (1 / (1 + square / each**2) for each in (NEAR_MM, WIDE_MM))
        fading = by_shift * near * self.shift_mm / NEAR_MM**2 + by_squeeze * wide * self.squeeze / WIDE_MM**2
        slopes: np.ndarray = -2 * fading[..., None] * away - (self.squeeze * wide)[..., None] * self.aslant(places)
        return slopes

    def levers(
        self, away: Float[np.ndarray, '*n 2'], places: Float[np.ndarray, '*m 2']
    ) -> tuple[Float[np.ndarray, '*n'], Float[np.ndarray, '*n']]:
        """Shift of a press along the smear (mm, for a smear of 1) per unit of shift and of squeeze."""
        square, along = _product(away, away), _product(away, self.aslant(places))
        return 1 / (1 + square / NEAR_MM**2), -along / (1 + square / WIDE_MM**2)


def _product(a: Float[np.ndarray, '*n 2'], b: Float[np.ndarray, '*m 2']) -> Float[np.ndarray, '*n']:
    """Dot products of vectors in pairs: several times as fast as a sum over an axis of two."""
    product: np.ndarray = a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1]
    return product
