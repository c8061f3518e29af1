"""A readout with an axisymmetric response: it finds the place and force that explain the motion of all regions.

Every region is weighted by its variance: noise, and a share of the motion that grows towards the press, where single
markers dominate. The contact that explains the regions best is found by Gauss-Newton steps with updated weights,
starting from the best entry of a coarse table. A polynomial then corrects the smooth error over the surface that
remains because the profiles are the same everywhere.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from tactile_nodes.errors import ModelError
from tactile_nodes.sensing.explain.axisymmetric.correction import Correction
from tactile_nodes.sensing.explain.axisymmetric.prior import ErrorPrior
from tactile_nodes.sensing.explain.axisymmetric.response import AxisymmetricResponse
from tactile_nodes.sensing.explain.camera import camera_terms, taken_by_camera
from tactile_nodes.sensing.explain.measured.response import Fit, damping
from tactile_nodes.sensing.explain.network import InputScaling
from tactile_nodes.sensing.explain.noise import FOUND_NOISE, inside_of, noise_of
from tactile_nodes.sensing.explain.reading import (
    BEYOND_UNLIKENESS,
    Contact,
    Reading,
    nothing_read,
    require_central,
    spread_over_bins,
)
from tactile_nodes.sensing.explain.uncertainty import NOWHERE_MM, Calibration, factor_at, nominal_error_n
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.shapes import Bool, Float, Float32

DOUBT_MM = np.array([0.0, 1.1, 2.0, 3.0, 4.25, 6.5, 11.0, 37.0])
"""Distances from the press at which the relative error of a region's motion is given."""
MOST_STEPS = 12
LARGEST_STEP_MM = 1.5
CONVERGED = np.array([2e-3, 2e-3, 2e-4])
"""Iteration ends when no step along x, y [mm] or force [N] is longer; the next would be a tenth of it."""
SLOW = 0.9
"""Iteration also ends when a step leaves more than this share of the squared residual before. If tips explain a frame,
each step leaves far less until it converges. If they do not, or are too close together to be separated, more steps
would gain nothing."""
START_SPACING_MM = 2.0
START_FORCES = np.array([0.15, 0.5, 0.9])
"""Start forces, as shares of the hardest press."""
MARGIN = 1.1
"""Limit of a contact's force, over that of the hardest known press."""
LEAST_REGIONS = 12
NOMINAL_STEPS = 5
"""Number of places along x and along y, and of forces, at which the nominal error is evaluated."""


@dataclass(frozen=True)
class Observation:
    """One frame: motion of the known regions [px], and one over the variance of its noise (0 for unseen regions)."""

    motion: Float[np.ndarray, 'regions 2']
    certainty: Float[np.ndarray, 'regions 2']

    @property
    def enough(self) -> bool:
        return int((self.certainty[:, 0] > 0).sum()) >= LEAST_REGIONS and bool(np.isfinite(self.motion).all())


@dataclass(frozen=True)
class AxisymmetricReadout:
    """Estimates contacts from the motion of regions, and forces on bins from contacts.

    `scaling` holds the regions' values at rest (mean), one over their noise (gain) and which regions are known
    (trusted); the response has rows for these only. `doubt` is the relative error of a region's motion at the distances
    `DOUBT_MM` from the press. `prior` is not used in a reading; calibrations for other gels start from it. `pressed_n`
    is the hardest press of a calibration: on a softer gel it can exceed the range of the profiles, and is still read.
    """

    scaling: InputScaling
    response: AxisymmetricResponse
    doubt: Float[np.ndarray, ' distances']
    correction: Correction
    bins: BinGrid
    calibration: Calibration = field(default_factory=Calibration)
    most_contacts: int = 1
    prior: ErrorPrior | None = None
    pressed_n: float = 0.0

    kind = 'axisymmetric'

    @property
    def highest_n(self) -> float:
        """The force [N] up to which this gel is known."""
        return max(self.response.highest_n, self.pressed_n)

    @property
    def parameter_count(self) -> int:
        """Profiles, places and couplings, correction, doubt, and the scaling of the regions."""
        correction = self.correction.terms.size + (0 if self.correction.local is None else self.correction.local.size)
        return self.response.parameter_count + correction + self.doubt.size + 2 * self.scaling.mean.size

    def require_fit(self, features: int, bins: BinGrid) -> None:
        require_central(bins)
        regions = int((self.scaling.trusted > 0).sum())
        if self.scaling.mean.size != features or bins != self.bins or regions != len(self.response.places):
            raise ModelError(
                f'an axisymmetric response of {regions} known regions, {self.scaling.mean.size} features and '
                f'{self.bins} does not fit {features} features and {bins}; train it again or use another model file'
            )

    def nominal_n(self, total_n: float) -> float:
        """The nominal error of a total, see `uncertainty.nominal_error_n`."""
        return nominal_error_n(self._stated_n, total_n)

    @cached_property
    def _stated_n(self) -> float:
        """Root mean square of the stated uncertainty over all places and forces."""
        reach_mm = self.correction.reach_mm * self.response.width
        across = np.linspace(-reach_mm, reach_mm, 2 * NOMINAL_STEPS + 1)[1::2].tolist()
        forces = [self.response.highest_n * (step + 0.5) / NOMINAL_STEPS for step in range(NOMINAL_STEPS)]
        stated = [self._stated(np.array([at])) for at in itertools.product(across, across, forces)]
        return float(np.sqrt(np.mean(np.square(stated))))

    def _stated(self, contact: Float[np.ndarray, '1 3']) -> float:
        """The stated uncertainty of the force of a contact."""
        fit, _, _ = self._compare(Observation(self.response.motion(contact)[0], self._certainty), contact)
        return self.contacts(fit)[0].sigma_n

    @cached_property
    def _known(self) -> np.ndarray:
        return np.flatnonzero(self.scaling.trusted.reshape(-1) > 0)

    @cached_property
    def _camera(self) -> Float[np.ndarray, 'terms motions']:
        """See `camera_terms`."""
        return camera_terms(self.scaling.trusted.shape, self._known)

    @cached_property
    def _moved_alike(self) -> Float32[np.ndarray, 'terms motions']:
        """Orthonormal motions that span those of the camera."""
        spanning: np.ndarray = np.linalg.qr(self._camera.T)[0].T
        return spanning.astype(np.float32)

    @cached_property
    def _inside(self) -> np.ndarray:
        return inside_of(self.scaling.trusted > 0)

    @cached_property
    def usual_px(self) -> float:
        """The noise of the median region in the training images."""
        return float(np.median(1 / self.scaling.gain[self.scaling.trusted > 0]))

    @cached_property
    def _at_rest(self) -> Float[np.ndarray, 'regions 2']:
        mean: np.ndarray = self.scaling.mean.reshape(-1, 2)[self._known].astype(float)
        return mean

    @cached_property
    def _certainty(self) -> Float[np.ndarray, 'regions 2']:
        squared: np.ndarray = np.square(self.scaling.gain.reshape(-1, 2)[self._known].astype(float))
        return squared

    def certainty_of(self, shown: Bool[np.ndarray, 'n regions 2']) -> Float[np.ndarray, 'n regions 2']:
        """One over the variance of noise in an image; 0 for unseen regions."""
        return np.asarray(np.where(shown, self._certainty, 0.0))

    @property
    def _starts(self) -> tuple[Float[np.ndarray, 'starts 3'], Float32[np.ndarray, 'starts inputs'], np.ndarray]:
        """Start contacts, the motion that they cause beyond that of a camera, and its square.

        Readouts of one response share them.
        """
        reach, tables = self.correction.reach_mm * self.response.width, self.response.tables
        if (reach, self.highest_n) not in tables:
            along = np.linspace(-reach, reach, max(2, math.ceil(2 * reach / START_SPACING_MM) + 1))
            forces = START_FORCES * self.highest_n
            starts = np.stack(np.meshgrid(along, along, forces, indexing='ij'), axis=-1).reshape(-1, 3)
            fields = self.response.motion(starts).reshape(len(starts), -1).astype(np.float32)
            fields -= (fields @ self._moved_alike.T) @ self._moved_alike
            tables[reach, self.highest_n] = starts, fields, np.square(fields).sum(axis=1)
        return tables[reach, self.highest_n]

    def read(
        self, values: Float32[np.ndarray, 'rows cols channels'], confidence: Float32[np.ndarray, 'rows cols']
    ) -> Reading:
        observed = self.observed(values, confidence)
        if not observed.enough:
            return nothing_read(self.bins)
        fit = self.fit(observed)
        return self.reading_of_fit(observed, fit, self.left_over(observed, fit))

    def observed(
        self, values: Float32[np.ndarray, 'rows cols channels'], confidence: Float32[np.ndarray, 'rows cols']
    ) -> Observation:
        """Motion relative to rest; regions that cannot be tracked now have weight 0."""
        lost = confidence.reshape(-1)[self._known] < self.scaling.confidence_floor
        motion = values.reshape(-1, 2)[self._known] - self._at_rest
        if not lost.any():
            return Observation(motion, self._certainty)
        motion[lost] = 0.0
        return Observation(motion, np.where(lost[:, None], 0.0, self._certainty))

    def fit(self, observed: Observation, most_contacts: int = 0, worth: float = math.inf) -> Fit:
        """The fewest contacts that explain the frame, not yet corrected; at most `most_contacts`, 0: as configured.

        A number of contacts whose residual exceeds `worth` times the allowed one (not squared) is rejected.
        """
        most = most_contacts or self.most_contacts
        fit = self._locate(observed, self._start(observed.motion)[None], worth if most == 1 else math.inf)
        limit = self.calibration.misfit_limit**2
        while fit.misfit > limit and len(fit.contacts) < most:
            left = (observed.motion - self.response.motion(fit.contacts).sum(axis=0)) * (observed.certainty > 0)
            last = len(fit.contacts) + 1 == most
            more = self._locate(observed, np.vstack([fit.contacts, self._start(left)]), worth if last else math.inf)
            if more.misfit > 0.5 * fit.misfit:
                break
            fit = more
        return fit

    def _start(self, motion: Float[np.ndarray, 'regions 2']) -> Float[np.ndarray, ' 3']:
        """The closest entry of the table, with the closest share of its force."""
        starts, fields, squares = self._starts
        along = fields @ motion.reshape(-1).astype(np.float32)
        share = np.clip(along / np.maximum(squares, 1e-12), 0.0, MARGIN / START_FORCES[-1])
        best = int((share * (share * squares - 2 * along)).argmin())
        x, y, force_n = starts[best].tolist()
        return np.array([x, y, force_n * float(share[best])])

    def share_of(self, observed: Observation, noisier: float, tips: int) -> float:
        """Share of the squared motion, minus noise and camera motion, that a number of tips from the table explains.

        The noise is that of each region in training, times `noisier`. Each tip explains most of the residual of those
        before (orthogonal matching pursuit, Pati 1993). What they explain may be noise if its gain is small: then the
        share is 0.
        """
        _, fields, squares = self._starts
        motion = observed.motion.reshape(-1).astype(np.float32)
        left = motion = motion - (motion @ self._moved_alike.T) @ self._moved_alike
        axes = np.empty((0, motion.size), np.float32)
        for _ in range(tips):
            along = np.maximum(fields @ left, 0.0)
            best = fields[int((along * along / np.maximum(squares, 1e-12)).argmax())]
            axis = best - (axes @ best) @ axes
            axis /= max(math.sqrt(float(axis @ axis)), 1e-6)
            left, axes = left - (left @ axis) * axis, np.vstack([axes, axis])
        if self._gain(observed, left.reshape(-1, 2)) < self.calibration.least_gain * noisier**2:
            return 0.0
        noise = noisier**2 * float((1 / observed.certainty[observed.certainty > 0]).sum())
        squared = float(motion @ motion)
        return min((squared - float(left @ left)) / max(squared - noise, 1e-12), 1.0)

    def _locate(self, observed: Observation, begin: Float[np.ndarray, 'contacts 3'], worth: float) -> Fit:
        """Gauss-Newton from `begin` to the most probable contacts; it stops early if they would be rejected."""
        half = self.bins.width_mm / 2, self.bins.height_mm / 2
        high = np.array([*half, MARGIN * self.highest_n])
        low = np.array([-half[0], -half[1], 0.0])
        largest = np.array([LARGEST_STEP_MM, LARGEST_STEP_MM, self.highest_n / 4])
        granted, count = damping(len(begin)), max(int((observed.certainty > 0).sum()), 1)
        useless = (worth * self.calibration.misfit_limit) ** 2 * count
        current, found = begin.copy(), []
        for _ in range(MOST_STEPS):
            fit, descent, cost = self._compare(observed, current)
            found.append((cost, fit))
            if len(found) > 1 and fit.misfit > SLOW * found[-2][1].misfit:
                break
            step = np.linalg.solve(fit.information + granted, descent)
            if fit.misfit * count - float(descent @ step) > useless:
                break  # the residual that a linear model predicts
            step = step.reshape(-1, 3)
            moved = np.clip(current + np.clip(step, -largest, largest), low, high)
            if not moved[:, 2].any():
                break
            if (np.abs(moved - current) < CONVERGED).all():
                found[-1] = cost, replace(fit, contacts=moved)
                break
            current = moved
        return min(found, key=lambda each: each[0])[1]

    def _compare(
        self, observed: Observation, contacts: Float[np.ndarray, 'contacts 3']
    ) -> tuple[Fit, np.ndarray, float]:
        """Fit of contacts to the frame, the descent direction, and the negative log-likelihood."""
        modelled, slopes, columns = self.response.motion_slopes_and_columns(contacts)
        # Several contacts move a region by its couplings times the sum of their columns.
        unsure = self.response.variance(slopes.sum(axis=1, keepdims=True), columns.sum(axis=0, keepdims=True))[0]
        certainty = self.weights(observed, contacts, modelled, unsure)
        left = observed.motion - modelled.sum(axis=0)
        count = max(int((certainty > 0).sum()), 1)
        lever = slopes.transpose(1, 0, 2, 3).reshape(3 * len(contacts), -1)
        weighted = lever * certainty.reshape(-1)
        taken = taken_by_camera(self._camera, np.vstack([left.reshape(1, -1), lever]), certainty.reshape(-1))
        misfit = (float((left * left * certainty).sum()) - float(taken[0, 0])) / count
        doubt = float(np.log(np.where(certainty > 0, observed.certainty / np.maximum(certainty, 1e-300), 1.0)).sum())
        fit = Fit(contacts, weighted @ lever.T - taken[1:, 1:], misfit)
        return fit, weighted @ left.reshape(-1) - taken[1:, 0], misfit + doubt / count

    def weights(
        self,
        observed: Observation,
        contacts: Float[np.ndarray, 'contacts 3'],
        modelled: Float[np.ndarray, 'contacts regions 2'],
        unsure: Float[np.ndarray, 'regions 2'],
    ) -> Float[np.ndarray, 'regions 2']:
        """One over the variance of each region, from noise, relative error, and uncertainty of its numbers."""
        share = np.interp(self.response.distances_mm(contacts), DOUBT_MM, self.doubt)
        off = (np.square(share) * np.square(modelled).sum(axis=-1)).sum(axis=0)
        certainty: np.ndarray = observed.certainty / (1 + observed.certainty * (off[:, None] + unsure))
        return certainty

    def reading_of_fit(
        self, observed: Observation, fit: Fit, left: Float32[np.ndarray, 'rows cols 2'], *, anywhere: bool = False
    ) -> Reading:
        """The reading of a fit with this residual, with uncertainty from the noise; no force if it may be noise.

        Contacts beyond the measured forces are novel, and those beyond the measured places unless `anywhere`.
        """
        noisier = max(1.0, noise_of(left, self._inside) / FOUND_NOISE / self.usual_px)
        contacts = tuple(replace(each, sigma_n=noisier * each.sigma_n) for each in self.contacts(fit))
        unlike = math.sqrt(fit.misfit) / self.calibration.misfit_limit / noisier
        if self.gain(observed, fit) < self.calibration.least_gain * noisier**2:
            contacts = (replace(contacts[0], force_n=0.0, sigma_mm=NOWHERE_MM),)
        elif self._too_hard(fit.contacts) or (self._too_far(fit.contacts) and not anywhere):
            unlike = max(unlike, BEYOND_UNLIKENESS)
        sigma_n = math.hypot(*(each.sigma_n for each in contacts))
        return Reading(spread_over_bins(contacts, self.bins), contacts, sigma_n, unlike)

    def left_over(self, observed: Observation, fit: Fit) -> Float32[np.ndarray, 'rows cols 2']:
        """Residual motion [px] of each region after a fit; 0 for unknown regions."""
        left = np.zeros((self.scaling.trusted.size, 2), np.float32)
        left[self._known] = observed.motion - self.response.motion(fit.contacts).sum(axis=0)
        return left.reshape(*self.scaling.trusted.shape, 2)

    def _too_hard(self, contacts: Float[np.ndarray, 'contacts 3']) -> bool:
        """Whether a contact is harder than all measured ones."""
        return bool((contacts[:, 2] > self.highest_n).any())

    def _too_far(self, contacts: Float[np.ndarray, 'contacts 3']) -> bool:
        """Whether a contact is further from the middle than all measured ones."""
        reach_mm = self.correction.reach_mm * self.response.width
        return bool((np.abs(contacts[:, :2]) > reach_mm).any())

    def gain(self, observed: Observation, fit: Fit) -> float:
        """Log-likelihood ratio of the fitted contacts to none: half the decrease of the squared misfit over noise."""
        return self._gain(observed, observed.motion - self.response.motion(fit.contacts).sum(axis=0))

    def _gain(self, observed: Observation, left: Float[np.ndarray, 'regions 2']) -> float:
        both, certainty = np.stack([observed.motion, left]).reshape(2, -1), observed.certainty.reshape(-1)
        squared = (np.square(both) * certainty).sum(axis=1)
        before, after = squared - np.diag(taken_by_camera(self._camera, both, certainty))
        return float(before - after) / 2

    def contacts(self, fit: Fit) -> tuple[Contact, ...]:
        """The contacts of a fit, corrected, with their uncertainties, strongest first."""
        corrected = self.corrected(fit.contacts)
        found = [self._contact(*each) for each in zip(corrected.tolist(), fit.variances.tolist(), strict=True)]
        return tuple(sorted(found, key=lambda contact: -contact.force_n))

    def corrected(self, contacts: Float[np.ndarray, 'n 3']) -> Float[np.ndarray, 'n 3']:
        """Contacts with the correction, which is in distances and forces of the gel that it was measured on."""
        corrected: np.ndarray = self.correction(contacts / self.unit) * self.unit
        return corrected

    @property
    def unit(self) -> Float[np.ndarray, ' 3']:
        """1 mm and 1 N on the gel that the profiles were measured on, expressed on this gel."""
        return np.array([self.response.width, self.response.width, 1 / self.response.softness])

    def _contact(self, place: list[float], variance: list[float]) -> Contact:
        (x, y, force_n), c = place, self.calibration
        height = force_n / self.highest_n
        fitted_mm, fitted_n = math.sqrt((variance[0] + variance[1]) / 2), math.sqrt(variance[2])
        sigma_mm = factor_at(c.place_factors, height) * math.hypot(c.place_floor_mm, fitted_mm)
        sigma_n = factor_at(c.force_factors, height) * math.hypot(c.force_floor_n, fitted_n)
        return Contact(x, y, max(force_n, 0.0), min(sigma_mm, NOWHERE_MM), sigma_n)
