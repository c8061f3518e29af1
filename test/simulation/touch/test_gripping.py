"""A gripped object: forces balance by hand calculation, it slips at the limit of friction, and is lost in the end."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.emulators.gripper import touches
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.mechanics import ContactTable
from tactile_nodes.simulation.optics import Press
from tactile_nodes.simulation.scene import WorldScene
from tactile_nodes.simulation.touch.gripping import LOST_MM, SLIDES_MM_S, Finger, Grip, Gripped
from tactile_nodes.simulation.worlds import InterpolatedWorld


@pytest.fixture(scope='module')
def table() -> ContactTable:
    return contact_table(Gel())


@pytest.fixture(scope='module')
def finger(table: ContactTable) -> Finger:
    return Finger(Gel(), table)


def test_two_equal_gels_share_the_squeeze_and_press_with_one_force(table: ContactTable, finger: Finger) -> None:
    hold = Grip([finger, finger], Gripped(width_mm=30.0)).hold(opening_mm=28.0, pull_n=0.0, since_s=0.0)
    assert hold.depth_mm == pytest.approx((1.0, 1.0), abs=0.005)  # 2 mm of squeeze, half on each side
    assert hold.normal_n == pytest.approx(table.force_at(1.0), rel=0.01)
    assert not hold.slips


def test_of_two_gels_the_softer_one_gives_way_more(table: ContactTable, finger: Finger) -> None:
    stiff_gel = Gel(shear_modulus_mpa=2 * Gel().shear_modulus_mpa)
    stiff = contact_table(stiff_gel)
    hold = Grip([finger, Finger(stiff_gel, stiff)], Gripped(30.0)).hold(28.5, 0.0, 0.0)
    soft_mm, stiff_mm = hold.depth_mm
    assert soft_mm > stiff_mm
    assert soft_mm + stiff_mm == pytest.approx(1.5, abs=0.01)
    assert table.force_at(soft_mm) == pytest.approx(stiff.force_at(stiff_mm), rel=0.02)


def test_each_gel_bears_half_of_the_pull_until_friction_is_used_up(finger: Finger) -> None:
    grip = Grip([finger, finger], Gripped(30.0, friction=0.5))
    at_rest = grip.hold(28.0, 0.0, 0.0)
    limit_n = 2 * 0.5 * at_rest.normal_n  # Coulomb, on two sides
    held = grip.hold(28.0, 0.9 * limit_n, 0.1)
    stiffness = finger.stiffness_n_mm(held.depth_mm[0])
    assert 2 * stiffness * held.drag_mm == pytest.approx(0.9 * limit_n, rel=1e-6)
    assert (held.slips, held.slid_mm) == (False, 0.0)
    slipping = grip.hold(28.0, 1.1 * limit_n, 0.1)
    assert 2 * stiffness * slipping.drag_mm == pytest.approx(limit_n, rel=1e-6)
    assert (slipping.slips, slipping.slid_mm) == (True, pytest.approx(0.1 * SLIDES_MM_S))
    assert grip.hold(28.0, 0.9 * limit_n, 0.1).slid_mm == slipping.slid_mm  # it sticks again where it is


def test_what_has_slid_out_is_lost_and_presses_no_more(finger: Finger) -> None:
    grip = Grip([finger, finger], Gripped(30.0, friction=0.1))
    grip.hold(28.0, 5.0, LOST_MM / SLIDES_MM_S)
    hold = grip.hold(28.0, 5.0, 0.1)
    assert grip.lost
    assert (hold.normal_n, hold.depth_mm[0] < 0) == (0.0, True)


def test_open_fingers_touch_nothing(finger: Finger) -> None:
    hold = Grip([finger, finger], Gripped(30.0)).hold(34.0, 1.0, 0.1)
    assert hold.depth_mm == (-2.0, -2.0)
    assert (hold.normal_n, hold.drag_mm, hold.slips) == (0.0, 0.0, False)


def test_the_pull_goes_its_own_way_along_each_surface(finger: Finger) -> None:
    hold = Grip([finger, finger], Gripped(30.0)).hold(28.0, 0.4, 0.1)
    left, right = touches(hold, [(0.0, 1.0), (0.0, -1.0)])
    assert left.shift_mm == (0.0, pytest.approx(hold.drag_mm))
    assert right.shift_mm == (0.0, pytest.approx(-hold.drag_mm))


def test_an_interpolated_world_is_between_two_moments_and_stays_after_the_last(table: ContactTable) -> None:
    world = InterpolatedWorld(Gel(), table)
    assert world.press_at(5).depth_mm < 0
    world.put(1_000, Press(0.0, 0.0, 0.5))
    world.put(2_000, Press(1.0, 0.0, 1.5, shift_mm=(0.0, 0.4)))
    world.put(1_500, Press(9.0, 9.0, 9.0))  # late: passed over
    assert world.press_at(1_250) == Press(0.25, 0.0, 0.75, shift_mm=(0.0, 0.1))
    assert world.press_at(9_000).depth_mm == 1.5
    assert world.force_at(9_000) == pytest.approx(table.force_at(1.5))


def test_truth_of_a_dragged_tip_is_its_force_and_its_drag_in_one_bin(table: ContactTable, finger: Finger) -> None:
    world = InterpolatedWorld(Gel(), table)
    world.put(1, Press(4.0, -4.0, 1.0, shift_mm=(0.2, 0.0)))
    truth = WorldScene(world).truth(1)
    assert truth.total_n == pytest.approx(table.force_at(1.0))
    assert truth.shear_n == pytest.approx((0.2 * finger.stiffness_n_mm(1.0), 0.0), rel=1e-5)
    assert np.count_nonzero(truth.normal_force_n) == 1
