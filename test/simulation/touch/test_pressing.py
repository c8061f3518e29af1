"""Contact against theory: Hertz, the flat punch, Cattaneo and Mindlin, full slip, torsion, and an independent solution.

Forces are over the shear modulus. The layers are thick beside the contact, but not endless: see each tolerance.
"""

from __future__ import annotations

import re

import numpy as np
import pytest

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.simulation.touch.body import Body, grid
from tactile_nodes.simulation.touch.bricks import Bricks, Layer
from tactile_nodes.simulation.touch.families import ball, make_body, rounded
from tactile_nodes.simulation.touch.pressing import Pose, Pressing

MODULUS = 4.0
"""Plane strain modulus E / (1 - nu²) over the shear modulus, of an incompressible body."""


@pytest.fixture(scope='module')
def thick() -> Bricks:
    return Bricks(Layer(cells=48, spacing_mm=0.65, thickness_mm=16.0, rows=6, growth=1.5))


@pytest.fixture(scope='module')
def sphere() -> Body:
    return Body.of_heights('sphere', ball(8.0, *grid(7.0)))


def test_a_sphere_presses_as_hertz_says_and_dragged_slips_from_its_rim_as_mindlin_says(thick: Bricks, sphere: Body):
    """On a layer Hertz's force is larger by 1 + 1.13 a/H + 1.28 (a/H)² (Dimitriadis et al., Biophys. J. 82, 2002).

    d = 3 (2 - nu) mu P / (16 G a) (1 - (1 - Q / mu P)^(2/3)), and all of it slips at Q = mu P.
    """
    friction = 0.3
    pressing = Pressing(thick, sphere, friction)
    for force in (2.0, 8.0):
        stands = pressing.advance(Pose(), force)
        radius_mm = np.sqrt(8.0 * stands.depth_mm)
        share = radius_mm / 16.0
        hertz = 4 / 3 * MODULUS * np.sqrt(8.0) * stands.depth_mm**1.5
        assert force == pytest.approx(hertz * (1 + 1.133 * share + 1.283 * share**2), rel=0.05)
        assert stands.normal == pytest.approx(force, rel=2e-3)
    for drag_mm in (0.1, 0.2):
        stands = pressing.advance(Pose(drag_mm), force)
        share = float(stands.force[0].sum()) / (friction * force)
        theory_mm = 3 * 1.5 * friction * force / (16 * radius_mm) * (1 - (1 - share) ** (2 / 3))
        assert drag_mm == pytest.approx(theory_mm, rel=0.15)  # a layer of eight radii is a little stiffer
        slipping = stands.slips.sum() / (stands.force[2] < 0).sum()
        assert slipping == pytest.approx(1 - (1 - share) ** (2 / 3), abs=0.15)
    stands = pressing.advance(Pose(1.0), force)
    assert float(stands.force[0].sum()) == pytest.approx(friction * force, rel=0.05)  # on sides that lean


def test_a_flat_punch_presses_and_twists_as_theory_says(thick: Bricks):
    """F = 2 a E* d and M = 16/3 G a³ angle; with a rounded edge the radius is between that of flat part and body."""
    body = Body.of_heights('punch', rounded(np.hypot(*grid(4.0)) - 1.75, 0.25))
    pressing = Pressing(thick, body, friction=5.0)
    stands = pressing.advance(Pose(), 4.0)
    stiffness = 4.0 / stands.depth_mm
    assert 2 * 1.75 * MODULUS < stiffness < 1.15 * 2 * 2.0 * MODULUS
    turned = pressing.advance(Pose(turn_rad=0.05), 4.0)
    x, y = np.meshgrid(thick.layer.line_mm, thick.layer.line_mm)
    torsion = float((x * turned.force[1] - y * turned.force[0]).sum())
    assert 16 / 3 * 1.7**3 * 0.05 < torsion < 16 / 3 * 2.0**3 * 0.05


def test_contact_forces_press_and_stay_within_the_cone():
    bricks = Bricks(Layer(cells=32, spacing_mm=0.75, rows=5))
    pressing = Pressing(bricks, make_body('ball'), friction=0.4)
    pressing.advance(Pose(), 6.0)
    force = pressing.advance(Pose(0.5, 0.3), 6.0).force
    touching = force[2] < 0
    flat = np.hypot(force[0], force[1])[touching] / -force[2][touching]
    # Where the body's side leans by 0.45, a force at the limit of friction leans by up to (0.45 + 0.4) / (1 - 0.18).
    assert flat.max() < 1.05
    assert (force[:, ~touching] == 0).all()


def test_large_strain_agrees_with_an_axisymmetric_solution_of_its_own(ball_5_mm: tuple[np.ndarray, np.ndarray]):
    """Depths at which a sphere of 5 mm takes forces on the layer of 6 mm, from rings of nine-node elements."""
    force_mm2, depth_mm = ball_5_mm
    bricks = Bricks(Layer(cells=40, spacing_mm=0.8, rows=6))
    pressing = Pressing(bricks, Body.of_heights('sphere', ball(5.0, *grid(8.0))), friction=10.0)
    for force, depth in zip(force_mm2, depth_mm, strict=True):
        assert pressing.advance(Pose(), float(force)).depth_mm == pytest.approx(depth, rel=0.04)


def test_a_finer_mesh_changes_little():
    found = []
    for cells, rows in ((28, 5), (40, 6)):
        bricks = Bricks(Layer(cells=cells, spacing_mm=28.0 / cells, rows=rows))
        stands = Pressing(bricks, make_body('ball')).advance(Pose(), 9.0)
        sinks = np.abs(stands.state.moved[:, 2]).max(axis=(1, 2))
        found.append((stands.depth_mm, float(np.interp(-2.0, bricks.layer.z_mm, sinks))))
    (coarse_mm, coarse), (fine_mm, fine) = found
    assert coarse_mm == pytest.approx(fine_mm, rel=0.02)
    assert coarse == pytest.approx(fine, rel=0.05)


def test_a_body_wider_than_the_gel_is_refused():
    bricks = Bricks(Layer(cells=24, spacing_mm=0.5, rows=4))
    with pytest.raises(ConfigurationError, match=r'reaches 10\.0 mm from its middle, but the gel ends at 6\.0 mm'):
        Pressing(bricks, make_body('edge'))


def test_what_no_gel_bears_is_refused_in_a_sentence():
    bricks = Bricks(Layer(cells=32, spacing_mm=0.5, rows=5))
    said = []
    for modulus_mpa in (0.1, 0.2):
        with pytest.raises(ConfigurationError, match=r'no equilibrium .* at [\d.]+ N; press, drag and') as refused:
            Pressing(bricks, make_body('punch'), shear_modulus_mpa=modulus_mpa).advance(Pose(), 400.0)
        said.append(float(re.findall(r'at ([\d.]+) N', str(refused.value))[0]))
    assert said[1] == pytest.approx(2 * said[0], abs=0.02)  # twice as stiff, it bears twice as much
    assert said[0] <= 40


def test_pressed_to_a_depth_it_takes_the_force_that_leads_there():
    bricks = Bricks(Layer(cells=28, spacing_mm=0.9, rows=5))
    by_force = Pressing(bricks, make_body('ball')).advance(Pose(), 3.0)
    by_depth = Pressing(bricks, make_body('ball')).advance(Pose(), depth_mm=by_force.depth_mm)
    assert by_depth.normal == pytest.approx(3.0, rel=0.01)
