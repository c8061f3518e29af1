"""One Gauss-Newton step of the regions' numbers and of the numbers they share, from presses and priors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactile_nodes.learning.axisymmetric.regions import (
    PRESSES_AT_ONCE,
    Expected,
    Presses,
    Shared,
    by_regions,
    levers,
    numbers_of,
    shared_levers,
    with_numbers,
)
from tactile_nodes.sensing.explain.axisymmetric.response import AxisymmetricResponse
from tactile_nodes.shapes import Float

LARGEST_STEP_MM = 0.6
LARGEST_SHARED = 0.15
"""Largest step of a shared number: logarithms of softness and width, the smear's shift in mm, its squeeze."""


def fit_regions(
    response: AxisymmetricResponse,
    presses: Presses,
    expected: Expected,
    doubt: Float[np.ndarray, ' distances'],
    shared: Shared | None = None,
) -> AxisymmetricResponse:
    """One Gauss-Newton step of every region's numbers towards the most probable ones.

    With `shared`, the numbers that all regions share are fitted as well.
    """
    numbers = numbers_of(response)
    equations = Equations.of(response, presses, doubt, shared).near(numbers, expected)
    step, move = equations.solved()
    if shared:
        response = shared.moved(response, move)
    return stepped(response, step)


def stepped(response: AxisymmetricResponse, step: Float[np.ndarray, 'regions numbers']) -> AxisymmetricResponse:
    """The response with its regions' numbers moved; steps of places are limited."""
    step = np.concatenate([step[:, :-2], np.clip(step[:, -2:], -LARGEST_STEP_MM, LARGEST_STEP_MM)], axis=1)
    return with_numbers(response, numbers_of(response) + step)


@dataclass(frozen=True)
class Equations:
    """The normal equations of one Gauss-Newton step: of each region's numbers, and of the common numbers.

    `square` and `down` are of each region. `across` and `along` are of the common numbers, whose steps are limited to
    `longest`. `cross` couples both.
    """

    square: Float[np.ndarray, 'regions numbers numbers']
    down: Float[np.ndarray, 'regions numbers']
    cross: Float[np.ndarray, 'regions numbers common']
    across: Float[np.ndarray, 'common common']
    along: Float[np.ndarray, ' common']
    longest: Float[np.ndarray, ' common']

    @classmethod
    def of(
        cls,
        response: AxisymmetricResponse,
        presses: Presses,
        doubt: Float[np.ndarray, ' distances'],
        shared: Shared | None = None,
    ) -> Equations:
        """From the presses, and from the prior of the shared numbers."""
        numbers = numbers_of(response)
        free = shared.free if shared else np.zeros(0, int)
        square, down = np.zeros((*numbers.shape, numbers.shape[1])), np.zeros(numbers.shape)
        cross = np.zeros((*numbers.shape, len(free)))
        across, along = shared.equations(response) if shared else (np.zeros((0, 0)), np.zeros(0))
        for part in np.array_split(np.arange(len(presses)), max(1, len(presses) // PRESSES_AT_ONCE)):
            some = presses.take(part)
            columns, slopes = response.columns_and_slopes(some.contacts)
            predicted = response.with_sides(response.motion_of_columns(columns), some.contacts)
            weight = some.weights(response, doubt, predicted)
            left = ((some.motion - predicted) * weight).transpose(1, 0, 2).reshape(len(numbers), -1)
            by_region = by_regions(levers(response, columns, slopes) * weight[..., None])
            square += by_region.transpose(0, 2, 1) @ by_region
            down += np.matmul(left[:, None], by_region)[:, 0]
            if len(free):
                both = by_regions(shared_levers(response, some.contacts, slopes)[..., free] * weight[..., None])
                cross += by_region.transpose(0, 2, 1) @ both
                across = across + np.einsum('rni,rnj->ij', both, both)
                along = along + np.einsum('rn,rni->i', left, both)
        return cls(square, down, cross, across, along, np.full(len(free), LARGEST_SHARED))

    def near(self, numbers: Float[np.ndarray, 'regions numbers'], expected: Expected) -> Equations:
        """The equations with the prior of the regions, whose present numbers are `numbers`."""
        down = self.down + np.einsum('rn,rnm->rm', expected.numbers - numbers, expected.precision)
        return replace(self, square=self.square + expected.precision, down=down)

    def solved(self) -> tuple[Float[np.ndarray, 'regions numbers'], Float[np.ndarray, ' common']]:
        """The steps of the regions' and of the common numbers.

        The regions' numbers are eliminated from the equations of the common ones (Schur complement).
        """
        solved = np.linalg.solve(self.square, np.concatenate([self.down[..., None], self.cross], axis=2))
        step, follow = solved[..., 0], solved[..., 1:]
        across = self.across - np.tensordot(self.cross, follow, axes=([0, 1], [0, 1]))
        move = np.linalg.solve(across, self.along - np.tensordot(self.cross, step, axes=([0, 1], [0, 1])))
        move = np.clip(move, -self.longest, self.longest)
        return step - follow @ move, move
