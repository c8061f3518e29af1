"""Wrenches in another frame and margins of friction, by hand."""

import math

import numpy as np
import pytest

from tactile_nodes.sensing.grasp import grasp_margin, moved_wrench, wrench_mover
from tactile_nodes.sensors import Mounting


def test_a_force_beside_the_origin_turns_about_it() -> None:
    # 1 N along y at (1, 0, 0) m: 1 N m about z.
    b_from_a = Mounting(position_mm=(1000.0, 0.0, 0.0)).parent_from_surface
    wrench, _ = moved_wrench(wrench_mover(b_from_a), np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0]), np.zeros((6, 6)))
    assert wrench == pytest.approx((0.0, 1.0, 0.0, 0.0, 0.0, 1.0))


def test_a_turned_surface_turns_force_and_torque() -> None:
    # Pitched by 90 degrees, z becomes x and x becomes -z; at (0, 0, 0.1) m a force along x adds 0.1 m times it about y.
    b_from_a = Mounting(position_mm=(0.0, 0.0, 100.0), rpy_deg=(0.0, 90.0, 0.0)).parent_from_surface
    wrench, _ = moved_wrench(wrench_mover(b_from_a), np.array([0.0, 0.0, -2.0, 0.03, 0.0, 0.0]), np.zeros((6, 6)))
    assert wrench == pytest.approx((-2.0, 0.0, 0.0, 0.0, -0.2, -0.03))


def test_an_unsure_force_makes_the_torque_unsure_by_its_lever() -> None:
    # A standard deviation of 0.1 N along y at (0.5, 0, 0) m is one of 0.05 N m about z, and both err together.
    b_from_a = Mounting(position_mm=(500.0, 0.0, 0.0)).parent_from_surface
    _, covariance = moved_wrench(wrench_mover(b_from_a), np.zeros(6), np.diag([0.0, 0.01, 0.0, 0.0, 0.0, 0.0]))
    assert covariance[5, 5] == pytest.approx(0.05**2)
    assert covariance[1, 5] == pytest.approx(0.1 * 0.05)
    assert np.count_nonzero(np.abs(covariance) > 1e-12) == 4


def test_margin_is_what_is_left_of_the_greatest_friction() -> None:
    # 0.4 of 0.8 N are used. 0.08 N of shear are 0.1 of the limit; 10 % of the normal force are 0.05 of what is used.
    margin, sigma = grasp_margin(1.0, 0.1, 0.4, 0.08, 0.8)
    assert margin == pytest.approx(0.5)
    assert sigma == pytest.approx(math.hypot(0.1, 0.05))


@pytest.mark.parametrize(('normal_n', 'friction'), [(0.0, 0.8), (math.nan, 0.8), (1.0, 0.0)])
def test_margin_of_what_does_not_press_or_has_no_friction_given_is_not_known(normal_n: float, friction: float) -> None:
    assert all(map(math.isnan, grasp_margin(normal_n, 0.1, 0.1, 0.1, friction)))
