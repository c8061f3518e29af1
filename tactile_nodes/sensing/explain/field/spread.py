"""Uncertainty of a force field: the covariance of the fit, and the error of the response."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from tactile_nodes.sensing.elasticity.patches import PatchGrid
from tactile_nodes.sensing.explain.field.solver import Field
from tactile_nodes.sensing.metrics import interval_factor
from tactile_nodes.shapes import Float

USUAL_RESPONSE = 0.05
"""Usual relative error of a response that was not calibrated with presses. With a larger error forces exceed the
nominal error of a field, so they are not `ok`."""

ACROSS = 0.35
"""Share of the response's relative error with which normal force appears as shear. With it 90 % intervals hold 97 to
99 % of shear forces, with a share of 1 99 to 100 % (`tactile bench contacts` with seeds 909 and 717)."""

OUT_OF_SIGHT = 0.6
"""Relative error of forces that cause half the usual motion: near rims, and above all in corners, only regions on one
side see them. For 78 contacts along the rims (ten families, seed 101) the 90 % intervals then have a coverage of 90 %
of the totals, without it 76 %."""

TIPS_OUT_OF_SIGHT = 0.15
"""The same for tips, of which only places and forces are unknown. Forces of tips 13 to 15.5 mm from the middle, also in
corners, are 0.2 to 0.6 stated deviations off (root mean square; `tactile bench stability`)."""


UNFIT, UNFIT_MM = 0.25, 0.2
"""Relative error of forces, and error of their places, where the novelty is above 1: the response is not that of the
gel. On a gel of 4 instead of 6 mm, tips are 30 to 40 % and 0.4 mm off; tips dragged by 1 mm are 15 % off. Contacts of
`tactile bench contacts` have a novelty of 1 at most, in disturbed pictures too."""


@dataclass(frozen=True)
class FieldSpread:
    """Standard deviations of the reported values, from those of the fit: hypot(factor * fit's, share * force).

    `normal` and `shear` are such pairs for forces. `bins` is the pair for the force on a bin, with a share of the force
    on the bin and its neighbours. `torsion` is the pair for a contact's torsion, with a share of its normal force times
    its distance from the centre. `wide` is the share of the normal force of contacts whose middle causes no motion.
    `place` is a factor and the least error of a place [mm]. `nominal` is the nominal error of a total: a floor [N] and
    a share. `floor_n` is the least error of a normal force: the regularization reduces light contacts, which the fit's
    covariance does not show. `response` is the relative error of the response, added to forces.
    """

    normal: tuple[float, float] = (0.7, 0.018)
    shear: tuple[float, float] = (0.8, 0.012)
    bins: tuple[float, float] = (0.45, 0.065)
    torsion: tuple[float, float] = (0.1, 0.012)
    wide: float = 0.07
    place: tuple[float, float] = (0.5, 0.05)
    nominal: tuple[float, float] = (0.012, 0.05)
    response: float = 0.0
    floor_n: float = 0.005

    def out_of_sight(self, hidden: float) -> FieldSpread:
        """The spread of less visible forces; `hidden` is 1 for half the usual visibility."""
        return replace(self, response=math.hypot(self.response, OUT_OF_SIGHT * hidden))

    def unfit(self) -> FieldSpread:
        """The spread of forces found with the response of another gel."""
        return replace(self, response=math.hypot(self.response, UNFIT)).placed(UNFIT_MM)

    def placed(self, off_mm: float) -> FieldSpread:
        """The spread of places that are off by at least so much (standard deviation along an axis)."""
        return replace(self, place=(self.place[0], max(self.place[1], off_mm)))

    def reduced(self, by_n: float) -> FieldSpread:
        """The spread of forces that the regularization may have reduced by so much."""
        return replace(self, floor_n=math.hypot(self.floor_n, by_n / interval_factor()))

    def normal_n(self, fitted: float, force_n: float) -> float:
        """Standard deviation of a normal force."""
        return math.hypot(self.floor_n, self.normal[0] * fitted, self.normal[1] * force_n, self.response * force_n)

    def shear_n(self, fitted: float, shear_n: float, force_n: float) -> float:
        """Standard deviation of a shear force along an axis, given that force and the normal force."""
        return math.hypot(self.shear[0] * fitted, self._shear_n(shear_n, force_n))

    def _shear_n(self, shear_n: float, force_n: float) -> float:
        """The part of it that does not depend on the fit."""
        return math.hypot(self.shear[1] * force_n, self.response * math.hypot(shear_n, ACROSS * force_n))

    def torsion_n_mm(self, fitted: float, torsion: float, force_n: float, lever_mm: float) -> float:
        """Standard deviation of a torsion; `lever_mm` is the root mean square distance of the force from the centre."""
        return math.hypot(self.torsion[0] * fitted, self.torsion[1] * force_n * lever_mm, self.response * torsion)

    def place_mm(self, fitted: float) -> float:
        """Standard deviation of a place along an axis."""
        return math.hypot(self.place[0] * fitted, self.place[1])

    def nominal_n(self, total_n: float) -> float:
        """Nominal error of a total."""
        floor, share = self.nominal
        return math.hypot(floor, math.hypot(share, min(self.response, USUAL_RESPONSE)) * total_n)

    def bins_n(
        self, force_n: Float[np.ndarray, 'rows cols'], fitted: Float[np.ndarray, 'rows cols']
    ) -> Float[np.ndarray, 'rows cols']:
        """Standard deviations of the normal force on each bin; `fitted` are those of the fit alone."""
        near = cv2.boxFilter(force_n, -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT)
        off: np.ndarray = np.hypot(self.bins[0] * fitted, math.hypot(self.bins[1], self.response) * near)
        return off

    def covariance(
        self, field: Field, patches: PatchGrid, fitted: Float[np.ndarray, '6 6']
    ) -> Float[np.ndarray, '6 6']:
        """Covariance of force x, y, z [N] and torque x, y, z [N mm] on the gel; `fitted` is that of the fit alone.

        It includes the unknown normal force in the middle of wide contacts. The errors of a force and of its torque are
        correlated, because the force acts where it was found.
        """
        (shear, _), (normal, share_n), squared = self.shear, self.normal, field.total_n**2
        factors = np.array([shear, shear, normal, normal, normal, shear])
        along_x, along_y = (self._shear_n(each, field.total_n) ** 2 for each in field.forces_n[1:].sum(axis=1).tolist())
        into = squared * (share_n**2 + self.response**2 + (self.wide * field.wide) ** 2) + self.floor_n**2
        share = field.forces_n[0] / max(field.total_n, 1e-9)
        by_into, by_x, by_y = ((each.T * share) @ each for each in patches.levers)
        covariance: np.ndarray = fitted * factors * factors[:, None] + into * by_into + along_x * by_x + along_y * by_y
        return covariance
