"""One response of a gel for all places: the motion around a press, and how each region sees it.

A soft layer responds to a round tip in the same way wherever it presses. At a distance from the press the gel moves
radially and vertically, by amounts that depend only on that distance and the force (axial symmetry; Johnson, Contact
Mechanics, 1985, ch. 3). These profiles are functions of two numbers. Each region of the image adds its place on the
surface and its couplings to both kinds of motion, which depend on the depths of its markers and the camera's view.
Seen obliquely, markers lie along a radial line, see `axisymmetric.radial_smear`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from tactile_nodes.sensing.compiling import compiled_loops
from tactile_nodes.sensing.explain.axisymmetric.by_sides import BySides
from tactile_nodes.sensing.explain.axisymmetric.radial_smear import NEAR_MM, SMEAR_MM, WIDE_MM, RadialSmear
from tactile_nodes.sensing.explain.splines import SplineAxis
from tactile_nodes.shapes import Float

BEND_MM = 1.0
"""Profiles are splines of arcsinh(distance / this): fine near the press, coarse far from it."""
CORE_MM = 0.15
"""Within about this distance of the press lateral motion has no direction, and goes to zero."""
FURTHEST_MM = 45.0
DISTANCES = SplineAxis(0.0, float(np.arcsinh(FURTHEST_MM / BEND_MM)), 21)
TINY_MM = 1e-3

_FOUR = np.arange(4)


@dataclass(frozen=True)
class AxisymmetricResponse:
    """Profiles over distance and force, and how each region sees them.

    `profiles` are coefficients of cubic splines over arcsinh(distance / `BEND_MM`) and force, multiplied by the force:
    `lateral` of them are motion away from the press, the others vertical motion. A region at `places` [mm, surface
    frame] moves in the image [px] by `couplings` times the profiles' values, lateral ones along x and y first. For a
    gel that is `softness` times as soft, with distances `width` times as long, profiles are evaluated at the force
    times `softness` and the distance over `width`. `smear` changes that distance by the region's place.

    If regions are known from a few presses only, `unsure` holds factors of the covariance of a region's numbers (first
    its couplings, then its place), separately for its motion along x and along y.

    `sides` is what the sides of the gel add, which depends on the place of the contact.
    """

    profiles: Float[np.ndarray, 'profiles distances forces']
    lateral: int
    hardest_n: float
    places: Float[np.ndarray, 'regions 2']
    couplings: Float[np.ndarray, 'regions 2 columns']
    width: float = 1.0
    softness: float = 1.0
    smear: RadialSmear = field(default_factory=RadialSmear)
    unsure: Float[np.ndarray, 'regions 2 numbers factors'] | None = None
    sides: BySides | None = None
    compiled: bool = False

    @cached_property
    def force(self) -> SplineAxis:
        """The axis of force, of the gel that the profiles were measured on."""
        return SplineAxis(0.0, self.hardest_n, self.profiles.shape[2] - 3)

    @cached_property
    def tables(self) -> dict[tuple[float, float], tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Start contacts of a search, their motion and its square, by the reach [mm] and the highest force [N]."""
        return {}

    @property
    def highest_n(self) -> float:
        """The force [N] on this gel at which the profiles end."""
        return self.hardest_n / self.softness

    @property
    def parameter_count(self) -> int:
        return int(self.profiles.size + self.places.size + self.couplings.size + 4)

    def motion(self, contacts: Float[np.ndarray, 'n 3']) -> Float[np.ndarray, 'n regions 2']:
        """Motion of each region [px] under each contact (x, y in mm and force in N)."""
        if self.compiled:
            return self.motion_slopes_and_columns(contacts)[0]
        return self.with_sides(self.motion_of_columns(self.columns(contacts)), contacts)

    def with_sides(
        self, motion: Float[np.ndarray, 'n regions 2'], contacts: Float[np.ndarray, 'n 3']
    ) -> Float[np.ndarray, 'n regions 2']:
        """The motion of columns under contacts, with what the sides of the gel add."""
        return motion if self.sides is None else motion + self.sides.motion_and_slopes(contacts)[0]

    def motion_and_slopes(
        self, contacts: Float[np.ndarray, 'n 3']
    ) -> tuple[Float[np.ndarray, 'n regions 2'], Float[np.ndarray, '3 n regions 2']]:
        """Motion as above, and its derivatives with respect to x, y and force."""
        return self.motion_slopes_and_columns(contacts)[:2]

    def motion_slopes_and_columns(
        self, contacts: Float[np.ndarray, 'n 3']
    ) -> tuple[
        Float[np.ndarray, 'n regions 2'], Float[np.ndarray, '3 n regions 2'], Float[np.ndarray, 'n regions columns']
    ]:
        """The same with the profiles' values (columns), which the couplings combine to that motion."""
        if self.compiled:
            return self._by_loops(contacts)
        columns, by_column = self.columns_and_slopes(contacts)
        motion, slopes = self.motion_of_columns(columns), np.stack([self.motion_of_columns(each) for each in by_column])
        if self.sides is not None:
            by_sides, slopes_by_sides = self.sides.motion_and_slopes(contacts)
            motion, slopes = motion + by_sides, slopes + slopes_by_sides
        return motion, slopes, columns

    def variance(
        self, slopes: Float[np.ndarray, '3 n regions 2'], columns: Float[np.ndarray, 'n regions columns']
    ) -> Float[np.ndarray, 'n regions 2']:
        """Variance [px^2] of motion with these slopes and columns, from the uncertainty of the regions' numbers."""
        if self.unsure is None:
            return np.zeros(slopes.shape[1:])
        if self.compiled:
            variances = np.empty(slopes.shape[1:])
            compiled_loops().motion_variance(slopes, columns, np.ascontiguousarray(self.unsure, float), variances)
            return variances
        both = np.broadcast_to(columns[:, :, None], (*slopes.shape[1:], columns.shape[2]))
        levers = np.concatenate([both, -slopes[:2].transpose(1, 2, 3, 0)], axis=-1)
        off: np.ndarray = np.square(np.einsum('nrcl,rclf->nrcf', levers, self.unsure)).sum(axis=-1)
        return off

    def _by_loops(self, contacts: Float[np.ndarray, 'n 3']) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        motion = np.empty((len(contacts), len(self.places), 2))
        slopes, columns = np.empty((3, *motion.shape)), np.empty((*motion.shape[:2], self.couplings.shape[2]))
        compiled_loops().motion_and_slopes(
            np.ascontiguousarray(contacts, float), *self._for_loops, motion, slopes, columns
        )
        if self.sides is not None:
            self.sides.add_by_loops(contacts, motion, slopes)
        return motion, slopes, columns

    @cached_property
    def _for_loops(self) -> tuple[np.ndarray, ...]:
        """Places, couplings and profiles, further numbers, and the axes of distance and force, for compiled loops."""
        numbers = [self.lateral, self.hardest_n, self.width, self.softness, BEND_MM, CORE_MM, TINY_MM]
        numbers += [SMEAR_MM, NEAR_MM, WIDE_MM, self.smear.shift_mm, self.smear.squeeze]
        axes = [[each.low, each.high, each.intervals] for each in (DISTANCES, self.force)]
        arrays = self.places, self.couplings, self.profiles, np.array(numbers), np.array(axes)
        return tuple(np.ascontiguousarray(each, float) for each in arrays)

    def motion_of_columns(self, columns: Float[np.ndarray, 'n regions columns']) -> Float[np.ndarray, 'n regions 2']:
        """Motion of the regions [px] from columns, or from derivatives of columns."""
        motion: np.ndarray = np.matmul(self.couplings, columns[..., None])[..., 0]
        return motion

    def columns(self, contacts: Float[np.ndarray, 'n 3']) -> Float[np.ndarray, 'n regions columns']:
        """The profiles' values at each region: two columns (x, y) for each lateral one, one for each vertical one."""
        away, distance = self._away(contacts)
        value = self._values_alone(distance, contacts[:, 2])
        return self._columns(value, away / distance[..., None] * np.tanh(distance / CORE_MM)[..., None])

    def columns_and_slopes(
        self, contacts: Float[np.ndarray, 'n 3']
    ) -> tuple[Float[np.ndarray, 'n regions columns'], Float[np.ndarray, '3 n regions columns']]:
        """Columns as above, and their derivatives with respect to the contact's x, y and force."""
        away, distance = self._away(contacts)
        value, outward, by_force = self._values(distance, contacts[:, 2])
        toward, core = away / distance[..., None], np.tanh(distance / CORE_MM)
        lateral, unit = self.lateral, toward * core[..., None]
        # d(g u)/dx for motion g along the unit vector u: the slope of g along u, and g / distance across it.
        along = outward[..., :lateral] * core[..., None] + value[..., :lateral] * ((1 - core**2) / CORE_MM)[..., None]
        across = value[..., :lateral] * (core / distance)[..., None]
        slopes = np.empty((3, *distance.shape, self.couplings.shape[2]))
        for axis in (0, 1):
            for channel in (0, 1):
                product = (toward[..., axis] * toward[..., channel])[..., None]
                slopes[axis, ..., channel : 2 * lateral : 2] = along * product + across * ((axis == channel) - product)
            slopes[axis, ..., 2 * lateral :] = outward[..., lateral:] * toward[..., axis, None]
        slopes[:2] = self._bent(contacts, slopes[:2]) / self.width
        slopes[2] = self._columns(by_force, unit)
        return self._columns(value, unit), slopes

    def _columns(self, value: Float[np.ndarray, 'n regions profiles'], unit: np.ndarray) -> np.ndarray:
        """Lateral values times a direction, and vertical values unchanged."""
        lateral = self.lateral
        columns = np.empty((*value.shape[:2], 2 * lateral + value.shape[2] - lateral))
        columns[..., 0 : 2 * lateral : 2] = value[..., :lateral] * unit[..., :1]
        columns[..., 1 : 2 * lateral : 2] = value[..., :lateral] * unit[..., 1:]
        columns[..., 2 * lateral :] = value[..., lateral:]
        return columns

    def _bent(self, contacts: np.ndarray, slopes: Float[np.ndarray, '2 n regions columns']) -> np.ndarray:
        """Derivatives with respect to the contact's x and y, from those with respect to its smeared place."""
        aslant, bend = self.smear.aslant(self.places), self.smear.slopes(self._plain(contacts), self.places)
        over = aslant[:, :1] * slopes[0] + aslant[:, 1:] * slopes[1]
        return np.stack([slopes[axis] + over * bend[..., axis, None] for axis in (0, 1)])

    def _plain(self, contacts: np.ndarray) -> Float[np.ndarray, 'n regions 2']:
        away: np.ndarray = (contacts[:, None, :2] - self.places) / self.width
        return away

    def _away(self, contacts: np.ndarray) -> tuple[Float[np.ndarray, 'n regions 2'], Float[np.ndarray, 'n regions']]:
        """Smeared vector from each region to each contact, and its length, both over the width."""
        away = self.smear.shown(self._plain(contacts), self.places)
        x, y = away[..., 0], away[..., 1]
        return away, np.sqrt(x * x + y * y + TINY_MM**2)

    def away_of(self, contacts: Float[np.ndarray, 'n 3'], regions: np.ndarray) -> Float[np.ndarray, 'n 2']:
        """The same from one region for each contact."""
        places = self.places[regions]
        return self.smear.shown((contacts[:, :2] - places) / self.width, places)

    def distances_mm(self, contacts: Float[np.ndarray, 'n 3']) -> Float[np.ndarray, 'n regions']:
        """Smeared distance from each contact to each region, over the width."""
        return self._away(contacts)[1]

    def _values_alone(
        self, distance: Float[np.ndarray, 'n regions'], force_n: Float[np.ndarray, ' n']
    ) -> Float[np.ndarray, 'n regions profiles']:
        """The profiles' values without derivatives, in a third of the time."""
        force = force_n * self.softness
        k, weights = self.force.weights_of(force)
        along = np.einsum('pdnf,nf->ndp', self.profiles[:, :, k[:, None] + _FOUR], weights[0] * force[:, None])
        near = DISTANCES.design(np.arcsinh(distance / BEND_MM).ravel()).reshape(*distance.shape, -1)
        value: np.ndarray = near @ along
        return value

    def _values(
        self, distance: Float[np.ndarray, 'n regions'], force_n: Float[np.ndarray, ' n']
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The profiles' values, and their derivatives along distance and force: (n, regions, profiles) each."""
        force = force_n * self.softness
        k, weights = self.force.weights_of(force)
        inside = (force < self.hardest_n)[:, None]
        by_force = np.stack([weights[0] * force[:, None], weights[0] + weights[1] * force[:, None] * inside])
        block = self.profiles[:, :, k[:, None] + _FOUR]
        along = np.einsum('pdnf,gnf->gndp', block, by_force)
        near, slope = DISTANCES.design_and_slope(np.arcsinh(distance / BEND_MM).ravel())
        near, slope = near.reshape(*distance.shape, -1), slope.reshape(*distance.shape, -1)
        outward = slope @ along[0] / np.sqrt(distance**2 + BEND_MM**2)[..., None]
        return near @ along[0], outward, near @ along[1] * self.softness
