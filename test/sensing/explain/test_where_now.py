"""Forces are reported where the surface is that carries them."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes.sensing.elasticity.patches import PatchGrid
from tactile_nodes.sensing.elasticity.regions import Regions
from tactile_nodes.sensing.explain.field.where_now import moved_along
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.sensors import load_sensor

BINS = BinGrid(4, 4, 16.0, 16.0)  # patches of 2 mm
PATCHES = PatchGrid(BINS)
YIELDING = np.full((2, 1, 1), 0.5, np.float32)
"""0.5 mm for 1 N on a patch, and nothing around it."""


def on_one(place: int, pressed: float, along_x: float, along_y: float) -> np.ndarray:
    forces = np.zeros((3, PATCHES.count))
    forces[:, place] = pressed, along_x, along_y
    return forces


def test_a_force_is_reported_as_much_further_as_its_shear_takes_the_surface_along():
    """0.45 * 0.5 mm/N * 0.8 N of 2 mm to the right: 9 %; of 0.4 N downwards: 4.5 %."""
    row, col = 3, 2
    moved = moved_along(on_one(8 * row + col, 2.0, 0.8, 0.4), YIELDING, PATCHES).reshape(3, 8, 8)
    expected = 2.0 * np.outer([0.955, 0.045], [0.91, 0.09])
    np.testing.assert_allclose(moved[0, row : row + 2, col : col + 2], expected, rtol=1e-6)
    np.testing.assert_allclose(moved[1:].sum(axis=(1, 2)), [0.8, 0.4], rtol=1e-12)


def test_the_sum_of_all_forces_stays_at_the_rim_too():
    moved = moved_along(on_one(63, 3.0, 2.0, 1.0) + on_one(0, 1.0, -0.8, -0.5), YIELDING, PATCHES)
    np.testing.assert_allclose(moved.sum(axis=1), [4.0, 1.2, 0.5], rtol=1e-12)


def test_without_shear_and_without_a_known_surface_nothing_moves():
    pressed = on_one(20, 2.0, 0.0, 0.0)
    np.testing.assert_array_equal(moved_along(pressed, YIELDING, PATCHES), pressed)
    rubbed = on_one(20, 2.0, 1.0, 0.0)
    np.testing.assert_array_equal(moved_along(rubbed, np.zeros((2, 1, 1), np.float32), PATCHES), rubbed)


def test_a_bonded_layer_yields_to_shear_a_little_less_than_a_half_space():
    """Cerruti (Johnson, Contact Mechanics, 3.6), nu = 1/2: (1 + x²/r²) / (4 pi G r), from the middle of a patch."""
    sensor = load_sensor('simulated')
    surface = Regions(sensor, 20, 20).surface_under_shear
    step, modulus_mpa = 32.0 / 18, sensor.gel.moduli_mpa[0]
    ahead, aside = 2 / (4 * np.pi * modulus_mpa * step), 1 / (4 * np.pi * modulus_mpa * step)
    for number, (along, across) in enumerate([((2, 3), (3, 2)), ((3, 2), (2, 3))]):
        assert 0.75 * ahead < surface[number][along] < 0.95 * ahead
        assert 0.75 * aside < surface[number][across] < 0.95 * aside
    assert surface[0] == pytest.approx(surface[1].T, rel=1e-4)
