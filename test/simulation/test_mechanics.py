from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes.simulation.mechanics import ContactTable, Layer, contact_radius_mm, hertz_transform

SHEAR_MPA = 0.155
LAYER = Layer(6.0, SHEAR_MPA, 0.5)


def boussinesq(shear: float, nu: float, radius: np.ndarray, depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Displacement (radial, vertical) of a half-space under a point force of 1 N; Johnson, Contact Mechanics, 3.2."""
    far = np.hypot(radius, depth)
    scale = 1 / (4 * np.pi * shear)
    radial = scale * (radius * depth / far**3 - (1 - 2 * nu) * radius / (far * (far + depth)))
    return radial, -scale * (depth**2 / far**3 + 2 * (1 - nu) / far)


def test_the_base_does_not_move(table: ContactTable):
    assert np.abs(table.radial_mm[:, :, 0]).max() < 1e-12
    assert np.abs(table.vertical_mm[:, :, 0]).max() < 1e-12


@pytest.mark.parametrize('nu', [0.3, 0.5])
def test_far_from_the_tip_a_thick_layer_moves_as_boussinesqs_half_space(nu: float):
    radius, depth = np.array([1.0, 2.0, 4.0]), np.array([4.0, 3.0, 2.0])
    radial, vertical = Layer(3000.0, SHEAR_MPA, nu).displacement_mm(0.3, radius, -depth)
    expected = boussinesq(SHEAR_MPA, nu, radius[:, None], depth[None, :])
    np.testing.assert_allclose(radial, expected[0], rtol=0.02)
    np.testing.assert_allclose(vertical, expected[1], rtol=0.02)


def test_a_thick_layer_sinks_under_the_tip_as_hertz_says():
    contact, e_star = 0.4, 4 * SHEAR_MPA  # E* = 2 G / (1 - nu) with nu = 0.5
    _, vertical = Layer(3000.0, SHEAR_MPA, 0.5).displacement_mm(contact, np.array([0.0]), np.array([0.0]))
    assert -vertical[0, 0] == pytest.approx(3 / (4 * e_star * contact), rel=0.005)  # d = 3 F / (4 E* a)


def divergence(layer: Layer) -> tuple[np.ndarray, np.ndarray]:
    """Volume strain at some points in the gel, and the largest single strain there, by central differences."""
    step = 1e-3
    radius, z = np.array([0.5, 1.0, 3.0, 7.0]), np.array([-5.0, -3.0, -1.5])
    at = {
        (i, j): layer.displacement_mm(0.5, radius + i * step, z + j * step)
        for i, j in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))
    }
    along_r = (at[1, 0][0] - at[-1, 0][0]) / (2 * step)
    around = at[0, 0][0] / radius[:, None]
    along_z = (at[0, 1][1] - at[0, -1][1]) / (2 * step)
    return along_r + around + along_z, np.max(np.abs([along_r, around, along_z]), axis=0)


def test_an_incompressible_gel_keeps_its_volume_everywhere():
    volume, largest = divergence(LAYER)
    assert np.abs(volume / largest).max() < 1e-5


def test_a_compressible_gel_loses_volume_under_the_tip():
    volume, _ = divergence(Layer(6.0, SHEAR_MPA, 0.3))
    assert volume[0, -1] < -1e-3


def test_stress_on_a_plane_in_the_gel_balances_the_force():
    """The normal stress on the plane z = -2 mm, from the displacements, integrates to 1 N.

    Incompressible: the pressure follows from equilibrium, so a nearly incompressible layer is taken instead.
    """
    nu, step = 0.4, 1e-3
    layer = Layer(6.0, SHEAR_MPA, nu)
    radius = np.linspace(0.0, 40.0, 4001)[1:]
    level = np.array([-2.0 - step, -2.0, -2.0 + step])
    radial, vertical = layer.displacement_mm(0.5, radius, level)
    strain_z = (vertical[:, 2] - vertical[:, 0]) / (2 * step)
    strain_r = np.gradient(radial[:, 1], radius)
    volume = strain_r + radial[:, 1] / radius + strain_z
    stress = 2 * SHEAR_MPA * (strain_z + nu / (1 - 2 * nu) * volume)
    force = float((stress * 2 * np.pi * radius).sum() * (radius[1] - radius[0]))
    assert force == pytest.approx(-1.0, rel=0.01)


def test_the_surface_outside_the_contact_is_free_of_shear():
    step = 1e-3
    radius, z = np.array([2.0, 4.0]), np.array([-2 * step, -step, 0.0])
    radial, _ = LAYER.displacement_mm(0.5, radius, z)
    _, ahead = LAYER.displacement_mm(0.5, radius + step, z)
    _, behind = LAYER.displacement_mm(0.5, radius - step, z)
    bend = (3 * radial[:, 2] - 4 * radial[:, 1] + radial[:, 0]) / (2 * step)
    tilt = (ahead[:, 2] - behind[:, 2]) / (2 * step)
    np.testing.assert_allclose(bend + tilt, 0, atol=0.01 * np.abs(tilt).max())


def test_hertz_pressure_of_one_newton_has_a_transform_of_one_at_zero():
    assert hertz_transform(np.array([1e-6, 0.0099, 0.0101])) == pytest.approx([1.0, 1.0, 1.0], abs=1e-4)


def test_the_contact_never_outgrows_the_tip():
    assert contact_radius_mm(0.01, 0.6) == pytest.approx(np.sqrt(0.006), rel=1e-3)  # Hertz
    assert 0.55 < contact_radius_mm(2.0, 0.6) < 0.6


def test_the_papers_depth_of_two_millimetres_takes_about_one_newton(table: ContactTable):
    assert table.force_at(2.0) == pytest.approx(1.0, abs=0.1)


def test_light_touches_follow_hertzs_power_of_three_halves(table: ContactTable):
    assert table.force_n[2] / table.force_n[1] == pytest.approx(2**1.5, rel=0.05)


def test_there_is_no_force_above_the_surface(table: ContactTable):
    assert table.force_at(-0.5) == 0


def test_force_of_a_light_touch_within_the_first_step_is_hertzs(table: ContactTable):
    """Half the first step takes 2^-1.5 of its force, which a straight line would overstate by 41 %."""
    first = float(table.depth_mm[1])
    assert table.force_at(first / 2) == pytest.approx(table.force_at(first) / 2**1.5, rel=0.03)


def test_depth_and_force_are_each_others_reverse(table: ContactTable):
    for depth in (0.0, 0.02, 0.3, 1.234, 2.5):
        assert table.depth_at(table.force_at(depth)) == pytest.approx(depth, abs=1e-9)


def test_displacement_between_tabulated_depths_grows_as_the_force(table: ContactTable):
    depth = float(table.depth_mm[3] + table.depth_mm[4]) / 2
    part = (table.force_at(depth) - table.force_n[3]) / (table.force_n[4] - table.force_n[3])
    radial, vertical = table.displacement_at(depth)
    np.testing.assert_allclose(radial, table.radial_mm[3] + part * np.diff(table.radial_mm[3:5], axis=0)[0], atol=1e-6)
    np.testing.assert_allclose(
        vertical, table.vertical_mm[3] + part * np.diff(table.vertical_mm[3:5], axis=0)[0], atol=1e-6
    )
