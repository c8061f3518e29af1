from __future__ import annotations

import copy

import numpy as np
import pytest

from tactile_nodes.simulation.contact import Where
from tactile_nodes.simulation.elements import Mesh, graded
from tactile_nodes.simulation.finite_strain import Indentation
from tactile_nodes.simulation.indenter import PAPER_TIP, Indenter
from tactile_nodes.simulation.mechanics import ContactTable, Layer
from tactile_nodes.simulation.solution import Problem, Solution, solve_problem

COARSE = Problem(finest_mm=0.16, growth=1.2)
SMALL = Indenter(0.2, 0.2)
THICK = Problem(layer_mm=12.0, reach_mm=40.0, finest_mm=0.0125, growth=1.35, indenter=SMALL).mesh()


def nodes(press: Indentation) -> np.ndarray:
    return press.state.u.reshape(*press.body.mesh.nodes, 2)


HALF_MM = 0.3


@pytest.fixture(scope='module')
def on_its_way() -> list[float]:
    """The force over the shear modulus that `deep` took at `HALF_MM`."""
    return []


@pytest.fixture(scope='module')
def deep(on_its_way: list[float]) -> Indentation:
    """The paper's tip 1 mm deep in the paper's layer, on coarse elements."""
    press = Indentation(COARSE.mesh(), PAPER_TIP)
    press.advance(Where(0.0, HALF_MM), 0.05)
    on_its_way.append(press.touch.pushes[1])
    press.advance(Where(0.0, 1.0), 0.1)
    return press


@pytest.fixture(scope='module')
def sliding() -> tuple[float, float]:
    """The force over the shear modulus of a smooth tip so deep, and the slope of the energy there."""
    press = Indentation(COARSE.mesh(), PAPER_TIP, friction=0.0)
    stored, pushes = [], []
    for depth in (HALF_MM - 0.01, HALF_MM, HALF_MM + 0.01):
        press.advance(Where(0.0, depth), 0.1)
        stored.append(press.energy)
        pushes.append(press.touch.pushes[1])
    return pushes[1], (stored[2] - stored[0]) / 0.02


@pytest.fixture(scope='module')
def light() -> Indentation:
    """A smooth tip of 0.2 mm radius, 10 µm deep in a layer sixty radii thick."""
    press = Indentation(THICK, SMALL, friction=0.0)
    press.advance(Where(0.0, 0.01), 0.005)
    return press


def test_a_light_touch_of_a_thick_layer_takes_hertzs_force(light: Indentation):
    assert light.touch.pushes[1] == pytest.approx(
        16 / 3 * 0.2**0.5 * 0.01**1.5, rel=0.02
    )  # 4/3 E* sqrt(R d³), E* = 4 G


def test_a_light_touch_has_hertzs_contact_radius(light: Indentation):
    touch = light.touch
    assert touch.place_mm[touch.touching, 0].max() == pytest.approx((0.2 * 0.01) ** 0.5, abs=0.00625)  # half an element


def test_far_from_the_tip_a_thick_layer_moves_as_boussinesqs_half_space(light: Indentation):
    solution = Solution(
        THICK.across_mm, THICK.z_mm, np.zeros(1), np.zeros(1), np.zeros(1), nodes(light)[None].astype(np.float32), ''
    )
    r, depth = np.array([0.5, 1.0]), 0.4
    far, scale = np.hypot(r, depth), light.touch.pushes[1] / (4 * np.pi)  # nu = 1/2
    moved = solution.at(r, np.array([-depth]))[0, :, 0]
    np.testing.assert_allclose(moved[:, 0], scale * r * depth / far**3, rtol=0.03)
    sunk = scale * (depth**2 / far**3 + 1 / far)
    # The base, thirty times as deep, lifts both alike.
    assert moved[1, 1] - moved[0, 1] == pytest.approx(sunk[0] - sunk[1], rel=0.03)


def test_a_flat_punch_on_a_thick_layer_is_as_stiff_as_sneddons():
    press = Indentation(THICK, Indenter(0.2, 0.01), friction=0.0)
    press.advance(Where(0.0, 0.01), 0.005)
    assert press.touch.pushes[1] / 0.01 == pytest.approx(8 * 0.2, rel=0.06)  # 2 a E* = 8 G a; the edge is round


def test_the_gel_keeps_its_volume(deep: Indentation):
    volume = deep.body.volume(deep.state.u)
    mean = (volume * deep.body.weight).sum(1) / deep.body.weight.sum(1)
    assert np.abs(mean - 1).max() < 1e-3
    inside = deep.body.mesh.z_mm[:-1] < -2.0
    assert np.abs(volume.reshape(-1, len(inside), 9)[:, inside] - 1).max() < 0.01


def test_the_base_and_the_far_side_stay(deep: Indentation):
    assert np.abs(nodes(deep)[:, 0]).max() == 0
    assert np.abs(nodes(deep)[-1]).max() == 0


def test_the_axis_stays_an_axis(deep: Indentation):
    assert np.abs(nodes(deep)[0, :, 0]).max() == 0


def test_what_the_tip_pushes_the_base_holds(deep: Indentation):
    assert _on_the_base(deep) == pytest.approx(deep.touch.pushes[1], rel=1e-4)


def _on_the_base(press: Indentation) -> float:
    """The downward force of the layer on what it is bonded to, over the shear modulus, from its stresses."""
    body = press.body
    force = np.zeros(body.mesh.unknowns)
    np.add.at(force, body.unknowns, body.linearise(press.state.u, press.state.p).force)
    down = force.reshape(*body.mesh.nodes, 2)[..., 1]
    return float(down[:, 0].sum() + down[-1, 1:].sum())


def test_the_force_is_the_slope_of_the_energy(sliding: tuple[float, float]):
    force, slope = sliding
    assert force == pytest.approx(slope, rel=2e-3)


def test_the_tip_is_hardly_in_the_gel(deep: Indentation):
    touch = deep.touch
    gap, _, _ = PAPER_TIP.touch(touch.place_mm[..., 0], touch.place_mm[..., 1] + 1.0)
    assert -1e-3 < gap.min() < 0


def test_a_gel_that_sticks_does_not_slide(deep: Indentation):
    before, further = deep.touch, copy.deepcopy(deep)
    further.advance(Where(0.0, 1.2), 0.1)
    slid = further.touch.place_mm - before.place_mm + [0, 0.2]
    assert np.abs(slid[before.touching]).max() < 0.01


@pytest.mark.usefixtures('deep')
def test_sticking_takes_a_few_hundredths_more_force_than_sliding(sliding: tuple[float, float], on_its_way: list[float]):
    assert 0.93 < sliding[0] / on_its_way[0] < 0.99


def test_half_the_elements_size_changes_the_force_by_less_than_a_hundredth(
    deep: Indentation, finite_table: ContactTable
):
    assert deep.touch.pushes[1] * 0.111 == pytest.approx(finite_table.force_at(1.0), rel=0.01)


def test_both_sides_of_a_press_in_plane_strain_mirror_each_other():
    half = graded(20.0, 0.2, 1.3, 0.6)
    mesh = Mesh(np.concatenate([-half[:0:-1], half]), -graded(6.0, 0.2, 1.3)[::-1], plane=True)
    press = Indentation(mesh, PAPER_TIP, symmetric=False)
    press.advance(Where(0.0, 0.3), 0.1)
    np.testing.assert_allclose(nodes(press)[::-1] * [-1, 1], nodes(press), atol=1e-6)
    assert press.touch.pushes[0] == pytest.approx(0, abs=1e-5)


def test_light_touches_are_the_linear_layers(finite_table: ContactTable, table: ContactTable):
    """At an eighth of a millimetre, a fifth of the tip's radius; the moduli differ, the displacements do not."""
    assert finite_table.force_at(0.125) / 0.111 == pytest.approx(table.force_at(0.125) / 0.155, rel=0.03)
    shown = slice(None, 60), slice(None, 46)  # markers within 6 mm
    for one, two in zip(finite_table.displacement_at(0.125), table.displacement_at(0.125), strict=True):
        assert np.abs(one[shown] - two[shown]).max() < 0.06 * np.abs(two[shown]).max()


def test_a_deep_press_is_harder_than_linear_by_a_third(finite_table: ContactTable, table: ContactTable):
    ratio = finite_table.force_at(2.0) / 0.111 / (table.force_at(2.0) / 0.155)
    assert 1.25 < ratio < 1.4


def test_the_papers_depth_of_two_millimetres_takes_one_newton(finite_table: ContactTable):
    assert finite_table.force_at(2.0) == pytest.approx(1.0, abs=0.01)


def test_the_tabulated_surface_lies_on_the_tip(finite_table: ContactTable):
    """At 2 mm the material on the axis is at -2 mm, and what rests 0.3 mm beside it on the half sphere."""
    radial, vertical = finite_table.displacement_at(2.0)
    assert vertical[0, -1] == pytest.approx(-2.0, abs=2e-3)
    x, y = 0.3 + radial[3, -1], vertical[3, -1]
    assert np.hypot(x, y + 2.0 - 0.6) == pytest.approx(0.6, abs=5e-3)


def test_the_layer_under_a_finite_tip_answers_as_the_linear_layer_far_away(finite_table: ContactTable):
    """Per newton, 6 mm away, the load's shape does not matter."""
    radial, _ = finite_table.displacement_at(0.25)
    linear, _ = Layer(6.0, 0.111, 0.5).displacement_mm(0.35, np.array([6.0]), np.array([-1.5]))
    assert radial[60, 45] / finite_table.force_at(0.25) == pytest.approx(linear[0, 0], rel=0.05)


def test_a_compressible_gel_is_softer_in_a_thin_layer():
    """A layer that may change its volume gives way where an incompressible one must flow aside."""
    foam = Problem(finest_mm=0.3, growth=1.8, layer_mm=1.0, deepest_mm=0.2, rungs=2, poisson_ratio=0.3)
    rubber = Indentation(foam.mesh(), foam.indenter)
    rubber.advance(Where(0.0, 0.2), 0.02)
    assert solve_problem(foam).force_mm2[-1] < 0.8 * rubber.touch.pushes[1]
