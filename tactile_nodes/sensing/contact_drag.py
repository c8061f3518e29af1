"""A tip that drags the skin sideways: what that adds to the motion, and place and force beside it.

Motion of a drag is antisymmetric, as is what a press makes when it is moved or made harder on one side. So a fit of
place and force alone takes a drag for another place and another force. Training measures, beside its presses, what a
drag adds: so much for each mm along x and along y, and for the squares and the product of both, as motion of regions is
not quite in proportion to that of the skin. All five are smooth functions of place and force.

Each contact that was found alone is asked: how much more probable does a drag make what is seen? Where it is more than
all but one of a thousand presses straight down are made, place, force, width (see `contact_width`) and drag are found
together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Float16, Float32

from tactile_nodes.sensing.contact_width import SURE_OF_WIDTH, USUAL_MM2, WIDE_MM2
from tactile_nodes.sensing.reading import Contact
from tactile_nodes.sensing.response import CONVERGED_MM, DAMPING, MOST_STEPS, Fit, Response, damping
from tactile_nodes.sensing.splines import SplineAxis, laplacian, value_and_slopes, value_of

AMOUNTS = 5
LARGEST_PULL_MM = 0.5
"""Of one step, along x and along y."""
USUAL_PULL_MM = 1.0
"""Standard deviation of drags: so wide that it only keeps those finite which nothing tells."""
ASTRAY = 10.0
"""Times as much as presses leave over (mean square): from there on a fit is not near enough to tell a width by.

Balls and punches leave less, drags of a millimetre much more.
"""

ANY_WIDTH_MM2 = 1.5
"""Standard deviation of widths while a drag is asked for: what a wider body adds is none."""
GRANTED = (*DAMPING, USUAL_MM2**-2, USUAL_PULL_MM**-2, USUAL_PULL_MM**-2)
"""Information that a step by x, y, s, width and drag is granted."""

ASKED = (*DAMPING, ANY_WIDTH_MM2**-2, USUAL_PULL_MM**-2, USUAL_PULL_MM**-2)
"""The same while a drag is asked for."""


@dataclass(frozen=True)
class Drag:
    """What the five `amounts` of a drag add to the components of a response, over x, y and s.

    `least_gain` is what one of a thousand presses without a drag gains by one. `most_mm` is the longest of the
    training, and for each mm the force is off by `doubt_n`, as a standard deviation.
    """

    x: SplineAxis
    y: SplineAxis
    s: SplineAxis
    coefficients: Float16[np.ndarray, 'nx ny ns amounts components']
    least_gain: float
    most_mm: float
    doubt_n: float

    @property
    def axes(self) -> tuple[SplineAxis, SplineAxis, SplineAxis]:
        return self.x, self.y, self.s

    @cached_property
    def table(self) -> Float32[np.ndarray, 'nx ny ns outputs']:
        """The coefficients of all amounts side by side."""
        return np.ascontiguousarray(self.coefficients.reshape(*self.coefficients.shape[:3], -1), np.float32)

    @cached_property
    def straight_table(self) -> Float32[np.ndarray, 'nx ny ns outputs']:
        """Those of a short drag along x and along y."""
        first = self.coefficients[:, :, :, :2]
        return np.ascontiguousarray(first.reshape(*first.shape[:3], -1), np.float32)

    @cached_property
    def for_loops(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Axes, coefficients and numbers."""
        axes = np.array([[axis.low, axis.high, axis.intervals] for axis in self.axes], float)
        how = LARGEST_PULL_MM, MOST_STEPS, WIDE_MM2, SURE_OF_WIDTH, *GRANTED, *ASKED
        return axes, self.table, np.array([self.least_gain, self.most_mm, self.doubt_n, *how], float)


NO_DRAG = np.zeros((3, 3)), np.zeros((0, 0, 0, 0), np.float32), np.array([np.inf, *(0.0,) * (6 + 2 * len(GRANTED))])
"""As `Drag.for_loops` where none was measured."""


@dataclass(frozen=True)
class Dragged:
    """One contact as a fit, and how far along x and y it dragged the skin."""

    fit: Fit
    pull_mm: Float[np.ndarray, ' 2']

    @property
    def length_mm(self) -> float:
        return float(np.hypot(*self.pull_mm))

    def moved(self, contact: Contact) -> Contact:
        """Where the tip is now: the fit's place is that of the skin which it took along, with the gel at rest."""
        x_mm, y_mm = (float(each) for each in self.pull_mm)
        return replace(contact, x_mm=contact.x_mm + x_mm, y_mm=contact.y_mm + y_mm)


def amounts(pull_mm: Float[np.ndarray, ' 2']) -> Float[np.ndarray, ' amounts']:
    """Along x and y; what of the squares turns twice as fast as the drag (two); what does not turn."""
    x, y = pull_mm.tolist()
    return np.array([x, y, x * x - y * y, 2 * x * y, x * x + y * y])


def amounts_slopes(pull_mm: Float[np.ndarray, ' 2']) -> Float[np.ndarray, '2 amounts']:
    """Their slopes along x and y."""
    x, y = pull_mm.tolist()
    return np.array([[1, 0, 2 * x, 2 * y, 2 * x], [0, 1, -2 * y, 2 * x, 2 * y]])


def dragged(
    response: Response,
    drag: Drag,
    components: Float32[np.ndarray, ' components'],
    fit: Fit,
    misfit_limit: float = np.inf,
) -> Dragged | None:
    """A fit of one contact with its drag; None where it may well be one that was pressed straight down.

    Beyond `misfit_limit` a fit is not near enough to tell a width by.
    """
    if gained_by_drag(response, drag, components, fit, misfit_limit) < drag.least_gain:
        return None
    _, largest, low, high = response.limits_array
    here, best, least = np.array([*fit.contacts[0], 0.0, 0.0, 0.0]), None, np.inf
    for _ in range(MOST_STEPS):
        made, information, down = _compare(response, drag, components, here)
        step = np.linalg.solve(information, down)
        misfit, cost = made
        if cost < least:
            least, best = cost, (here, information, misfit)
        moved = here.copy()
        moved[:3] = np.clip(here[:3] + np.clip(step[:3], -largest, largest), low, high)
        moved[3] += step[3]
        moved[4:] += np.clip(step[4:], -LARGEST_PULL_MM, LARGEST_PULL_MM)
        if np.abs(np.delete(moved - here, 3)).max() < CONVERGED_MM:
            break
        here = moved
    assert best is not None
    at, information, misfit = best
    known = np.linalg.inv(np.linalg.inv(information)[:3, :3]) - damping(1)
    return Dragged(Fit(at[None, :3], known, misfit), at[4:])


def gained_by_drag(
    response: Response,
    drag: Drag,
    components: Float32[np.ndarray, ' components'],
    fit: Fit,
    misfit_limit: float = np.inf,
) -> float:
    """How much more probable one step by place, force and a drag makes what is seen than one without, of any width.

    Half the fall of the squared misfit. Of a body of another shape the response to the tip is off all around it, so a
    wide contact's gain counts less, unless the fit leaves more than `misfit_limit` over (mean square).
    """
    place = fit.contacts[0].tolist()
    made = value_and_slopes(response.axes, response.coefficients, place)
    bend = laplacian(response.axes, response.coefficients, place)
    short = value_of(drag.axes, drag.straight_table, place).reshape(2, -1)
    slopes = np.concatenate([made[1:], bend[None], short], dtype=np.float64)
    weighted = slopes * response.certainty(place[2])
    down, information = weighted @ (components - made[0]), weighted @ slopes.T + np.diag(ASKED)
    spread = np.linalg.inv(information)
    with_it, without = spread @ down, np.linalg.solve(information[:4, :4], down[:4])
    gain = float(down @ with_it - down[:4] @ without) / 2
    if fit.misfit > misfit_limit:
        return gain
    wide = max(abs(float(with_it[3])) - SURE_OF_WIDTH * math.sqrt(spread[3, 3]), 0.0) / WIDE_MM2
    return gain / (1 + wide**2)


def _compare(
    response: Response, drag: Drag, components: np.ndarray, here: Float[np.ndarray, ' 6']
) -> tuple[tuple[float, float], Float[np.ndarray, '6 6'], Float[np.ndarray, ' 6']]:
    """Misfit (mean square) and cost of x, y, s, width and drag, with granted information, and the way down."""
    place, width, pull_mm = here[:3].tolist(), here[3], here[4:]
    made = value_and_slopes(response.axes, response.coefficients, place)
    bend = laplacian(response.axes, response.coefficients, place)
    parts = value_and_slopes(drag.axes, drag.table, place).reshape(4, AMOUNTS, -1)
    by_place = made + np.einsum('a,pac->pc', amounts(pull_mm), parts)
    slopes = np.concatenate([by_place[1:], bend[None], amounts_slopes(pull_mm) @ parts[0]], dtype=np.float64)
    left = components - by_place[0] - width * bend
    certainty = response.certainty(place[2])
    weighted, granted = slopes * certainty, np.array(GRANTED)
    beside = granted[3:] * here[3:]
    down = weighted @ left
    down[3:] -= beside
    squares = float(left * left @ certainty)
    return (squares / len(components), squares + float(beside @ here[3:])), weighted @ slopes.T + np.diag(granted), down
