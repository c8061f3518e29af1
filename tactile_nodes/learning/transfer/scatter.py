"""The covariance of regions about the typical ones, radially and tangentially, as caused by the depths of markers.

Markers that lie deeper than usual are seen further out or in, and all that their region shows changes with it. On one
side of the image such a place moves left, on the other side right. In the radial direction the effect is the same
everywhere, and grows with the distance from the image centre.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_nodes.sensing.explain.axisymmetric.response import AxisymmetricResponse
from tactile_nodes.shapes import Float

RING = 0.2
"""Share of the image's half width: regions whose distances from the centre differ by this have a weight of 0.61."""
ALL_ROUND = 0.3
"""The share of the covariance that is the same at all distances, since few regions share one distance."""
LEAST_SCATTER = 1e-5


@dataclass(frozen=True)
class Scatter:
    """Deviations of a known gel's regions, radially and tangentially, and their distances from the image centre.

    `mirror` is 1 for numbers that keep their sign in a mirror image of a gel, and -1 for those that change it.
    """

    off: Float[np.ndarray, 'regions numbers']
    distances: Float[np.ndarray, ' regions']
    mirror: Float[np.ndarray, ' numbers']
    lateral: int

    @classmethod
    def of(
        cls,
        response: AxisymmetricResponse,
        off: Float[np.ndarray, 'regions numbers'],
        view: Float[np.ndarray, 'regions 2'],
        free: int,
    ) -> Scatter:
        """From the deviations of regions at `view` (-1 to 1), in the order of `numbers_of`.

        The deviations are from smooth functions that have `free` numbers each.
        """
        count, lateral = response.couplings.shape[2], response.lateral
        mirror = _mirror(count, lateral)
        turned = np.einsum('rij,rj->ri', outwards(view, count, lateral), off)
        unbiased = np.sqrt(len(off) / max(len(off) - free, 1))
        return cls(turned * unbiased, np.hypot(*view.T), mirror, lateral)

    def covariance(self, view: Float[np.ndarray, 'regions 2']) -> Float[np.ndarray, 'regions numbers numbers']:
        """The covariance for regions at these places in the image, along x and y again."""
        distances = np.minimum(np.hypot(*view.T), self.distances.max())
        alike = np.exp(-np.square(distances[:, None] - self.distances) / (2 * RING**2))
        near = np.einsum('nr,ri,rj->nij', alike / alike.sum(axis=1, keepdims=True), self.off, self.off, optimize=True)
        everywhere = self.off.T @ self.off / len(self.off)
        # A gel is as likely as its mirror image, so numbers that change sign there do not correlate with the others.
        alone = self.mirror[:, None] == self.mirror
        outward = ((1 - ALL_ROUND) * near + ALL_ROUND * everywhere) * alone + LEAST_SCATTER * np.eye(len(alone))
        turn = outwards(view, len(self.mirror) // 2 - 1, self.lateral)
        covariance: np.ndarray = turn.transpose(0, 2, 1) @ outward @ turn
        return covariance


def outwards(
    view: Float[np.ndarray, 'regions 2'], columns: int, lateral: int
) -> Float[np.ndarray, 'regions numbers numbers']:
    """The rotation of numbers along x and y into radial and tangential ones in the image."""
    along = view / np.maximum(np.hypot(*view.T), 1e-9)[:, None]
    turn = np.stack([along, along[:, ::-1] * (-1.0, 1.0)], axis=1)
    shown = np.tile(np.eye(columns), (len(view), 1, 1))
    for first in range(0, 2 * lateral, 2):
        shown[:, first : first + 2, first : first + 2] = turn
    turning = np.zeros((len(view), 2 * columns + 2, 2 * columns + 2))
    turning[:, :-2, :-2] = np.einsum('rab,rcd->racbd', turn, shown).reshape(len(view), 2 * columns, 2 * columns)
    turning[:, -2:, -2:] = turn
    return turning


def _mirror(columns: int, lateral: int) -> Float[np.ndarray, ' numbers']:
    """The signs of radial and tangential numbers in the mirror image of a gel: couplings by motion, then the place."""
    shown = np.r_[np.tile([1.0, -1.0], lateral), np.ones(columns - 2 * lateral)]
    signs: np.ndarray = np.r_[shown, -shown, 1.0, -1.0]
    return signs
