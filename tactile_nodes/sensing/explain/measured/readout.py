"""A readout with a measured response: features to scores, scores to contacts, contacts to bins, with uncertainty."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from tactile_nodes.errors import ModelError
from tactile_nodes.sensing.compiling import compiled_loops
from tactile_nodes.sensing.explain.likeness import Likeness
from tactile_nodes.sensing.explain.measured.contact_shape import (
    DOUBT_OF_SHIFT,
    DOUBT_PER_MM2,
    SHIFT_INFORMATION,
    SURE_OF_WIDTH,
    USUAL_MISFIT,
    USUAL_MM2,
    WIDE_MM2,
    Residual,
    in_doubt,
    shape_of,
    with_usual_width,
)
from tactile_nodes.sensing.explain.measured.response import START_LEVELS, Fit, Response, at_an_end, ends, gained, locate
from tactile_nodes.sensing.explain.network import InputScaling
from tactile_nodes.sensing.explain.reading import (
    BEYOND_UNLIKENESS,
    UNKNOWN,
    Contact,
    Reading,
    nothing_read,
    require_central,
    spread_over_bins,
)
from tactile_nodes.sensing.explain.splines import SplineAxis, value_and_slopes
from tactile_nodes.sensing.explain.uncertainty import NOWHERE_MM, Calibration, factor_at, nominal_error_n
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.shapes import Bool, Float, Float32

NOMINAL_PLACES, NOMINAL_FORCES = 7, 10
"""Number of places along x and along y, and of forces, at which the nominal error is evaluated."""

SURE_OF_DIRECTIONS = 1e-3
"""Regularization that keeps directions at zero if only missing regions could separate them."""


@dataclass(frozen=True)
class Observation:
    """One frame's scores along the principal directions, and root mean squares of their residual and of the input."""

    scores: Float32[np.ndarray, ' components']
    left_over: float
    size: float


def project(
    directions: Float32[np.ndarray, 'components inputs'],
    inputs: Float32[np.ndarray, ' inputs'],
    missing: Bool[np.ndarray, ' inputs'],
) -> Observation:
    """Least-squares scores of inputs along orthonormal directions, with some inputs missing (and zero)."""
    along = directions @ inputs
    scores = along
    if missing.any():
        lost = directions[:, missing]
        square = np.eye(len(directions), dtype=np.float32) * (1 + SURE_OF_DIRECTIONS) - lost @ lost.T
        scores = np.linalg.solve(square, along)
    count = max(len(inputs) - int(missing.sum()), 1)
    total = float(inputs @ inputs)
    left = max(total - float(scores @ along), 0.0)
    return Observation(scores, math.sqrt(left / count), math.sqrt(total / count))


@dataclass(frozen=True)
class ResponseReadout:
    """Features to components (`directions`, `whitening`), components to contacts, contacts to bins.

    A contact drags the skin if a shift of all regions gains more than `most_shift_gain` (see `contact_shape`).
    """

    scaling: InputScaling
    likeness: Likeness
    whitening: Float32[np.ndarray, 'components components']
    response: Response
    bins: BinGrid
    calibration: Calibration = field(default_factory=Calibration)
    most_contacts: int = 1
    most_shift_gain: float = math.inf
    compiled: bool = False

    kind = 'response'

    @property
    def parameter_count(self) -> int:
        """Coefficients of the splines, principal directions, and the scaling of the components."""
        numbers = self.response.coefficients, self.likeness.directions, self.whitening, self.response.growth
        return sum(each.size for each in numbers)

    def require_fit(self, features: int, bins: BinGrid) -> None:
        require_central(bins)
        if self.likeness.directions.shape[1] != features or bins != self.bins:
            raise ModelError(
                f'a response to {self.likeness.directions.shape[1]} features on {self.bins} does not fit {features} '
                f'features and {bins}; train it again or use another model file'
            )

    def read(
        self, values: Float32[np.ndarray, 'rows cols channels'], confidence: Float32[np.ndarray, 'rows cols']
    ) -> Reading:
        if self.compiled:
            return self._read(values, confidence)
        return self.reading(self.observed(values, confidence))

    def _read(self, values: np.ndarray, confidence: np.ndarray) -> Reading:
        """The same, compiled."""
        contacts = np.empty((self.most_contacts, 5))
        forces = np.empty((self.bins.rows, self.bins.cols), np.float32)
        count, sigma_n, unlikeness = compiled_loops().read_response(
            values.reshape(-1), confidence.reshape(-1), *self._for_loops, contacts, forces
        )
        if not count:
            return nothing_read(self.bins)
        return Reading(forces, tuple(Contact(*row) for row in contacts[:count].tolist()), sigma_n, unlikeness)

    @cached_property
    def _for_loops(self) -> tuple[object, ...]:
        """Arguments for the compiled loops, see `loops.response.read`."""
        scaling, response, limits, calibration = self.scaling, self.response, self.likeness, self.calibration
        single = (scaling.mean, scaling.gain, scaling.trusted, limits.directions, self.whitening)
        mean, gain, trusted, directions, whitening = (np.ascontiguousarray(each, np.float32) for each in single)
        numbers = (
            scaling.confidence_floor, SURE_OF_DIRECTIONS, START_LEVELS, calibration.misfit_limit,
            limits.floor, limits.share, calibration.place_floor_mm, calibration.force_floor_n, NOWHERE_MM,
            BEYOND_UNLIKENESS, self.bins.width_mm, self.bins.height_mm, response.hard, self.most_shift_gain,
            WIDE_MM2, SURE_OF_WIDTH, USUAL_MM2, SHIFT_INFORMATION, self._usual_misfit, DOUBT_PER_MM2, DOUBT_OF_SHIFT,
        )  # fmt: skip
        return (
            (mean.reshape(-1), gain.reshape(-1), trusted.reshape(-1)), directions, whitening, *response.for_loops,
            (np.array(calibration.place_factors, float), np.array(calibration.force_factors, float)),
            ends(calibration.least_gain),
            np.ascontiguousarray(self.shifts), tuple(float(each) for each in numbers),
        )  # fmt: skip

    @cached_property
    def mixing(self) -> Float[np.ndarray, 'components inputs']:
        """Components of each input."""
        mixed: np.ndarray = self.whitening.astype(float) @ self.likeness.directions
        return mixed

    @cached_property
    def shifts(self) -> Float[np.ndarray, 'channels components']:
        """Components of a shift of all regions: each channel of motion by one."""
        gain = (self.scaling.trusted[..., None] * self.scaling.gain).astype(float)
        count = gain.shape[-1]
        each_channel = gain.reshape(-1, 1) * np.tile(np.eye(count), (gain.size // count, 1))
        shifts: np.ndarray = each_channel.T @ self.mixing.T
        return shifts

    def observed(
        self, values: Float32[np.ndarray, 'rows cols channels'], confidence: Float32[np.ndarray, 'rows cols']
    ) -> Observation:
        """Features as scores along the principal directions; regions that cannot be tracked now are left out.

        Scores are NaN if fewer inputs than directions are left.
        """
        inputs = self.scaling(values, confidence).reshape(-1)
        missing = np.repeat(self.scaling.missing(confidence).reshape(-1), values.shape[-1])
        observed = project(self.likeness.directions, inputs, missing)
        known = values.shape[-1] * int((self.scaling.trusted > 0).sum())
        enough = known - int(missing.sum()) >= len(self.likeness.directions)
        return observed if enough else replace(observed, scores=np.full_like(observed.scores, UNKNOWN))

    def fit(self, components: Float32[np.ndarray, ' components']) -> Fit:
        """The fewest contacts that explain the components, at most `most_contacts`."""
        single = locate(self.response, components, self.response.start(components)[None], self.calibration.least_gain)
        return self._with_more(components, single)

    def _with_more(self, components: np.ndarray, fit: Fit) -> Fit:
        while fit.misfit > self.calibration.misfit_limit**2 and len(fit.contacts) < self.most_contacts:
            more = locate(self.response, components, self._one_more(components, fit.contacts))
            if more.misfit > 0.5 * fit.misfit:
                break
            fit = more
        return fit

    def _one_more(self, components: np.ndarray, contacts: np.ndarray) -> Float[np.ndarray, 'contacts 3']:
        modelled = [
            value_and_slopes(self.response.axes, self.response.coefficients, each)[0] for each in contacts.tolist()
        ]
        return np.vstack([contacts, self.response.start(np.asarray(components - sum(modelled), np.float32))])

    def reading(self, observed: Observation) -> Reading:
        """Forces on bins, contacts and their uncertainty; no force if the motion may be noise."""
        if not (np.isfinite(observed.scores).all() and math.isfinite(observed.size)):
            return nothing_read(self.bins)
        components = self.whitening @ observed.scores
        fit, limits = self.fit(components), self.likeness
        left_over = observed.left_over / (limits.floor + limits.share * observed.size)
        unlike = max(math.sqrt(fit.misfit) / self.calibration.misfit_limit, left_over)
        residual = Residual(fit.misfit, self._usual_misfit, len(self.whitening))
        if self.gain(components, fit) < self.calibration.least_gain * residual.noise_without(0.0):
            contacts: tuple[Contact, ...] = (replace(self.contacts(fit)[0], force_n=0.0, sigma_mm=NOWHERE_MM),)
        else:
            shape = shape_of(self.response, self.shifts, components, fit)
            doubt = in_doubt(fit, shape, residual, self.most_shift_gain)
            contacts = self.contacts(with_usual_width(self.response, fit, shape), doubt)
            unlike = max(unlike, BEYOND_UNLIKENESS) if self.beyond(fit.contacts) else unlike
        sigma_n = math.hypot(*(each.sigma_n for each in contacts))
        return Reading(spread_over_bins(contacts, self.bins), contacts, sigma_n, unlike)

    @property
    def _usual_misfit(self) -> float:
        return USUAL_MISFIT * self.calibration.misfit_limit**2

    def beyond(self, contacts: Float[np.ndarray, 'contacts 3']) -> bool:
        """Whether any contact lies at the limit of the training, or near two limits at once."""
        return bool((at_an_end(self.response, contacts) | self.response.near_ends(contacts)).any())

    def with_usual_width(self, components: Float32[np.ndarray, ' components'], fit: Fit) -> Fit:
        """A fit's contacts as reported; see `contact_shape`."""
        return with_usual_width(self.response, fit, shape_of(self.response, self.shifts, components, fit))

    def gain(self, components: Float32[np.ndarray, ' components'], fit: Fit) -> float:
        """See `gained`."""
        return gained(self.response, components, fit)

    def contacts(self, fit: Fit, more: Float[np.ndarray, 'contacts 3'] | None = None) -> tuple[Contact, ...]:
        """The contacts of a fit with their uncertainties, strongest first.

        `more` is an additional variance of x, y and s of each contact.
        """
        beside = np.zeros((len(fit.contacts), 3)) if more is None else more
        numbers = zip(fit.contacts.tolist(), fit.variances.tolist(), beside.tolist(), strict=True)
        return tuple(sorted((self._contact(*each) for each in numbers), key=lambda contact: -contact.force_n))

    def _contact(self, place: list[float], variance: list[float], more: list[float]) -> Contact:
        (x, y, s), c = place, self.calibration
        height = s / self.response.s.high
        fitted_mm = math.sqrt((variance[0] + variance[1]) / 2)
        sigma_mm = factor_at(c.place_factors, height) * math.hypot(c.place_floor_mm, fitted_mm)
        sigma_n = factor_at(c.force_factors, height) * math.hypot(c.force_floor_n, math.sqrt(variance[2]))
        sigma_mm = math.hypot(sigma_mm, math.sqrt((more[0] + more[1]) / 2))
        sigma_n = math.hypot(sigma_n, math.sqrt(more[2]))
        return Contact(x, y, max(s, 0.0), min(sigma_mm, NOWHERE_MM), sigma_n)

    def nominal_n(self, total_n: float) -> float:
        """The nominal error of a total, see `uncertainty.nominal_error_n`."""
        return nominal_error_n(self._stated_n, total_n)

    @cached_property
    def _stated_n(self) -> float:
        """Root mean square of the stated uncertainty over the interior of the trained range.

        This is the range without the first and last intervals of the splines.
        """
        x, y, _ = self.response.axes
        places = [_inner(each) for each in (x, y)]
        forces = [self.response.hard * (step + 1) / NOMINAL_FORCES for step in range(NOMINAL_FORCES)]
        stated = [self.stated_n(*at) for at in itertools.product(*places, forces)]
        return float(np.sqrt(np.mean(np.square(stated))))

    def stated_n(self, x_mm: float, y_mm: float, force_n: float) -> float:
        """The stated uncertainty of the force of a press, in an image as in training."""
        at = [x_mm, y_mm, force_n]
        slopes = np.asarray(value_and_slopes(self.response.axes, self.response.coefficients, at)[1:], np.float64)
        information = (slopes * self.response.certainty(at[2])) @ slopes.T
        return self.contacts(Fit(np.array([at]), information, 0.0))[0].sigma_n


def _inner(axis: SplineAxis) -> list[float]:
    """Equally spaced places from the end of the first interval of an axis to the beginning of the last one."""
    step = (axis.high - axis.low) / axis.intervals
    places: list[float] = np.linspace(axis.low + step, axis.high - step, NOMINAL_PLACES).tolist()
    return places
