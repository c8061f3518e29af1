from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

from tactile_nodes.contact_tables.gel_tables import contact_table, load_gel
from tactile_nodes.contact_tables.touch_tables import ready_contacts
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.mechanics import ContactTable
from tactile_nodes.simulation.scene import PressSchedule, Scene, TouchSchedule, smooth
from tactile_nodes.simulation.touch.table import Touch

SECOND = 1_000_000_000
DWELL = 11 * SECOND // 10  # the middle of the first press of the default schedule


def test_the_same_time_gives_the_same_pixels_in_two_scenes(scene: Scene, table: ContactTable):
    other = Scene(scene.gel, table=table)
    other.render(5 * SECOND)
    np.testing.assert_array_equal(scene.render(DWELL), other.render(DWELL))


def test_the_whole_force_is_in_the_bin_of_the_tip(scene: Scene):
    truth = scene.truth(DWELL)
    row, col = divmod(scene.bins.bin_of(*truth.position_mm), scene.bins.cols)
    assert truth.in_contact
    assert truth.normal_force_n[row, col] == pytest.approx(truth.total_n)
    assert np.count_nonzero(truth.normal_force_n) == 1


def test_nothing_touches_before_the_start(scene: Scene, table: ContactTable):
    later = Scene(scene.gel, PressSchedule(start_ns=100 * SECOND), table=table)
    assert later.truth(100 * SECOND - 1).total_n == 0
    assert later.truth(100 * SECOND + DWELL).total_n > 0


def test_every_press_dwells_at_its_place_and_depth():
    schedule = PressSchedule(seed=3)
    for number in range(50):
        at = [schedule.press_at(round((number + share) * 2 * SECOND)) for share in (0.41, 0.5, 0.64)]
        assert at[0] == at[1] == at[2]
        assert 0.25 <= at[0].depth_mm <= 2.0
        assert abs(at[0].x_mm) <= 13.5
        assert abs(at[0].y_mm) <= 13.5


def test_the_tip_never_drags_over_the_gel():
    schedule = PressSchedule(seed=4)
    path = [schedule.press_at(round(i * SECOND / 200)) for i in range(1600)]
    for one, two in itertools.pairwise(path):
        if one.depth_mm > 0 and two.depth_mm > 0:
            assert (one.x_mm, one.y_mm) == (two.x_mm, two.y_mm)


def test_the_tip_moves_without_jumps():
    schedule = PressSchedule(seed=5)
    path = np.array(
        [(p.x_mm, p.y_mm, p.depth_mm) for p in (schedule.press_at(i * SECOND // 1000) for i in range(4100))]
    )
    assert np.abs(np.diff(path, axis=0)).max() < 0.3  # mm in a millisecond: 27 mm in 0.3 s, with a fast middle


def test_presses_cover_the_surface_and_the_depths():
    schedule = PressSchedule(seed=1)
    targets = np.array(
        [(p.x_mm, p.y_mm, p.depth_mm) for p in (schedule.press_at(2 * SECOND * n + DWELL) for n in range(500))]
    )
    # Three standard errors of a uniform distribution's mean.
    assert (np.abs(targets.mean(axis=0) - [0, 0, 1.125]) < [1.05, 1.05, 0.07]).all()
    assert len(np.unique(targets, axis=0)) == 500


def test_schedules_of_neighbouring_seeds_share_no_press():
    one, two = ({PressSchedule(seed=s).press_at(2 * SECOND * n + DWELL) for n in range(200)} for s in (1, 2))
    assert not one & two


def test_a_time_of_day_in_nanoseconds_is_as_good_as_any():
    """Stamps are about 1.7e18: too large for floats, which would move the tip in steps."""
    schedule = PressSchedule(start_ns=1_700_000_000_123_456_789)
    assert schedule.press_at(1_700_000_000_123_456_789 + DWELL) == PressSchedule().press_at(DWELL)


@pytest.mark.parametrize(('share', 'value'), [(-1.0, 0), (0.0, 0), (0.5, 0.5), (1.0, 1), (2.0, 1)])
def test_the_smooth_step_starts_at_zero_and_ends_at_one(share: float, value: float):
    assert smooth(share) == value


SLOW = Gel(settling_share=0.2, settling_s=0.4)
UP = 18 * SECOND // 10  # the tip is up again, 0.1 s ago


def test_a_settling_gel_pushes_back_harder_while_the_tip_comes_down(table: ContactTable, scene: Scene):
    slow = Scene(SLOW, table=table)
    arrived, held = 8 * SECOND // 10, 13 * SECOND // 10
    assert slow.truth(arrived).total_n > 1.05 * scene.truth(arrived).total_n
    assert slow.truth(held).total_n - scene.truth(held).total_n < 0.1 * scene.truth(held).total_n


def test_a_settling_gel_keeps_a_dent_where_the_tip_was(table: ContactTable):
    slow = Scene(SLOW, table=table)
    down, after = slow.presses_at(DWELL)[0], slow.presses_at(UP)
    assert slow.truth(UP).total_n == 0
    assert any((each.x_mm, each.y_mm) == (down.x_mm, down.y_mm) and each.depth_mm > 0.02 for each in after)


def test_a_settling_gel_remembers_the_same_whoever_asked_before(table: ContactTable):
    asked, fresh = (Scene(SLOW, table=table) for _ in range(2))
    for time_ns in (DWELL, 9 * SECOND, 3 * SECOND, UP - SECOND // 3):
        asked.presses_at(time_ns)
    assert asked.presses_at(UP) == fresh.presses_at(UP)


def test_an_exposed_frame_is_blurred_only_while_the_tip_moves(table: ContactTable, scene: Scene):
    exposed = Scene(dataclasses.replace(scene.gel, exposure_s=0.008), table=table)
    np.testing.assert_array_equal(exposed.render(DWELL), scene.render(DWELL))
    down = 6 * SECOND // 10
    assert (exposed.render(down) != scene.render(down)).any()


def test_bodies_touch_in_turn_with_the_tip_and_their_truth_has_shear():
    gel = load_gel('paper')
    bodies = ready_contacts(gel)
    visits = tuple((name, each.presses, each.stages) for name, each in bodies.items())
    schedule = TouchSchedule(bodies=visits)
    scene = Scene(gel, schedule, bodies=bodies, table=contact_table(gel))
    pressed, held = (scene.truth(2 * SECOND + part) for part in (SECOND, SECOND * 125 // 100))
    assert not scene.truth(2 * SECOND + SECOND // 10).in_contact
    assert isinstance(schedule.press_at(3 * SECOND), Touch)
    assert not isinstance(schedule.press_at(5 * SECOND), Touch)
    assert pressed.in_contact
    assert (scene.truth(DWELL).explanation, held.explanation) == ('tips', 'field')
    assert held.total_n == pytest.approx(2.0, rel=0.01)
    assert held.normal_force_n.sum() == pytest.approx(held.total_n, rel=1e-5)
    assert np.count_nonzero(held.normal_force_n > 0.01) > 4
    assert np.hypot(*held.shear_force_n.sum(axis=(0, 1))) > 0.5
    assert abs(held.position_mm[0]) < 8.1


def test_a_body_is_pressed_dragged_and_lifted_without_jumps():
    schedule = TouchSchedule(bodies=(('ring', 3, 7),), every=1)
    stages = np.array([schedule.press_at(2 * SECOND + i * SECOND // 500).stage for i in range(1000)])
    assert stages.max() == pytest.approx(6.0, abs=1e-6)
    assert stages[0] <= 0 >= stages[-1]
    assert np.abs(np.diff(stages)).max() < 0.12
    assert np.ptp(stages[310:320]) < 0.3


def test_markers_move_where_a_body_presses():
    gel = load_gel('paper')
    bodies = ready_contacts(gel)
    schedule = TouchSchedule(bodies=(('ring', bodies['ring'].presses, bodies['ring'].stages),), every=1)
    scene = Scene(gel, schedule, bodies=bodies, table=contact_table(gel))
    moved = scene.optics.displacement_mm(scene.presses_at(SECOND * 125 // 100))
    place = scene.truth(SECOND * 125 // 100).position_mm
    away = np.hypot(*(scene.optics.markers_mm[:, :2] - np.array(place, np.float32)).T)
    assert moved[(away > 3) & (away < 5), 2].mean() < -0.02
    assert np.abs(moved[away > 14]).max() < 0.3 * np.abs(moved).max()
