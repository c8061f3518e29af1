"""Is a contact a tip of the training, pressed straight down? Asked of what the fit leaves over, by the response itself.

A wider contact is many of the training's side by side, and motions add up. So what it adds is, to the second order, the
bend of the response along x and y (its Laplacian), times half the mean square of how far they lie apart: no other body
need be known. A ball or a flat punch has much of it, and so have two contacts close together that came out as one. A
little of it every contact has: what splines and regions miss of a response is mostly how sharp its peak is. So place
and force are those of a fit that also knows a width, which lies so near none as the training's own do.

A press moves what is around it towards it or away from it, so that moving it, or pressing harder, shifts the picture as
a whole by next to nothing. A tip that drags the skin does. So what is asked is how much more probable a shift of all
regions, along x and along y, makes what is seen.

Neither is corrected: of what another body or a drag does only a part looks like that. It puts in doubt what is told.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Float32

from tactile_nodes.sensing.explain.measured.response import Fit, Response, at_an_end, damping
from tactile_nodes.sensing.explain.splines import laplacian, value_and_slopes

WIDE_MM2 = 0.1
"""Beyond this a contact is wider than those of the training: it adds as much as an even pressure over 1.8 mm would.

The tip's own presses stay below it, but for a few of the hardest; a flat punch of 3 mm and a ball of 6 mm lie above it
from 0.1 and 0.15 N on.
"""

SURE_OF_WIDTH = 3.1
"""Standard deviations by which it must lie above none at all: noise does so to one of a thousand."""

DOUBT_PER_MM2, DOUBT_OF_SHIFT = 0.13, 8.0
"""Standard deviations of a contact that is surely wide, or drags: a share of its force for each mm² of width, and so
many times what a shift makes of its place and force.

Balls, flat punches and pairs on a simulated gel were off by 0.04 to 0.13 per mm² (medians), nineteen of twenty dragged
tips by no more than the second in force, and three of four in place (streams of the failure bench, of other seeds than
its page's).
"""

USUAL_MISFIT = 0.16
"""Share of the largest misfit of the training's presses that the median press leaves. What a frame leaves over
beyond it is noise or blur of its picture, and counts against what width and drag explain."""

USUAL_MM2 = 0.015
"""Standard deviation of the width of contacts that are as those of the training.

Half of it and twice as much take less of the error away, on presses at random places that no model was trained with.
"""

SHIFT_INFORMATION = 1.0
"""Granted to a shift, per square of its unit (a pixel): keeps it finite where no region tells of one."""


@dataclass(frozen=True)
class Residual:
    """What a fit leaves of a frame: the mean square over so many components, and what the median press leaves."""

    misfit: float
    usual: float
    count: int

    def noise_without(self, explained: float) -> float:
        """Variance of the frame's noise over that of the training, where so much of the squares is explained."""
        return max(1.0, (self.misfit - explained / self.count) / self.usual)


@dataclass(frozen=True)
class Shape:
    """Of each contact: how much wider it is (mm²), its standard deviation, what x, y and s are another by with a usual
    width, and with a shift; of all together what they gain by a shift: half the fall of the squared misfit."""

    mm2: Float[np.ndarray, ' contacts']
    sigma_mm2: Float[np.ndarray, ' contacts']
    steps: Float[np.ndarray, 'contacts 3']
    by_shift: Float[np.ndarray, 'contacts 3']
    shift_gain: float

    def wide(self, residual: Residual) -> Bool[np.ndarray, ' contacts']:
        """Which contacts are wider than those of the training, in a frame that leaves so much over."""
        sigmas = self.mm2 / self.sigma_mm2
        noise = np.sqrt([residual.noise_without(each**2) for each in sigmas.tolist()])
        which: np.ndarray = (self.mm2 >= WIDE_MM2) & (sigmas >= SURE_OF_WIDTH * noise)
        return which

    def dragged(self, residual: Residual, most_gain: float) -> bool:
        """Whether a shift gains more than it does of the training's presses, in a frame that leaves so much over."""
        return self.shift_gain > most_gain * residual.noise_without(2 * self.shift_gain)


def shape_of(
    response: Response,
    shifts: Float[np.ndarray, 'channels components'],
    components: Float32[np.ndarray, ' components'],
    fit: Fit,
) -> Shape:
    """What fitted contacts are beside tips pressed straight down; `shifts` is what a shift of all regions makes."""
    made = [value_and_slopes(response.axes, response.coefficients, each) for each in fit.contacts.tolist()]
    left = components - sum(each[0] for each in made)
    certainty = response.certainty(float(fit.contacts[:, 2].max()))
    slopes = [np.asarray(each[1:], np.float64) for each in made]
    bends = [laplacian(response.axes, response.coefficients, at) for at in fit.contacts.tolist()]
    found = [_width(*each, left * certainty, certainty) for each in zip(slopes, bends, strict=True)]
    mm2, sigma_mm2, steps = zip(*found, strict=True)
    by_shift, gain = _shifted(fit, np.concatenate(slopes), shifts, left, certainty)
    return Shape(np.array(mm2), np.array(sigma_mm2), np.array(steps), by_shift, gain)


def _width(
    slopes: np.ndarray, bend: np.ndarray, weighted: np.ndarray, certainty: np.ndarray
) -> tuple[float, float, np.ndarray]:
    """One step of least squares by x, y, s and width, from a fit by the first three: of these with a usual width."""
    slopes = np.concatenate([slopes, bend[None]], dtype=np.float64)
    information = (slopes * certainty) @ slopes.T
    information[:3, :3] += damping(1)
    spread = np.linalg.inv(information)
    step = spread @ (slopes @ weighted)
    width, variance = float(step[3]), float(spread[3, 3])
    usual: np.ndarray = step[:3] - spread[:3, 3] * (width / (variance + USUAL_MM2**2))
    return width, math.sqrt(variance), usual


def _shifted(
    fit: Fit, slopes: np.ndarray, shifts: np.ndarray, left: np.ndarray, certainty: np.ndarray
) -> tuple[np.ndarray, float]:
    """Of one step by x, y, s of each contact and a shift beside one without: what it makes of x, y and s, and its gain.

    What contacts explain of it is no gain.
    """
    weighted = shifts * certainty
    shared = np.linalg.solve(fit.information + damping(len(fit.contacts)), slopes @ weighted.T)
    down = weighted @ left - shared.T @ (slopes @ (left * certainty))
    information = weighted @ shifts.T - weighted @ slopes.T @ shared + SHIFT_INFORMATION * np.eye(len(shifts))
    step = np.linalg.solve(information, down)
    return (shared @ step).reshape(-1, 3), float(down @ step) / 2


def in_doubt(fit: Fit, shape: Shape, residual: Residual, most_gain: float) -> Float[np.ndarray, 'contacts 3']:
    """Variances of x, y and s of contacts that are wide or drag, beside those of tips pressed straight down."""
    doubt: np.ndarray = (DOUBT_OF_SHIFT * shape.by_shift * shape.dragged(residual, most_gain)) ** 2
    share = DOUBT_PER_MM2 * shape.mm2 * shape.wide(residual)
    doubt[:, 2] += (share * fit.contacts[:, 2]) ** 2
    return doubt


def with_usual_width(response: Response, fit: Fit, shape: Shape) -> Fit:
    """The fit with each contact where it is with a usual width; one that lies where the splines end stays there."""
    _, largest, low, high = response.limits_array
    moved = np.clip(fit.contacts + np.clip(shape.steps, -largest, largest), low, high)
    return replace(fit, contacts=np.where(at_an_end(response, fit.contacts)[:, None], fit.contacts, moved))
