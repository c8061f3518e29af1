"""Fit the regions of another gel together with the smooth functions over the image that they scatter about."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactile_nodes.learning.axisymmetric.regions import Expected, Presses, Shared, numbers_of
from tactile_nodes.learning.axisymmetric.steps import Equations, stepped
from tactile_nodes.learning.transfer.whole import Typical, powers
from tactile_nodes.sensing.explain.axisymmetric.response import AxisymmetricResponse
from tactile_nodes.shapes import Float

ASIDE, PLACES_ASIDE = 0.3, 0.6
"""Prior standard deviation of a term of the smooth functions around the whole-gel fit, as a share of the regions'
scatter: of couplings and of places."""


@dataclass(frozen=True)
class Smooth:
    """Typical numbers of regions: terms of smooth functions over the image, and their prior.

    `over` is what terms are multiplied with at each region; `precision` is the inverse covariance of a term's numbers.
    """

    over: Float[np.ndarray, 'regions terms']
    terms: Float[np.ndarray, 'terms numbers']
    expected: Float[np.ndarray, 'terms numbers']
    precision: Float[np.ndarray, 'numbers numbers']

    @classmethod
    def of(cls, response: AxisymmetricResponse, typical: Typical, view: Float[np.ndarray, 'regions 2']) -> Smooth:
        """Start at the present numbers of regions at these places in the image; the prior is their average scatter."""
        over = powers(view)
        terms = np.linalg.lstsq(over, numbers_of(response), rcond=None)[0]
        share = np.r_[np.full(terms.shape[1] - 2, ASIDE), PLACES_ASIDE, PLACES_ASIDE]
        around = typical.scatter.covariance(view).mean(axis=0) * share * share[:, None]
        return cls(over, terms, terms, np.linalg.inv(around))

    @property
    def numbers(self) -> Float[np.ndarray, 'regions numbers']:
        """The expected numbers of the regions."""
        numbers: np.ndarray = self.over @ self.terms
        return numbers

    def step(
        self,
        equations: Equations,
        current: Float[np.ndarray, 'regions numbers'],
        precision: Float[np.ndarray, 'regions numbers numbers'],
    ) -> tuple[Float[np.ndarray, 'regions numbers'], Float[np.ndarray, ' common']]:
        """The steps of regions with these functions as prior mean and with a precision, and of the common numbers.

        Terms are common numbers, too. They follow the other common numbers, number by number of the first term. A
        region depends on the same numbers of every term, multiplied by the term's value there. So regions are solved
        for the numbers of one term only.
        """
        near = equations.near(current, Expected(self.numbers, precision))
        shared, (terms, numbers) = len(near.along), self.terms.shape
        known = np.concatenate([near.down[..., None], near.cross, -precision], axis=2)
        solved = np.linalg.solve(near.square, known)
        step, follow, pulled = np.split(solved, [1, 1 + shared], axis=2)

        def over(by_region: Float[np.ndarray, 'regions rows numbers']) -> Float[np.ndarray, 'rows common']:
            summed: np.ndarray = np.einsum('rk,rij->ikj', self.over, by_region, optimize=True)
            return summed.reshape(-1, terms * numbers)

        held = precision + precision @ pulled  # of a term by itself, minus what regions absorb
        across = np.einsum('rk,rl,rij->kilj', self.over, self.over, held, optimize=True).reshape(2 * [terms * numbers])
        across += np.kron(np.eye(terms), self.precision)
        both = -over(near.cross.transpose(0, 2, 1) @ pulled)
        off = over(((current - self.numbers)[:, None] + step.transpose(0, 2, 1)) @ precision)[0]
        down = near.along - np.tensordot(near.cross, step[..., 0], axes=([0, 1], [0, 1]))
        move = np.linalg.solve(
            np.block([[near.across - np.tensordot(near.cross, follow, axes=([0, 1], [0, 1])), both], [both.T, across]]),
            np.r_[down, off - ((self.terms - self.expected) @ self.precision).ravel()],
        )
        move[:shared] = np.clip(move[:shared], -near.longest, near.longest)
        of_terms = self.over @ move[shared:].reshape(terms, numbers)
        return step[..., 0] - follow @ move[:shared] - (pulled @ of_terms[..., None])[..., 0], move

    def moved(self, move: Float[np.ndarray, ' common']) -> Smooth:
        """The functions with their terms moved."""
        return replace(self, terms=self.terms + move.reshape(self.terms.shape))


def fit_with_smooth(
    response: AxisymmetricResponse,
    presses: Presses,
    smooth: Smooth,
    precision: Float[np.ndarray, 'regions numbers numbers'],
    doubt: Float[np.ndarray, ' distances'],
    shared: Shared,
) -> tuple[AxisymmetricResponse, Smooth]:
    """One Gauss-Newton step of regions, of the smooth functions that they scatter about, and of the shared numbers."""
    equations = Equations.of(response, presses, doubt, shared)
    step, move = smooth.step(equations, numbers_of(response), precision)
    first = len(shared.free)
    return stepped(shared.moved(response, move[:first]), step), smooth.moved(move[first:])
