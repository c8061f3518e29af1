"""How well a press can be known from one picture at all: what noise leaves to a method that knows everything else.

The Cramér-Rao bound. Let place and depth be the only unknowns, and the light that every place and depth makes in every
pixel be known without error. Each pixel with its noise then tells so much of the three, and no unbiased method has a
variance below the inverse of what they tell together. Whatever a method does not know (the gel's response, the light,
where the camera is) makes it worse than that.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from jaxtyping import Float

from benchmarks.flow.cases import seen_by
from benchmarks.stability.stream import DURING, HELD, Change, Moment, Plan, View, World, random_presses
from tactile_nodes.simulation.mechanics import ContactTable
from tactile_nodes.simulation.optics import Press

STEP_MM = 0.02
"""For slopes by differences: light changes in proportion to steps of this size."""


def floor_n(world: World, change: Change, plan: Plan) -> float:
    """The least standard deviation of force from one picture under a disturbance, in N: root mean square over the
    presses of a stream. The rest image has its noise, too."""
    view = world.under(change)
    variances = [_variance(view, press, world.tables['tip'], plan.capture) for (press,) in random_presses(plan)]
    return math.sqrt(math.fsum(variances) / len(variances))


def least_ratio(undisturbed_n: float, undisturbed_floor_n: float, disturbed_floor_n: float) -> float:
    """How much worse a method gets at least whose other errors stay as they are, of uncorrelated parts."""
    other = max(undisturbed_n**2 - undisturbed_floor_n**2, 0.0)
    return math.sqrt(other + disturbed_floor_n**2) / undisturbed_n


def _variance(view: View, press: Press, table: ContactTable, rest_frames: int) -> float:
    here, slopes = _light(view, press), _slopes(view, press)
    noise = seen_by(view.variance(_moment(press), here)).reshape(-1).astype(float) * (1 + 1 / rest_frames)
    return bound(slopes, noise) * _stiffness(press, table) ** 2


def bound(slopes: Float[np.ndarray, 'pixels unknowns'], noise: Float[np.ndarray, ' pixels']) -> float:
    """The least variance of the last unknown, with the others unknown, too; `noise` are the pixels' variances."""
    information = (slopes / noise[:, None]).T @ slopes
    return float(np.linalg.inv(information)[-1, -1])


def _slopes(view: View, press: Press) -> Float[np.ndarray, 'pixels 3']:
    """Of light along x, y and depth, in grey levels per mm."""
    return np.stack([_difference(view, press, name) for name in ('x_mm', 'y_mm', 'depth_mm')], axis=-1)


def _difference(view: View, press: Press, name: str) -> Float[np.ndarray, ' pixels']:
    there, back = (
        _light(view, dataclasses.replace(press, **{name: getattr(press, name) + step})) for step in (STEP_MM, -STEP_MM)
    )
    slope: np.ndarray = seen_by(there.astype(float) - back).reshape(-1) / (2 * STEP_MM)
    return slope


def _stiffness(press: Press, table: ContactTable) -> float:
    """N per mm of depth."""
    return (table.force_at(press.depth_mm + STEP_MM) - table.force_at(press.depth_mm - STEP_MM)) / (2 * STEP_MM)


def _moment(press: Press) -> Moment:
    return Moment(0, DURING, HELD, (press,), 0)


def _light(view: View, press: Press) -> np.ndarray:
    return view.light(_moment(press))
