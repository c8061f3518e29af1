"""How another gel differs from a known one as a whole: hardness, thickness, and the view of its camera.

The regions' places and couplings of the known gel are first smoothed over the image, because the effects of its single
markers are not shared by the other gel. A few numbers of the other gel are free. They are found by nonlinear least
squares on the whole motion field of every press.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tactile_nodes.learning.axisymmetric.regions import FIRST_DOUBT, Presses, numbers_of, with_numbers
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

    Markers that lie deeper than usual are seen further out or in, and all that their region shows changes with it: in
    the radial direction everywhere alike, and more with the distance from the image centre.
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


MOST_STEPS = 10
CONVERGED = 1e-4
"""Share of the cost: iteration ends when no step gains more."""
STEP = 1e-3
FIRST_DAMPING, LAST_DAMPING = 1e-3, 1e5
MARKERS_ELSEWHERE = 0.1
"""Standard deviation as a share of each region's motion, due to markers at other places."""
ROUNDS = 2
RIM = 0.9
"""Share of the image's half width: regions further out are cut by the gel's rim, differently on every gel."""
RIM_SCATTER = 4.0
"""Factor on variances at the rim: on the known gel those of places are 2 to 6 times larger there."""

SIZES = {
    'softness': 0.5, 'width': 0.1, 'turn_xx': 0.1, 'turn_yx': 0.1, 'turn_xy': 0.1, 'turn_yy': 0.1,
    'shift_x_mm': 2.0, 'shift_y_mm': 2.0, 'lateral': 0.05, 'vertical': 0.1, 'roll': 0.2,
    'view_x': 0.3, 'view_y': 0.3,
}  # fmt: skip
"""The free numbers, 0 for an equal gel, and their prior standard deviations. Of the gel: the logarithms of softness
and of the width of distances. Of the places that regions look at: a linear map and a shift. Of what they see:
logarithms of the gains of lateral and vertical motion, a rotation of both, and vertical motion seen sideways."""
OFFSET_N = 1.0
"""Prior standard deviation of the force offset, if that is free too."""


def powers(view: Float[np.ndarray, 'regions 2']) -> Float[np.ndarray, 'regions terms']:
    """Polynomials of the third degree in the place in the image (-1 to 1)."""
    u, v = view.T
    return np.stack([u**i * v**j for i in range(4) for j in range(4 - i)], axis=1)


@dataclass(frozen=True)
class Typical:
    """The regions of a known gel as smooth functions over the image, and their scatter about these."""

    terms: Float[np.ndarray, 'terms numbers']
    scatter: Scatter
    response: AxisymmetricResponse

    @classmethod
    def of(cls, response: AxisymmetricResponse, view: Float[np.ndarray, 'regions 2']) -> Typical:
        numbers = numbers_of(response)
        terms = np.linalg.lstsq(powers(view), numbers, rcond=None)[0]
        inside = np.abs(view).max(axis=1) < RIM
        off = (numbers - powers(view) @ terms)[inside]
        return cls(terms, Scatter.of(response, off, view[inside], len(terms)), response)

    def precision(self, view: Float[np.ndarray, 'regions 2']) -> Float[np.ndarray, 'regions numbers numbers']:
        """The inverse covariance of regions at these places in the image about the smooth functions."""
        looser = np.where(np.abs(view).max(axis=1) < RIM, 1.0, RIM_SCATTER)
        precision: np.ndarray = np.linalg.inv(self.scatter.covariance(view)) / looser[:, None, None]
        return precision

    def at(self, view: Float[np.ndarray, 'regions 2']) -> AxisymmetricResponse:
        """The known gel's response as regions at these places in the image would see it on average."""
        blank = np.zeros((len(view), 2, self.response.couplings.shape[2]))
        plain = replace(self.response, couplings=blank, places=np.zeros((len(view), 2)), unsure=None)
        return with_numbers(plain, powers(view) @ self.terms)


def changed(response: AxisymmetricResponse, numbers: Float[np.ndarray, ' numbers']) -> AxisymmetricResponse:
    """The response of a gel that differs by these numbers, in the order of `SIZES`."""
    softness, width, xx, yx, xy, yy, right, down, lateral, vertical, roll, aside, below = numbers.tolist()
    turn = np.array([[1 + xx, xy], [yx, 1 + yy]])
    seen = math.exp(lateral) * np.array([[1.0, roll], [-roll, 1.0]])
    couplings = np.einsum('ab,rbd->rad', seen, response.couplings)
    first = 2 * response.lateral
    couplings[:, :, first:] *= math.exp(vertical)
    couplings[:, :, first] += np.array([aside, below])
    return replace(
        response,
        places=response.places @ turn.T + np.array([right, down]),
        couplings=couplings,
        width=response.width * math.exp(width),
        softness=response.softness * math.exp(softness),
    )


@dataclass(frozen=True)
class WholeFit:
    """The numbers by which a gel differs as a whole, and the force offset (N) of its presses."""

    response: AxisymmetricResponse
    numbers: Float[np.ndarray, ' numbers']
    offset_n: float = 0.0

    @property
    def softness(self) -> float:
        """How many times as soft as the known gel."""
        return math.exp(self.numbers[tuple(SIZES).index('softness')])


def fit_whole(
    start: AxisymmetricResponse,
    presses: Presses,
    *,
    begin: np.ndarray | None = None,
    offset: bool = False,
) -> WholeFit:
    """The response, changed as a whole, that explains the presses best (Levenberg-Marquardt).

    With `offset` the force offset is free, too. `begin` may be the numbers of a fit to other presses.
    """
    sizes = np.array([*SIZES.values(), OFFSET_N * offset])
    open_ = np.flatnonzero(sizes)
    doubt = np.hypot(FIRST_DOUBT, MARKERS_ELSEWHERE)
    current = np.zeros(len(sizes)) if begin is None else np.append(begin, 0.0)
    for _ in range(ROUNDS if begin is None else 1):
        # Weights by predicted motion: by measured motion, regions that happen to move little would weigh more.
        weight = presses.weights(changed(start, current[:-1]), doubt)

        def left(numbers: np.ndarray, weight: np.ndarray = weight) -> np.ndarray:
            contacts = presses.contacts - np.array([0.0, 0.0, numbers[-1]])
            contacts[:, 2] = np.maximum(contacts[:, 2], 0.0)
            predicted = changed(start, numbers[:-1]).motion(contacts)
            residual: np.ndarray = (presses.left(predicted, weight) * weight).ravel()
            return residual

        current = _descend(left, current, open_, 1 / sizes[open_] ** 2)
    return WholeFit(changed(start, current[:-1]), current[:-1], float(current[-1]))


def _descend(
    left: Callable[[np.ndarray], np.ndarray], current: np.ndarray, open_: np.ndarray, prior: np.ndarray
) -> np.ndarray:
    """Levenberg-Marquardt steps of the free numbers, with slopes by finite differences."""
    residual, damping = left(current), FIRST_DAMPING
    cost = residual @ residual + prior @ current[open_] ** 2
    for _ in range(MOST_STEPS):
        lever = np.stack(
            [(left(current + STEP * unit) - residual) / STEP for unit in np.eye(len(current))[open_]], axis=1
        )
        square, down = lever.T @ lever + np.diag(prior), -(lever.T @ residual + prior * current[open_])
        while damping < LAST_DAMPING:
            further = current.copy()
            further[open_] += np.linalg.solve(square + damping * np.diag(np.diag(square)), down)
            tried = left(further)
            value = tried @ tried + prior @ further[open_] ** 2
            if value < cost:
                break
            damping *= 10
        else:
            break
        gained, current, residual, cost = cost - value, further, tried, value
        damping = max(damping / 10, 1e-9)
        if gained < CONVERGED * cost:
            break
    return current
