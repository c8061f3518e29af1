"""The measured response of a gel, and the fit of place and force to a frame.

The motion that a tip causes is a smooth function of where it presses (x, y) and how hard. In training that function is
measured (cubic splines over x, y and the force s, of the features' principal components). For a frame the contact with
the closest motion is found by Gauss-Newton steps from the best entry of a coarse table. So position and force are
continuous and have a covariance, and the residual that no contact explains is known. Motions of several contacts add up
(superposition), as they nearly do in a soft layer.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from tactile_nodes.sensing.explain.splines import SplineAxis, cubes, value_and_slopes
from tactile_nodes.shapes import Bool, Float, Float32

MOST_STEPS = 12
LARGEST_STEP_MM = 1.5
CONVERGED_MM = 2e-4
"""Iteration ends when no step along x and y [mm] or s [N] is longer."""
WORTHWHILE_GAIN = 0.01
"""While the total gain is within noise, iteration also ends when a step gains less than this."""
DAMPING = (1e-2, 1e-2, 1e-3)
"""Prior information in every step [1/mm², 1/N²]: without force the place is undetermined."""
START_SPACING_MM = 1.5
START_LEVELS = 6


@dataclass(frozen=True)
class Response:
    """Response of the gel: components of the motion over x, y [mm] and the force s [N].

    `coefficients` (nx, ny, ns, components) are those of cubic splines. The components are scaled to a noise of 1 while
    nothing touches. The error of the splines grows with s: the variance of a component is 1 + growth (s / high)².
    """

    x: SplineAxis
    y: SplineAxis
    s: SplineAxis
    coefficients: Float32[np.ndarray, 'nx ny ns components']
    growth: Float32[np.ndarray, ' components']

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

    @cached_property
    def for_loops(self) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
        """For loops: axes, coefficients, growth and limits; contacts to begin with, as a table."""
        coefficients, growth = (np.ascontiguousarray(each, np.float32) for each in (self.coefficients, self.growth))
        # As whole numbers the table is half as much to read for each frame.
        unit = np.maximum(np.abs(self.start_components).max(axis=0), 1e-30) / np.float32(np.iinfo(np.int16).max)
        rounded = np.ascontiguousarray(np.rint(self.start_components / unit).astype(np.int16).T)
        return (self.axes_array, coefficients, growth, self.limits_array), (
            self.starts,
            rounded,
            unit,
            self._start_norms,
        )

    @property
    def hard(self) -> float:
        """The s at which the last interval of the splines begins: borne from one side, they are off twice as far."""
        return self.s.high - (self.s.high - self.s.low) / self.s.intervals

    def near_ends(self, contacts: Float[np.ndarray, 'contacts 3']) -> Bool[np.ndarray, ' contacts']:
        """Which contacts lie where the last interval along x or y has begun, and are as hard as `hard` less the share
        of it that they have gone: those that are near an end twice over are off by several times as much."""
        rim = sum(_last_interval(axis, contacts[:, number]) for number, axis in enumerate((self.x, self.y)))
        which: np.ndarray = (rim > 0) & (contacts[:, 2] >= self.hard * (1 - rim))
        return which

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
        return np.array([x, y, s if best % START_LEVELS else s * float(share[best // START_LEVELS])])


def _last_interval(axis: SplineAxis, places: Float[np.ndarray, ' n']) -> Float[np.ndarray, ' n']:
    """How much of the last interval of an axis, to either side, lies between its beginning and each place."""
    step = (axis.high - axis.low) / axis.intervals
    gone: np.ndarray = np.maximum(np.maximum(axis.low + step - places, places - (axis.high - step)) / step, 0.0)
    return gone


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

    @property
    def variances(self) -> Float[np.ndarray, 'contacts 3']:
        """Variances of each contact's numbers, with the prior information of every step."""
        spread: np.ndarray = np.linalg.inv(self.information + damping(len(self.contacts))).diagonal()
        return spread.reshape(-1, 3)


def locate(
    response: Response,
    components: Float32[np.ndarray, ' components'],
    begin: Float[np.ndarray, 'contacts 3'],
    least_gain: float = 0.0,
) -> Fit:
    """Gauss-Newton from `begin` to the contacts that explain the components best.

    If nothing touches, the place is undetermined and steps would oscillate. So they end early once they hardly help, as
    long as the gain (see `gained`) is below `least_gain`.
    """
    _, largest, low, high = response.limits_array
    granted = damping(len(begin))
    current = begin.copy()
    best: Fit | None = None
    for _ in range(MOST_STEPS):
        fit, slope = _compare(response, components, current)
        before, best = best, fit if best is None or fit.misfit < best.misfit else best
        if before is not None and _in_vain(response, components, before, best, least_gain):
            break
        step = np.linalg.solve(fit.information + granted, slope).reshape(-1, 3)
        moved = np.minimum(np.maximum(current + np.minimum(np.maximum(step, -largest), largest), low), high)
        if np.abs(moved - current).max() < CONVERGED_MM:
            break
        current = moved
    assert best is not None
    return best


def at_an_end(response: Response, contacts: Float[np.ndarray, 'contacts 3']) -> Bool[np.ndarray, ' contacts']:
    """Which contacts lie at an end of the splines: their true place or force may lie beyond."""
    _, _, low, high = response.limits_array
    ends = (contacts >= high - CONVERGED_MM) | (contacts <= [low[0] + CONVERGED_MM, low[1] + CONVERGED_MM, -1.0])
    which: np.ndarray = ends.any(axis=1)
    return which


def ends(least_gain: float) -> Float[np.ndarray, ' 4']:
    """Criteria for the end of the iteration, for `loops.response._locate`."""
    return np.array([CONVERGED_MM, MOST_STEPS, WORTHWHILE_GAIN, least_gain])


def _in_vain(response: Response, components: np.ndarray, before: Fit, best: Fit, least_gain: float) -> bool:
    """Whether a step hardly helped and no contact is found so far."""
    hardly = before.misfit - best.misfit < 2 * WORTHWHILE_GAIN / len(components)
    return hardly and gained(response, components, best) < least_gain


def gained(response: Response, components: Float32[np.ndarray, ' components'], fit: Fit) -> float:
    """Log-likelihood ratio of the fitted contacts to none: half the decrease of the squared misfit."""
    certainty = response.certainty(float(fit.contacts[:, 2].max()))
    nothing = float(components * components @ certainty)
    return (nothing - fit.misfit * len(components)) / 2


def _compare(
    response: Response, components: np.ndarray, contacts: Float[np.ndarray, 'contacts 3']
) -> tuple[Fit, Float[np.ndarray, ' n']]:
    """Fit of contacts to the components, and the descent direction."""
    modelled = [value_and_slopes(response.axes, response.coefficients, each) for each in contacts.tolist()]
    left = components - sum(each[0] for each in modelled)
    # In 64 bits: in 32 bits the information of two contacts at one place may give a negative variance.
    slopes = np.concatenate([each[1:] for each in modelled], dtype=np.float64)
    certainty = response.certainty(float(contacts[:, 2].max()))
    weighted = slopes * certainty
    fit = Fit(contacts, weighted @ slopes.T, float(left * left @ certainty) / len(components))
    return fit, weighted @ left
