"""The lower bound of the force error from one picture: the effect of noise on a method that knows everything else.

This is the Cramér-Rao bound. Only x, y and depth are unknown; the light in every pixel for every place and depth is
known without error. Each pixel, with its noise, gives information about the three unknowns. No unbiased method has a
variance below the inverse of the total information. Everything that a real method does not know (the gel's response,
the light, the camera's pose) increases its variance.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from benchmarks.flow.cases import seen_by
from benchmarks.stability.stream import DURING, HELD, Change, Moment, Plan, View, World, random_presses
from tactile_nodes.shapes import Float
from tactile_nodes.simulation.mechanics import ContactTable
from tactile_nodes.simulation.optics import Press

STEP_MM = 0.02
"""Step for numerical derivatives; the light is linear over steps of this size."""


def floor_n(world: World, change: Change, plan: Plan) -> float:
    """The least standard deviation of the force from one picture under a disturbance [N]: root mean square over the
    presses of a stream. The rest image has noise, too."""
    view = world.under(change)
    variances = [_variance(view, press, world.tables['tip'], plan.capture) for (press,) in random_presses(plan)]
    return math.sqrt(math.fsum(variances) / len(variances))


def least_ratio(undisturbed_n: float, undisturbed_floor_n: float, disturbed_floor_n: float) -> float:
    """The least ratio of a method's error to the undisturbed one, if its other, uncorrelated errors stay the same."""
    other = max(undisturbed_n**2 - undisturbed_floor_n**2, 0.0)
    return math.sqrt(other + disturbed_floor_n**2) / undisturbed_n


def _variance(view: View, press: Press, table: ContactTable, rest_frames: int) -> float:
    here, slopes = _light(view, press), _slopes(view, press)
    noise = seen_by(view.variance(_moment(press), here)).reshape(-1).astype(float) * (1 + 1 / rest_frames)
    return bound(slopes, noise) * _stiffness(press, table) ** 2


def bound(slopes: Float[np.ndarray, 'pixels unknowns'], noise: Float[np.ndarray, ' pixels']) -> float:
    """The least variance of the last unknown, with the others also unknown; `noise` are the variances of the pixels."""
    information = (slopes / noise[:, None]).T @ slopes
    return float(np.linalg.inv(information)[-1, -1])


def _slopes(view: View, press: Press) -> Float[np.ndarray, 'pixels 3']:
    """The derivatives of the light along x, y and depth, in grey levels per mm."""
    return np.stack([_difference(view, press, name) for name in ('x_mm', 'y_mm', 'depth_mm')], axis=-1)


def _difference(view: View, press: Press, name: str) -> Float[np.ndarray, ' pixels']:
    there, back = (
        _light(view, dataclasses.replace(press, **{name: getattr(press, name) + step})) for step in (STEP_MM, -STEP_MM)
    )
    slope: np.ndarray = seen_by(there.astype(float) - back).reshape(-1) / (2 * STEP_MM)
    return slope


def _stiffness(press: Press, table: ContactTable) -> float:
    """Stiffness in N per mm of depth."""
    return (table.force_at(press.depth_mm + STEP_MM) - table.force_at(press.depth_mm - STEP_MM)) / (2 * STEP_MM)


def _moment(press: Press) -> Moment:
    return Moment(0, DURING, HELD, (press,), 0)


def _light(view: View, press: Press) -> np.ndarray:
    return view.light(_moment(press))
