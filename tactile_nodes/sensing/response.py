"""A readout that knows how the gel responds: which place and force explain what the camera sees?

The motion that a tip causes is a smooth function of where it presses (x, y) and how hard. In training that function is
measured (cubic splines over x, y and s = F^p, of the features' principal components); a frame is answered by the
contact whose motion comes closest, found by Gauss-Newton steps from the best entry of a coarse table. So position and
force come out continuously, with their covariance, and what no contact explains is left over and told. Motions of
several contacts add up (superposition), as they nearly do in a soft layer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache, cached_property
from types import ModuleType

import numpy as np
from jaxtyping import Bool, Float, Float32

from tactile_nodes.errors import ModelError
from tactile_nodes.sensing.compiling import compiled_loops
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.sensing.likeness import Likeness
from tactile_nodes.sensing.network import InputScaling
from tactile_nodes.sensing.reading import UNKNOWN, Contact, Reading, nothing_read, spread_over_bins
from tactile_nodes.sensing.splines import SplineAxis, cubes, value_and_slopes

MOST_STEPS = 12
LARGEST_STEP_MM = 1.5
CONVERGED_MM = 2e-4
"""Steps end where none along x, y or s (in its own unit) is longer."""
WORTHWHILE_GAIN = 0.01
"""Where all that was gained is no more than noise gains, steps also end when one gains less than this."""
DAMPING = (1e-2, 1e-2, 1e-3)
"""Information that every step is granted, per mm² and per unit of s²: without force there is no place to find."""
START_SPACING_MM = 1.5
START_LEVELS = 6
SURE_OF_DIRECTIONS = 1e-3
"""Keeps directions that only missing regions could tell apart at zero."""
NOWHERE_MM = 9.2
"""Standard deviation of a place of which nothing is known but that it is on 32 mm of surface: 32 / sqrt(12)."""


@dataclass(frozen=True)
class Response:
    """What the gel does when pressed: components of the motion over x, y (mm) and s = F^power.

    `coefficients` (nx, ny, ns, components) belong to cubic splines; the components are scaled such that each has a
    noise of 1 while nothing touches. What the splines miss grows with s: the variance of a component is
    1 + growth (s / high)².
    """

    x: SplineAxis
    y: SplineAxis
    s: SplineAxis
    coefficients: Float32[np.ndarray, 'nx ny ns components']
    growth: Float32[np.ndarray, ' components']
    power: float = 1.0

    @property
    def axes(self) -> tuple[SplineAxis, SplineAxis, SplineAxis]:
        return self.x, self.y, self.s

    @cached_property
    def axes_array(self) -> Float[np.ndarray, '3 3']:
        """Low, high and intervals of each axis."""
        return np.array([[axis.low, axis.high, axis.intervals] for axis in self.axes], float)

    @cached_property
    def limits_array(self) -> Float[np.ndarray, '4 3']:
        """Damping, largest step, lowest and highest value along each axis."""
        largest = LARGEST_STEP_MM, LARGEST_STEP_MM, self.s.high / 4
        return np.array([DAMPING, largest, (self.x.low, self.y.low, 0.0), [axis.high for axis in self.axes]])

    def force_n(self, s: float) -> float:
        """The force that s stands for."""
        return float(max(s, 0.0) ** (1 / self.power))

    def force_slope(self, s: float) -> float:
        """dF/ds."""
        return float(max(s, 1e-9) ** (1 / self.power - 1) / self.power)

    def certainty(self, s: float) -> Float[np.ndarray, ' components']:
        """One over the variance of each component."""
        weights: np.ndarray = 1 / (1 + self.growth * (s / self.s.high) ** 2)
        return weights

    @cached_property
    def starts(self) -> Float[np.ndarray, 'starts 3']:
        """Contacts to begin with: all over the surface, at several forces."""
        x, y = (np.arange(axis.low, axis.high + 1e-9, START_SPACING_MM) for axis in (self.x, self.y))
        s = np.linspace(0.1, 0.95, START_LEVELS) * self.s.high
        return np.stack(np.meshgrid(x, y, s, indexing='ij'), axis=-1).reshape(-1, 3)

    @cached_property
    def start_components(self) -> Float32[np.ndarray, 'starts components']:
        flat = self.coefficients.reshape(-1, self.coefficients.shape[-1])
        return np.asarray(cubes(*self.axes, self.starts) @ flat, np.float32)

    @cached_property
    def _start_norms(self) -> Float32[np.ndarray, ' starts']:
        return np.asarray((self.start_components**2).sum(axis=1), np.float32)

    def start(self, components: Float32[np.ndarray, ' components']) -> Float[np.ndarray, ' 3']:
        """The entry of the table that comes closest; of the lightest contacts any share, since motion begins linear."""
        along, norms = self.start_components @ components, self._start_norms
        away = norms - 2 * along
        light = slice(0, None, START_LEVELS)  # forces change fastest in the table
        lightest = np.maximum(norms[light], 1e-9)
        share = np.minimum(np.maximum(along[light] / lightest, 0.0), 1.0)
        away[light] = share * (share * lightest - 2 * along[light])
        best = int(away.argmin())
        x, y, s = self.starts[best].tolist()
        return np.array([x, y, s if best % START_LEVELS else s * float(share[best // START_LEVELS]) ** self.power])


@cache
def damping(contacts: int) -> Float[np.ndarray, 'n n']:
    """What every step of so many contacts is granted."""
    granted: np.ndarray = np.diag(np.tile(DAMPING, contacts))
    return granted


@dataclass(frozen=True)
class Fit:
    """Contacts (x, y, s), the inverse of their covariance, and the mean squared misfit in units of its variance."""

    contacts: Float[np.ndarray, 'contacts 3']
    information: Float[np.ndarray, 'n n']
    misfit: float


@dataclass(frozen=True)
class Seen:
    """One frame's scores along the principal directions, what they leave over, and the whole: root mean squares."""

    scores: Float32[np.ndarray, ' components']
    left_over: float
    size: float


def project(
    directions: Float32[np.ndarray, 'components inputs'],
    inputs: Float32[np.ndarray, ' inputs'],
    missing: Bool[np.ndarray, ' inputs'],
) -> Seen:
    """Least squares scores of inputs along orthonormal directions, where some inputs are missing (and zero)."""
    along = directions @ inputs
    scores = along
    if missing.any():
        lost = directions[:, missing]
        square = np.eye(len(directions), dtype=np.float32) * (1 + SURE_OF_DIRECTIONS) - lost @ lost.T
        scores = np.linalg.solve(square, along)
    count = max(len(inputs) - int(missing.sum()), 1)
    whole = float(inputs @ inputs)
    left = max(whole - float(scores @ along), 0.0)
    return Seen(scores, math.sqrt(left / count), math.sqrt(whole / count))


def locate(
    response: Response,
    components: Float32[np.ndarray, ' components'],
    begin: Float[np.ndarray, 'contacts 3'],
    least_gain: float = 0.0,
) -> Fit:
    """Gauss-Newton from `begin` to the contacts that explain the components best.

    Where nothing touches there is no place to be found, and steps would go to and fro to the last: they end early once
    they hardly help, as long as the gain (see `gained`) is below `least_gain`.
    """
    if (loops := compiled_loops()) is not None:
        return _located(loops, response, components, begin, least_gain)
    _, largest, low, high = response.limits_array
    granted = damping(len(begin))
    here = begin.copy()
    best: Fit | None = None
    for _ in range(MOST_STEPS):
        fit, slope = _compare(response, components, here)
        before, best = best, fit if best is None or fit.misfit < best.misfit else best
        if before is not None and _in_vain(response, components, before, best, least_gain):
            break
        step = np.linalg.solve(fit.information + granted, slope).reshape(-1, 3)
        moved = np.minimum(np.maximum(here + np.minimum(np.maximum(step, -largest), largest), low), high)
        if np.abs(moved - here).max() < CONVERGED_MM:
            break
        here = moved
    assert best is not None
    return best


def _located(
    loops: ModuleType, response: Response, components: np.ndarray, begin: np.ndarray, least_gain: float
) -> Fit:
    """The same, compiled."""
    count = begin.size
    contacts, information = np.empty_like(begin), np.empty((count, count))
    ends = np.array([CONVERGED_MM, MOST_STEPS, WORTHWHILE_GAIN, least_gain])
    misfit = loops.locate(
        components, begin, response.axes_array, response.coefficients, response.growth, response.limits_array, ends,
        contacts, information,
    )  # fmt: skip
    return Fit(contacts, information, misfit)


def _in_vain(response: Response, components: np.ndarray, before: Fit, best: Fit, least_gain: float) -> bool:
    """Whether a step hardly helped, and nothing is found so far."""
    hardly = before.misfit - best.misfit < 2 * WORTHWHILE_GAIN / len(components)
    return hardly and gained(response, components, best) < least_gain


def gained(response: Response, components: Float32[np.ndarray, ' components'], fit: Fit) -> float:
    """How much more probable the fitted contacts are than none: half the fall of the squared misfit."""
    certainty = response.certainty(float(fit.contacts[:, 2].max()))
    nothing = float(components * components @ certainty)
    return (nothing - fit.misfit * len(components)) / 2


def _compare(
    response: Response, components: np.ndarray, contacts: Float[np.ndarray, 'contacts 3']
) -> tuple[Fit, Float[np.ndarray, ' n']]:
    """How well contacts explain the components, and the way down."""
    made = [value_and_slopes(response.axes, response.coefficients, each) for each in contacts.tolist()]
    left = components - sum(each[0] for each in made)
    # In 64 bits, because in 32 the information of two contacts at one place may come out with a negative variance.
    slopes = np.concatenate([each[1:] for each in made], dtype=np.float64)
    certainty = response.certainty(float(contacts[:, 2].max()))
    weighted = slopes * certainty
    fit = Fit(contacts, weighted @ slopes.T, float(left * left @ certainty) / len(components))
    return fit, weighted @ left


@dataclass(frozen=True)
class Calibration:
    """How stated uncertainties follow from the fit's: measured on presses that were held out in training.

    The standard deviation of a place along x or y is hypot(`place_floor_mm`, the fit's) times a factor for how hard the
    press is, that of a force likewise: `place_factors` and `force_factors` stand at equal steps of s, from nothing to
    the hardest press, with straight lines between. `misfit_limit` is the root of the misfit that one of a thousand
    exceeds; `least_gain` what noise alone gains in one of a thousand frames of the untouched gel (see
    `ResponseReadout.gain`).
    """

    place_floor_mm: float = 0.0
    force_floor_n: float = 0.0
    place_factors: tuple[float, ...] = (1.0,)
    force_factors: tuple[float, ...] = (1.0,)
    misfit_limit: float = 1.0
    least_gain: float = 0.0


def factor_at(factors: tuple[float, ...], height: float) -> float:
    """The factor at a share of the hardest press: of (1, 3) it is 2 at a half."""
    along = min(max(height, 0.0), 1.0) * (len(factors) - 1)
    below = min(int(along), max(len(factors) - 2, 0))
    above = min(below + 1, len(factors) - 1)
    return factors[below] + (along - below) * (factors[above] - factors[below])


@dataclass(frozen=True)
class ResponseReadout:
    """Features to components (`directions`, `whitening`), components to contacts, contacts to bins."""

    scaling: InputScaling
    likeness: Likeness
    whitening: Float32[np.ndarray, 'components components']
    response: Response
    bins: BinGrid
    calibration: Calibration = Calibration()
    most_contacts: int = 1

    kind = 'response'

    @property
    def parameter_count(self) -> int:
        """Coefficients of the splines, principal directions, and the scaling of the components."""
        numbers = self.response.coefficients, self.likeness.directions, self.whitening, self.response.growth
        return sum(each.size for each in numbers)

    def require_fit(self, features: int, bins: BinGrid) -> None:
        if self.likeness.directions.shape[1] != features or bins != self.bins:
            raise ModelError(
                f'a response to {self.likeness.directions.shape[1]} features on {self.bins} does not fit {features} '
                f'features and {bins}; train it again or use another model file'
            )

    def read(
        self, values: Float32[np.ndarray, 'rows cols channels'], confidence: Float32[np.ndarray, 'rows cols']
    ) -> Reading:
        return self.reading(self.seen(values, confidence))

    def seen(
        self, values: Float32[np.ndarray, 'rows cols channels'], confidence: Float32[np.ndarray, 'rows cols']
    ) -> Seen:
        """Features as scores along the principal directions; regions that cannot be followed now have no say.

        Scores are NaN where fewer inputs are left than there are directions to tell apart.
        """
        inputs = self.scaling(values, confidence).reshape(-1)
        missing = np.repeat(self.scaling.missing(confidence).reshape(-1), values.shape[-1])
        seen = project(self.likeness.directions, inputs, missing)
        known = values.shape[-1] * int((self.scaling.trusted > 0).sum())
        enough = known - int(missing.sum()) >= len(self.likeness.directions)
        return seen if enough else replace(seen, scores=np.full_like(seen.scores, UNKNOWN))

    def fit(self, components: Float32[np.ndarray, ' components']) -> Fit:
        """As few contacts as explain the components, `most_contacts` at most."""
        begin, calibration = self.response.start(components)[None], self.calibration
        fit = locate(self.response, components, begin, calibration.least_gain)
        limit = calibration.misfit_limit**2
        while fit.misfit > limit and len(fit.contacts) < self.most_contacts:
            more = locate(self.response, components, self._one_more(components, fit.contacts))
            if more.misfit > 0.5 * fit.misfit:
                break
            fit = more
        return fit

    def _one_more(self, components: np.ndarray, contacts: np.ndarray) -> Float[np.ndarray, 'contacts 3']:
        made = [value_and_slopes(self.response.axes, self.response.coefficients, each)[0] for each in contacts.tolist()]
        return np.vstack([contacts, self.response.start(np.asarray(components - sum(made), np.float32))])

    def reading(self, seen: Seen) -> Reading:
        """Forces on bins, contacts and their uncertainty; no force where what was seen may well be noise."""
        if not (np.isfinite(seen.scores).all() and math.isfinite(seen.size)):
            return nothing_read(self.bins)
        components = self.whitening @ seen.scores
        fit = self.fit(components)
        contacts = self.contacts(fit)
        if self.gain(components, fit) < self.calibration.least_gain:
            contacts = (replace(contacts[0], force_n=0.0, sigma_mm=NOWHERE_MM),)
        sigma_n = math.hypot(*(each.sigma_n for each in contacts))
        limits = self.likeness
        left_over = seen.left_over / (limits.floor + limits.share * seen.size)
        unlike = max(math.sqrt(fit.misfit) / self.calibration.misfit_limit, left_over)
        return Reading(spread_over_bins(contacts, self.bins), contacts, sigma_n, unlike)

    def gain(self, components: Float32[np.ndarray, ' components'], fit: Fit) -> float:
        """See `gained`."""
        return gained(self.response, components, fit)

    def contacts(self, fit: Fit) -> tuple[Contact, ...]:
        """The contacts of a fit with their uncertainties, strongest first."""
        variances = np.linalg.inv(fit.information + damping(len(fit.contacts))).diagonal().reshape(-1, 3)
        found = [self._contact(*each) for each in zip(fit.contacts.tolist(), variances.tolist(), strict=True)]
        return tuple(sorted(found, key=lambda contact: -contact.force_n))

    def _contact(self, place: list[float], variance: list[float]) -> Contact:
        (x, y, s), c = place, self.calibration
        height = s / self.response.s.high
        fitted_mm = math.sqrt((variance[0] + variance[1]) / 2)
        fitted_n = self.response.force_slope(s) * math.sqrt(variance[2])
        sigma_mm = factor_at(c.place_factors, height) * math.hypot(c.place_floor_mm, fitted_mm)
        sigma_n = factor_at(c.force_factors, height) * math.hypot(c.force_floor_n, fitted_n)
        return Contact(x, y, self.response.force_n(s), min(sigma_mm, NOWHERE_MM), sigma_n)
