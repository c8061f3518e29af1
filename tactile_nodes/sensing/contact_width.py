"""Is a contact wider than those of the training? Asked of what the fit leaves over, by the response itself.

A wider contact is many of the training's side by side, and motions add up. So what it adds is, to the second order, the
bend of the response along x and y (its Laplacian), times half the mean square of how far they lie apart: no other body
need be known. A tip of the training has none of it, a ball or a flat punch has, and so have two contacts close together
that came out as one. The force that comes out of such a contact is another, by how much follows from the same fit.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float, Float32

from tactile_nodes.sensing.response import Fit, Response, damping
from tactile_nodes.sensing.splines import laplacian, value_and_slopes

WIDE_MM2 = 0.1
"""Beyond this a contact is wider than those of the training: it adds as much as an even pressure over 1.8 mm would.

The tip's own presses stay below it, but for a few of the hardest; a flat punch of 3 mm and a ball of 6 mm lie above it
from 0.1 and 0.15 N on.
"""

SURE_OF_WIDTH = 3.0
"""Standard deviations by which it must lie above none at all."""


def added_by_width(
    response: Response, components: Float32[np.ndarray, ' components'], fit: Fit
) -> Float[np.ndarray, 'contacts 3']:
    """How much wider each contact is (mm²), its standard deviation, and by how much s would be another with it."""
    made = [value_and_slopes(response.axes, response.coefficients, each) for each in fit.contacts.tolist()]
    left = components - sum(each[0] for each in made)
    certainty = response.certainty(float(fit.contacts[:, 2].max()))
    found = [
        _added(at[2], each, laplacian(response.axes, response.coefficients, at), left, certainty)
        for each, at in zip(made, fit.contacts.tolist(), strict=True)
    ]
    return np.array(found)


def _added(
    s: float, made: np.ndarray, bend: np.ndarray, left: np.ndarray, certainty: np.ndarray
) -> tuple[float, float, float]:
    """One step of least squares by x, y, s and width, from a fit by the first three; s is off by itself at most."""
    slopes = np.concatenate([made[1:], bend[None]], dtype=np.float64)
    information = (slopes * certainty) @ slopes.T
    information[:3, :3] += damping(1)
    spread = np.linalg.inv(information)
    step = spread @ (slopes @ (left * certainty))
    return float(step[3]), math.sqrt(spread[3, 3]), min(max(float(step[2]), -s), s)


def wide(added: Float[np.ndarray, 'contacts 3']) -> np.ndarray:
    """Which contacts are wider than those of the training."""
    which: np.ndarray = (added[:, 0] >= WIDE_MM2) & (added[:, 0] >= SURE_OF_WIDTH * added[:, 1])
    return which
