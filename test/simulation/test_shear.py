from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes.simulation.mechanics import ContactTable, Layer
from tactile_nodes.simulation.shear import ShearTable, shear_per_newton, solve_shear

THICK = Layer(3000.0, 1.0, 0.5)


@pytest.fixture(scope='module')
def dragged(table: ContactTable) -> ShearTable:
    return solve_shear(Layer(6.0, 0.155, 0.5), table, steps=3)


def test_a_disc_on_a_thick_layer_is_as_stiff_sideways_as_mindlins():
    even, _, _ = shear_per_newton(THICK, 0.3, np.array([0.0]), np.array([0.0]))
    assert 1 / even[0, 0] == pytest.approx(8 * 0.3 / 1.5, rel=0.02)  # 8 G a / (2 - nu)


def test_far_from_a_drag_a_thick_layer_moves_as_cerrutis_half_space():
    """Johnson, Contact Mechanics, 3.6, at x = 3, z = 2 below, nu = 1/2."""
    even, twin, lift = shear_per_newton(THICK, 0.3, np.array([3.0]), np.array([-2.0]))
    far = np.hypot(3.0, 2.0)
    assert even[0, 0] + twin[0, 0] == pytest.approx((1 / far + 9 / far**3) / (4 * np.pi), rel=0.01)
    assert even[0, 0] - twin[0, 0] == pytest.approx(1 / far / (4 * np.pi), rel=0.01)  # abreast of the drag
    assert lift[0, 0] == pytest.approx(-6 / far**3 / (4 * np.pi), rel=0.01)  # ahead of it the gel sinks


def test_the_base_does_not_shear(dragged: ShearTable):
    assert np.abs(dragged.fields[:, :, 0]).max() < 1e-6


def test_the_contact_itself_moves_by_the_shift(dragged: ShearTable):
    moved = dragged.displacement_mm(0.5, np.array([[0.0, 0.0, 0.0]], np.float32), (0.3, 0.1))
    np.testing.assert_allclose(moved, [[0.3, 0.1, 0.0]], atol=1e-5)


def test_a_drag_upwards_is_a_drag_rightwards_turned(dragged: ShearTable):
    right = dragged.displacement_mm(0.5, np.array([[2.0, 1.0, -2.0]], np.float32), (0.2, 0.0))[0]
    up = dragged.displacement_mm(0.5, np.array([[1.0, -2.0, -2.0]], np.float32), (0.0, -0.2))[0]
    np.testing.assert_allclose(up, [right[1], -right[0], right[2]], atol=1e-6)


def test_the_drag_grows_with_the_contact_and_the_shift(dragged: ShearTable):
    assert dragged.force_n(0.0, (1.0, 0.0)) == (0.0, 0.0)
    assert dragged.force_n(0.3, (0.2, 0.0))[0] < dragged.force_n(0.5, (0.2, 0.0))[0]
    assert dragged.force_n(0.5, (0.2, -0.1))[1] == pytest.approx(-dragged.force_n(0.5, (0.2, -0.1))[0] / 2)
