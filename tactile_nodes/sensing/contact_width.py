"""Is a contact wider than those of the training? Asked of what the fit leaves over, by the response itself.

A wider contact is many of the training's side by side, and motions add up. So what it adds is, to the second order, the
bend of the response along x and y (its Laplacian), times half the mean square of how far they lie apart: no other body
need be known. A tip of the training has next to none of it, a ball or a flat punch has, and so have two contacts close
together that came out as one. The force that comes out of such a contact is another, by how much follows from the same
fit.

A little of it every contact has: what splines and regions miss of a response is mostly how sharp its peak is. So place
and force are those of a fit that also knows a width, which lies so near none as the training's own do. Of a light
contact that is surely wider the force is that of a body of another shape, as far as this step knows it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Float32

from tactile_nodes.sensing.response import Fit, Response, at_an_end, damping
from tactile_nodes.sensing.splines import laplacian, value_and_slopes

WIDE_MM2 = 0.1
"""Beyond this a contact is wider than those of the training: it adds as much as an even pressure over 1.8 mm would.

The tip's own presses stay below it, but for a few of the hardest; a flat punch of 3 mm and a ball of 6 mm lie above it
from 0.1 and 0.15 N on.
"""

SURE_OF_WIDTH = 2.0
"""Standard deviations by which it must lie above none at all."""

USUAL_MM2 = 0.015
"""Standard deviation of the width of contacts that are as those of the training.

Half of it and twice as much take less of the error away, on presses at random places that no model was trained with.
"""


ANY_MM2 = 0.3
"""Standard deviation of the width of contacts of other shapes, which are taken to be as many as those of the tip."""

TAKEN = 0.7
"""Of what a width adds to the force, as much is taken: second order alone adds too much, most of all of balls."""

TAKEN_BELOW, LEFT_FROM = 0.3, 0.6
"""Of the largest s. Where a body is deeper in the gel, a width adds several times too much, and presses of the tip have
one: it is less and less of it that is taken, and from there on none."""

WIDTHS = USUAL_MM2, ANY_MM2, TAKEN, TAKEN_BELOW, LEFT_FROM
"""As loops want them."""


@dataclass(frozen=True)
class Widths:
    """Of each contact: how much wider it is (mm²), its standard deviation, and what that does to it.

    `steps` is what x, y and s are another by with a width as usual as the training's, and s with as much of any as is
    `taken`; `off` by how much further s is with any width.
    """

    mm2: Float[np.ndarray, ' contacts']
    sigma_mm2: Float[np.ndarray, ' contacts']
    steps: Float[np.ndarray, 'contacts 3']
    off: Float[np.ndarray, ' contacts']

    @property
    def wide(self) -> Bool[np.ndarray, ' contacts']:
        """Which contacts are wider than those of the training."""
        which: np.ndarray = (self.mm2 >= WIDE_MM2) & (self.mm2 >= SURE_OF_WIDTH * self.sigma_mm2)
        return which


def added_by_width(response: Response, components: Float32[np.ndarray, ' components'], fit: Fit) -> Widths:
    """What a width of its own adds to each contact."""
    made = [value_and_slopes(response.axes, response.coefficients, each) for each in fit.contacts.tolist()]
    left = components - sum(each[0] for each in made)
    certainty = response.certainty(float(fit.contacts[:, 2].max()))
    found = [
        _added(at[2], each, laplacian(response.axes, response.coefficients, at), left, certainty, response.s.high)
        for each, at in zip(made, fit.contacts.tolist(), strict=True)
    ]
    mm2, sigma_mm2, steps, off = zip(*found, strict=True)
    return Widths(np.array(mm2), np.array(sigma_mm2), np.array(steps), np.array(off))


def _added(
    s: float, made: np.ndarray, bend: np.ndarray, left: np.ndarray, certainty: np.ndarray, highest: float
) -> tuple[float, float, np.ndarray, float]:
    """One step of least squares by x, y, s and width, from a fit by the first three; s is off by itself at most."""
    slopes = np.concatenate([made[1:], bend[None]], dtype=np.float64)
    information = (slopes * certainty) @ slopes.T
    information[:3, :3] += damping(1)
    spread = np.linalg.inv(information)
    step = spread @ (slopes @ (left * certainty))
    width, variance = float(step[3]), float(spread[3, 3])
    usual: np.ndarray = step[:3] - spread[:3, 3] * (width / (variance + USUAL_MM2**2))
    off = min(max(float(step[2]), -s), s) - min(max(float(usual[2]), -s), s)
    share = taken(width, variance, s / highest)
    usual[2] += share * off
    return width, math.sqrt(variance), usual, (1 - share) * off


def taken(mm2: float, variance: float, height: float) -> float:
    """The share of a width's force that is taken: by how likely it is that of another shape, and less of hard contacts.

    `height` is s in units of its largest. Either shape is as likely before anything is seen; see `ANY_MM2`.
    """
    usual, whatever = variance + (2 * USUAL_MM2) ** 2, variance + ANY_MM2**2
    against = math.sqrt(whatever / usual) * math.exp(-mm2 * mm2 / 2 * (1 / usual - 1 / whatever))
    fading = min(max((LEFT_FROM - height) / (LEFT_FROM - TAKEN_BELOW), 0.0), 1.0)
    return TAKEN * fading / (1 + against) if mm2 > 0 else 0.0


def mended(response: Response, fit: Fit, widths: Widths) -> Fit:
    """The fit with each contact where it is with a usual width; one that lies where the splines end stays there."""
    _, largest, low, high = response.limits_array
    moved = np.clip(fit.contacts + np.clip(widths.steps, -largest, largest), low, high)
    return replace(fit, contacts=np.where(at_an_end(response, fit.contacts)[:, None], fit.contacts, moved))
