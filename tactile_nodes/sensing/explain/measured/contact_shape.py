"""Checks from the residual of a fit whether a contact is a tip as in training, pressed straight down.

A wider contact acts as many tips side by side, and motions add up. To second order it adds the Laplacian of the
response along x and y, times half the mean square of the distances. So no other body needs to be known. A ball or a
flat punch has a large width, and so have two close contacts that were fitted as one. Every contact has a small width,
since splines and regions mostly miss the sharpness of the peak. So place and force come from a fit that includes a
width, with a prior from the training.

A press moves its surroundings towards it or away from it, so that another place or force hardly shifts the whole image.
A tip that drags the skin does shift it. So the gain in likelihood from a common shift of all regions, along x and along
y, is computed.

Neither is corrected, since only a part of the effect of another body or a drag has this form. Both increase the stated
uncertainty.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tactile_nodes.sensing.explain.measured.response import Fit, Response, at_an_end, damping
from tactile_nodes.sensing.explain.splines import laplacian, value_and_slopes
from tactile_nodes.shapes import Bool, Float, Float32

WIDE_MM2 = 0.1
"""Width beyond which a contact is wider than those of the training, as for a uniform pressure over 1.8 mm.

The tip's own presses stay below it, except for a few of the hardest. A flat punch of 3 mm and a ball of 6 mm exceed it
from 0.1 and 0.15 N on.
"""

SURE_OF_WIDTH = 3.1
"""Standard deviations by which the width must exceed zero; noise does so for one in a thousand."""

DOUBT_PER_MM2, DOUBT_OF_SHIFT = 0.13, 8.0
"""Standard deviations of a contact that is wide or drags: a share of its force per mm² of width, and this many times
the change of its place and force through a shift.

Balls, flat punches and pairs on a simulated gel were off by 0.04 to 0.13 per mm² (medians), nineteen of twenty dragged
tips by no more than the second in force, and three of four in place (streams of the failure bench, of other seeds than
its page's).
"""

USUAL_MISFIT = 0.16
"""Misfit of the median press of the training, over the largest one. A larger residual of a frame is noise or blur of
its image, and reduces the significance of width and drag."""

USUAL_MM2 = 0.015
"""Standard deviation of the width of contacts as in training (the prior of the width).

Half and twice the value reduce the error less, on presses at random places that no model was trained on.
"""

SHIFT_INFORMATION = 1.0
"""Prior information on a shift [1/px²]: keeps it finite if no region contributes."""


@dataclass(frozen=True)
class Residual:
    """Residual of a fit: the mean square over a number of components, and that of the median press."""

    misfit: float
    usual: float
    count: int

    def noise_without(self, explained: float) -> float:
        """Variance of the frame's noise over that of the training, after `explained` of the squares is removed."""
        return max(1.0, (self.misfit - explained / self.count) / self.usual)


@dataclass(frozen=True)
class Shape:
    """For each contact: excess width [mm²], its standard deviation, and the changes of x, y and s with the prior width
    and with a shift. For all together: the gain of a shift, half the decrease of the squared misfit."""

    mm2: Float[np.ndarray, ' contacts']
    sigma_mm2: Float[np.ndarray, ' contacts']
    steps: Float[np.ndarray, 'contacts 3']
    by_shift: Float[np.ndarray, 'contacts 3']
    shift_gain: float

    def wide(self, residual: Residual) -> Bool[np.ndarray, ' contacts']:
        """Which contacts are wider than those of the training, given the residual of the frame."""
        sigmas = self.mm2 / self.sigma_mm2
        noise = np.sqrt([residual.noise_without(each**2) for each in sigmas.tolist()])
        which: np.ndarray = (self.mm2 >= WIDE_MM2) & (sigmas >= SURE_OF_WIDTH * noise)
        return which

    def dragged(self, residual: Residual, most_gain: float) -> bool:
        """Whether a shift gains more than for presses of the training, given the residual of the frame."""
        return self.shift_gain > most_gain * residual.noise_without(2 * self.shift_gain)


def shape_of(
    response: Response,
    shifts: Float[np.ndarray, 'channels components'],
    components: Float32[np.ndarray, ' components'],
    fit: Fit,
) -> Shape:
    """Width and shift of fitted contacts; `shifts` are the components of a shift of all regions."""
    modelled = [value_and_slopes(response.axes, response.coefficients, each) for each in fit.contacts.tolist()]
    left = components - sum(each[0] for each in modelled)
    certainty = response.certainty(float(fit.contacts[:, 2].max()))
    slopes = [np.asarray(each[1:], np.float64) for each in modelled]
    bends = [laplacian(response.axes, response.coefficients, at) for at in fit.contacts.tolist()]
    found = [_width(*each, left * certainty, certainty) for each in zip(slopes, bends, strict=True)]
    mm2, sigma_mm2, steps = zip(*found, strict=True)
    by_shift, gain = _shifted(fit, np.concatenate(slopes), shifts, left, certainty)
    return Shape(np.array(mm2), np.array(sigma_mm2), np.array(steps), by_shift, gain)


def _width(
    slopes: np.ndarray, bend: np.ndarray, weighted: np.ndarray, certainty: np.ndarray
) -> tuple[float, float, np.ndarray]:
    """One least-squares step in x, y, s and width from a fit of x, y and s, with the prior of the width."""
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
    """Change of x, y and s, and gain, of one step with a common shift compared with one without.

    The part that contacts explain does not count as gain.
    """
    weighted = shifts * certainty
    shared = np.linalg.solve(fit.information + damping(len(fit.contacts)), slopes @ weighted.T)
    descent = weighted @ left - shared.T @ (slopes @ (left * certainty))
    information = weighted @ shifts.T - weighted @ slopes.T @ shared + SHIFT_INFORMATION * np.eye(len(shifts))
    step = np.linalg.solve(information, descent)
    return (shared @ step).reshape(-1, 3), float(descent @ step) / 2


def in_doubt(fit: Fit, shape: Shape, residual: Residual, most_gain: float) -> Float[np.ndarray, 'contacts 3']:
    """Additional variances of x, y and s of contacts that are wide or drag."""
    doubt: np.ndarray = (DOUBT_OF_SHIFT * shape.by_shift * shape.dragged(residual, most_gain)) ** 2
    share = DOUBT_PER_MM2 * shape.mm2 * shape.wide(residual)
    doubt[:, 2] += (share * fit.contacts[:, 2]) ** 2
    return doubt


def with_usual_width(response: Response, fit: Fit, shape: Shape) -> Fit:
    """The fit with the contacts shifted as for the prior width; contacts at the ends of the splines stay there."""
    _, largest, low, high = response.limits_array
    moved = np.clip(fit.contacts + np.clip(shape.steps, -largest, largest), low, high)
    return replace(fit, contacts=np.where(at_an_end(response, fit.contacts)[:, None], fit.contacts, moved))
