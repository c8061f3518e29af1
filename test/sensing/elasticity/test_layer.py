"""The layer's displacements in space: a deep half-space under a point, and one axis like the other."""

import numpy as np
import pytest

from tactile_nodes.sensing.elasticity.fields import fields_of
from tactile_nodes.sensing.elasticity.layer import ElasticLayer
from tactile_nodes.sensing.elasticity.stack import Elastic

MODULUS_MPA = 0.111


@pytest.fixture(scope='module')
def kernels() -> np.ndarray:
    layer = ElasticLayer([Elastic(6.0, MODULUS_MPA)], np.array([0.0, 2.0]))
    return layer.kernels(layer.rectangle(1.0, 1.0))


def test_a_force_near_the_surface_is_felt_as_in_a_half_space() -> None:
    """Boussinesq, nu = 1/2, a depth z below the force: u_z = F / (2 pi G z) before the base holds it back."""
    layer = ElasticLayer([Elastic(12.0, MODULUS_MPA)], np.array([1.0]))
    middle = layer.cells[0] // 2
    sinks = -layer.kernels(layer.rectangle(0.25, 0.25))[0, 2, 0, middle, middle]
    half_space = 1 / (2 * np.pi * MODULUS_MPA * 1.0)
    base = 1 / (2 * np.pi * MODULUS_MPA * 12.0)  # what a base at 12 mm takes away, within a factor of two
    assert half_space - 2 * base < sinks < half_space


def test_shear_along_y_is_shear_along_x_turned(kernels: np.ndarray) -> None:
    along_x, along_y = kernels[:, 0, 1], kernels[:, 1, 2]
    assert along_y == pytest.approx(np.swapaxes(along_x, 1, 2), abs=1e-4)


def test_pressing_pushes_aside_and_down_alike_on_both_sides(kernels: np.ndarray) -> None:
    middle, step = kernels.shape[-1] // 2, round(2.0 / 0.25)
    below = kernels[1, :, 0]
    left, right = below[:, middle, middle - step], below[:, middle, middle + step]
    assert below[2, middle, middle] < 0
    assert right[0] > 0.0
    assert left == pytest.approx(right * [-1, 1, 1], abs=1e-4)


def test_slopes_of_a_field_are_its_differences_along_x_and_y() -> None:
    layer = ElasticLayer([Elastic(4.0, 0.1)], np.array([1.0]), (0.5, 0.8), 32.0)
    fields = fields_of(layer, layer.rectangle(1.0, 2.0))
    plain, along_x, along_y = (fields[:, :, :, number] for number in range(3))
    np.testing.assert_allclose(along_x, np.gradient(plain, 0.5, axis=-1), atol=1e-6)
    np.testing.assert_allclose(along_y, np.gradient(plain, 0.8, axis=-2), atol=1e-6)
    assert np.abs(along_x).max() > 0.1
