"""Forces that press and rub: the nearest that can be, and the best of these."""

import numpy as np
import pytest

from tactile_nodes.sensing.explain.field.cone import in_cone, inverse_root, least_squares


def test_forces_come_to_the_nearest_that_can_be() -> None:
    """By hand, friction 1: inside stays; (0, 2) is nearest to (1, 1); a pull is nearest to nothing."""
    normal, shear = in_cone(np.array([2.0, 0.0, -3.0]), np.array([[1.0, 2.0, 1.0], [0.0, 0.0, 0.0]]), 1.0)
    assert normal == pytest.approx([2.0, 1.0, 0.0])
    assert shear[0] == pytest.approx([1.0, 1.0, 0.0])


def test_what_lies_inside_is_the_plain_least_squares_answer() -> None:
    random = np.random.default_rng(1)
    columns = random.standard_normal((40, 6))
    wanted = np.array([2.0, 3.0, 0.3, -0.2, 0.1, 0.4])  # two places: normal, then along x, then along y
    information = columns.T @ columns
    assert least_squares(information, information @ wanted, 1.0) == pytest.approx(wanted, abs=1e-3)


def test_a_pull_and_too_much_shear_are_held_at_the_limit() -> None:
    """With the identity the best is the nearest in the cone."""
    towards = np.array([-1.0, 0.0, 0.0, 2.0, 0.0, 0.0])
    normal, along = least_squares(np.eye(6), towards, 1.0)[[0, 1]], least_squares(np.eye(6), towards, 1.0)[[2, 3]]
    assert normal == pytest.approx([0.0, 1.0], abs=1e-3)
    assert along == pytest.approx([0.0, 1.0], abs=1e-3)


def test_the_root_of_the_inverse_is_told_from_the_lower_half() -> None:
    """Of ((4, 2), (2, 2)), whose factor is ((2, 0), (1, 1)); the upper half is not read."""
    root = inverse_root(np.array([[4.0, 99.0], [2.0, 2.0]]))
    assert root == pytest.approx(np.array([[0.5, 0.0], [-0.5, 1.0]]))
    assert root.T @ root == pytest.approx(np.linalg.inv([[4.0, 2.0], [2.0, 2.0]]))


def test_forces_that_cannot_be_told_apart_are_an_error() -> None:
    with pytest.raises(np.linalg.LinAlgError, match='cannot be separated'):
        inverse_root(np.array([[1.0, 1.0], [1.0, 1.0 - 1e-9]]))
