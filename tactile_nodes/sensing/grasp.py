"""Forces of several surfaces in one frame, and how near a contact is to slipping."""

from __future__ import annotations

import math

import numpy as np

from tactile_nodes.shapes import Float


def wrench_mover(b_from_a: Float[np.ndarray, '4 4']) -> Float[np.ndarray, '6 6']:
    """The matrix for `moved_wrench` from frame a to frame b.

    The torque gains p x F, p the origin of a in b: 1 N along y at p = (1, 0, 0) m is 1 N m about z.
    """
    turned, place = b_from_a[:3, :3], b_from_a[:3, 3]
    x, y, z = place
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.block([[turned, np.zeros((3, 3))], [across @ turned, turned]])


def moved_wrench(
    mover: Float[np.ndarray, '6 6'], wrench: Float[np.ndarray, ' 6'], covariance: Float[np.ndarray, '6 6']
) -> tuple[Float[np.ndarray, ' 6'], Float[np.ndarray, '6 6']]:
    """A wrench (force [N], then torque about a's origin [N m]) and its covariance, in frame b and about its origin."""
    return mover @ wrench, mover @ covariance @ mover.T


def grasp_margin(
    normal_n: float, normal_sigma_n: float, shear_n: float, shear_sigma_n: float, friction: float
) -> tuple[float, float]:
    """How much of the greatest friction is left, 1 - shear / (friction normal), and its standard deviation.

    1: no shear; 0: at the limit. 0.4 N of shear under 1 N with a friction of 0.8 leave 0.5. NaN where nothing presses
    or no friction is given.
    """
    if not (normal_n > 0 and friction > 0):
        return math.nan, math.nan
    used = shear_n / (friction * normal_n)
    return 1.0 - used, math.hypot(shear_sigma_n / (friction * normal_n), used * normal_sigma_n / normal_n)
