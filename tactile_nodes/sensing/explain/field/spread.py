"""How far the numbers of a force field are off: its covariance, and what the response is off by beside that."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float

from tactile_nodes.sensing.elasticity.patches import PatchGrid
from tactile_nodes.sensing.explain.field.solver import Field

_SIX = np.arange(6)


USUAL_RESPONSE = 0.05
"""Share that a response without presses is off by where it serves. One that is off by more tells forces that are not
what is usual of a field, and so not `ok`."""


OUT_OF_SIGHT = 0.6
"""Share that forces are off by where a newton moves half as much of the picture as usual: near rims, and above all in
corners, regions on one side alone tell of it. Of 78 contacts along the rims (ten families, seed 101) 90 % intervals
then hold 90 % of the totals, without it 76 %."""


@dataclass(frozen=True)
class FieldSpread:
    """Standard deviations of what is told, from those of the fit: hypot(factor * fit's, share * force).

    `normal` and `shear` are such pairs for forces, `bins` for the force on a bin, whose share is of the force on the
    bin and its neighbours, `torsion` for that of a contact, whose share is of its normal force times how far that is
    from the centre. `wide` is the share of the normal force of contacts whose middle shows nothing. `place` is a factor
    and the least that a place is off by (mm). `nominal` is what is usual of a total: a floor (N) and a share.
    `floor_n` is the least that a normal force is off by: what holds patches down takes of light contacts, which no fit
    tells. All are for a response fitted to presses; one that was not is off by `response` beside that.
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

    def times(self, factor: float) -> FieldSpread:
        """With deviations that are so much larger."""
        if factor == 1:
            return self
        pairs, numbers = ('normal', 'shear', 'bins', 'torsion', 'place'), ('wide', 'response', 'floor_n')
        larger: dict[str, Any] = {name: tuple(factor * each for each in getattr(self, name)) for name in pairs}
        return replace(self, **larger, **{name: factor * getattr(self, name) for name in numbers})

    def out_of_sight(self, hidden: float) -> FieldSpread:
        """Of forces that show `hidden` times less than usual, beside 1: 1 where they show half as much."""
        return replace(self, response=math.hypot(self.response, OUT_OF_SIGHT * hidden)) if hidden > 0 else self

    def normal_n(self, fitted: float, force_n: float) -> float:
        """Of a normal force."""
        return math.hypot(self.floor_n, self.normal[0] * fitted, self.normal[1] * force_n, self.response * force_n)

    def shear_n(self, fitted: float, force_n: float) -> float:
        """Of a shear force along an axis, beside so much normal force."""
        return math.hypot(self.shear[0] * fitted, self.shear[1] * force_n, self.response * force_n)

    def torsion_n_mm(self, fitted: float, torsion: float, force_n: float, lever_mm: float) -> float:
        """Of a torsion of a contact whose force is so far (root mean square) from its centre."""
        return math.hypot(self.torsion[0] * fitted, self.torsion[1] * force_n * lever_mm, self.response * torsion)

    def place_mm(self, fitted: float) -> float:
        """Of a place along an axis."""
        return math.hypot(self.place[0] * fitted, self.place[1])

    def nominal_n(self, total_n: float) -> float:
        """What is usual of a total."""
        floor, share = self.nominal
        return math.hypot(floor, math.hypot(share, min(self.response, USUAL_RESPONSE)) * total_n)

    def bins_n(
        self, told: Float[np.ndarray, 'rows cols'], fitted: Float[np.ndarray, 'rows cols']
    ) -> Float[np.ndarray, 'rows cols']:
        """Of the normal force on each bin; `fitted` is that of the fit alone."""
        near = cv2.boxFilter(told, -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT)
        off: np.ndarray = np.hypot(self.bins[0] * fitted, math.hypot(self.bins[1], self.response) * near)
        return off

    def covariance(
        self, field: Field, patches: PatchGrid, fitted: Float[np.ndarray, '6 6']
    ) -> Float[np.ndarray, '6 6']:
        """Of force x, y, z (N) and torque x, y, z (N mm) on the gel; `fitted` is that of the fit alone.

        What a normal force makes is unknown where the middle of a contact shows nothing.
        """
        (shear, shear_share), (normal, normal_share), squared = self.shear, self.normal, field.total_n**2
        factors = np.array([shear, shear, normal, normal, normal, shear])
        along = squared * (shear_share**2 + self.response**2)
        into = squared * (normal_share**2 + self.response**2 + (self.wide * field.wide) ** 2) + self.floor_n**2
        right, down = (field.forces_n[0] @ patches.squares_mm2 / max(field.total_n, 1e-9)).tolist()
        covariance: np.ndarray = fitted * factors * factors[:, None]
        covariance[_SIX, _SIX] += [along, along, into, into * down, into * right, along * (right + down)]
        return covariance
