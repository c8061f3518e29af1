"""Regions of another gel, found together with the smooth functions over the image that they scatter about."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from tactile_nodes.learning.axisymmetric.regions import Expected, Presses, Shared, numbers_of
from tactile_nodes.learning.axisymmetric.steps import Equations, stepped
from tactile_nodes.learning.transfer.whole import Typical, powers
from tactile_nodes.sensing.explain.axisymmetric.response import AxisymmetricResponse

ASIDE, PLACES_ASIDE = 0.3, 0.6
"""Of what a region scatters by: how far a term of the smooth functions is expected from where the whole fit has it, of
couplings and of places, where presses are known whole."""


@dataclass(frozen=True)
class Smooth:
    """What is typical of regions: terms of smooth functions over the image, and where these were expected.

    `over` is what terms are multiplied with at each region, `precision` one over the covariance of a term's numbers.
    """

    over: Float[np.ndarray, 'regions terms']
    terms: Float[np.ndarray, 'terms numbers']
    expected: Float[np.ndarray, 'terms numbers']
    precision: Float[np.ndarray, 'numbers numbers']

    @classmethod
    def of(
        cls, response: AxisymmetricResponse, typical: Typical, view: Float[np.ndarray, 'regions 2'], aside: float
    ) -> Smooth:
        """As regions at these places in the image are now, and held there by how regions scatter all round.

        `aside` is how far, of what a region scatters by, a term is expected from there in couplings.
        """
        over = powers(view)
        terms = np.linalg.lstsq(over, numbers_of(response), rcond=None)[0]
        share = np.r_[np.full(terms.shape[1] - 2, aside), PLACES_ASIDE, PLACES_ASIDE]
        around = typical.scatter.covariance(view).mean(axis=0) * share * share[:, None]
        return cls(over, terms, terms, np.linalg.inv(around))

    @property
    def numbers(self) -> Float[np.ndarray, 'regions numbers']:
        """What regions are expected to have."""
        numbers: np.ndarray = self.over @ self.terms
        return numbers

    def beside(
        self,
        equations: Equations,
        here: Float[np.ndarray, 'regions numbers'],
        precision: Float[np.ndarray, 'regions numbers numbers'],
    ) -> Equations:
        """The equations of regions held near these functions by a precision, with the terms as what is common, too.

        Terms come after all that is common already, number by number of the first one.
        """
        terms, numbers = self.terms.shape
        count = terms * numbers
        pulled = np.einsum('rij,rk->rikj', precision, self.over).reshape(len(here), numbers, count)
        held = np.einsum('rk,rl,rij->kilj', self.over, self.over, precision, optimize=True).reshape(count, count)
        off = np.einsum('rk,rij,rj->ki', self.over, precision, here - self.numbers, optimize=True)
        before = len(equations.along)
        across = np.zeros((before + count, before + count))
        across[:before, :before] = equations.across
        across[before:, before:] = held + np.kron(np.eye(terms), self.precision)
        along = off - (self.terms - self.expected) @ self.precision
        return replace(
            equations.near(here, Expected(self.numbers, precision)),
            cross=np.concatenate([equations.cross, -pulled], axis=2),
            across=across,
            along=np.r_[equations.along, along.ravel()],
            longest=np.r_[equations.longest, np.full(count, np.inf)],
        )

    def moved(self, move: Float[np.ndarray, ' common']) -> Smooth:
        """With its terms moved."""
        return replace(self, terms=self.terms + move.reshape(self.terms.shape))


def fit_with_smooth(
    response: AxisymmetricResponse,
    presses: Presses,
    smooth: Smooth,
    precision: Float[np.ndarray, 'regions numbers numbers'],
    doubt: Float[np.ndarray, ' distances'],
    shared: Shared,
) -> tuple[AxisymmetricResponse, Smooth]:
    """One Gauss-Newton step of regions, of the smooth functions that they scatter about, and of what is shared."""
    equations = Equations.of(response, presses, doubt, shared)
    step, move = smooth.beside(equations, numbers_of(response), precision).solved()
    first = len(shared.free)
    return stepped(shared.moved(response, move[:first]), step), smooth.moved(move[first:])
