from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.simulation.touch.bricks import Bricks, Layer
from tactile_nodes.simulation.touch.families import make_body
from tactile_nodes.simulation.touch.table import Placed, Touch, TouchTable, node_forces, over_bins
from tactile_nodes.simulation.touch.track import Track, Way, solve_track, track_key

WAY = Way(force_mm2=4.0, drag_mm=0.4, drag_rad=0.5, press_stages=2, drag_stages=1)


@pytest.fixture(scope='module')
def bricks() -> Bricks:
    return Bricks(Layer(cells=48, spacing_mm=0.6, rows=6))


@pytest.fixture(scope='module')
def track(bricks: Bricks) -> Track:
    return solve_track(bricks, make_body('ball'), WAY)


@pytest.fixture(scope='module')
def table(track: Track) -> TouchTable:
    return TouchTable.of_track(track, -1.5)


def test_a_track_begins_with_nothing_and_ends_pressed_and_dragged(track: Track):
    assert (track.force[0] == 0).all()
    assert track.force[1, 2] == pytest.approx(4.0 * 0.5**1.5, rel=5e-3)
    assert track.force[2:, 2] == pytest.approx([4.0, 4.0], rel=5e-3)
    along = track.force[3, :2]
    assert math.atan2(along[1], along[0]) == pytest.approx(0.5, abs=0.02)
    assert np.hypot(*along) == pytest.approx(WAY.friction * 4.0, rel=0.06)  # 8 a d / (2 - nu) = 3.1: it slips


def test_the_same_problem_has_the_same_key_and_another_another(bricks: Bricks):
    body = make_body('ball')
    key = track_key(bricks.layer, body, WAY)
    assert key == track_key(bricks.layer, make_body('ball'), WAY)
    assert key != track_key(bricks.layer, make_body('two'), WAY)
    assert key != track_key(bricks.layer, body, Way(force_mm2=4.0))


def test_the_table_gives_what_was_solved(track: Track, table: TouchTable):
    level = int(np.flatnonzero(track.z_mm <= -1.5)[-1])
    x, y = np.meshgrid(track.line_mm[10:-10], track.line_mm[10:-10])
    points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, track.z_mm[level])]).astype(np.float32)
    found = Placed(table, points, Touch('ball', 0.0, 0.0)).moved_mm(3.0)
    solved = track.moved_mm[3, level][:, 10:-10, 10:-10].reshape(3, -1).T
    assert np.abs(found - solved).max() < 0.03 * np.abs(solved).max()


def test_a_table_tells_how_markers_move_that_lie_close_below_the_surface(track: Track):
    """0.35 mm below it the gel moves aside as it was solved to, though that changes fast with depth there."""
    shallow = TouchTable.of_track(track, -0.3)
    x, y = np.meshgrid(track.line_mm[14:-14], track.line_mm[14:-14])
    points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, -0.35)]).astype(np.float32)
    found = Placed(shallow, points, Touch('ball', 0.0, 0.0)).moved_mm(2.0)[:, :2]
    solved = CubicSpline(track.z_mm, track.moved_mm[2])(-0.35)[:2, 14:-14, 14:-14].reshape(2, -1).T
    assert np.linalg.norm(found - solved) < 0.1 * np.linalg.norm(solved)


def test_a_turned_and_shifted_touch_is_the_same_seen_from_elsewhere(table: TouchTable):
    random = np.random.default_rng(3)
    points = random.uniform((-6, -6, -6), (6, 6, -1.5), (50, 3)).astype(np.float32)
    turn = 0.8
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]], np.float32)
    elsewhere = points.copy()
    elsewhere[:, :2] = points[:, :2] @ rotation.T + np.array([2.0, -1.0], np.float32)
    here = Placed(table, points, Touch('ball', 0.0, 0.0)).moved_mm(2.5)
    there = Placed(table, elsewhere, Touch('ball', 2.0, -1.0, turn)).moved_mm(2.5)
    np.testing.assert_allclose(there[:, :2], here[:, :2] @ rotation.T, atol=2e-5)
    np.testing.assert_allclose(there[:, 2], here[:, 2], atol=2e-5)
    force = node_forces(table, Touch('ball', 0.0, 0.0, 0.0, 3.0))[1].sum(axis=0)
    turned = node_forces(table, Touch('ball', 2.0, -1.0, turn, 3.0))[1].sum(axis=0)
    np.testing.assert_allclose(turned[:2], rotation @ force[:2], rtol=1e-5)


def test_between_stages_motion_and_force_go_together(table: TouchTable):
    points = np.array([[1.0, 0.5, -2.0]], np.float32)
    placed = Placed(table, points, Touch('ball', 0.0, 0.0))
    half = placed.moved_mm(0.5)
    np.testing.assert_allclose(half, placed.moved_mm(1.0) / 2, rtol=1e-5)
    force = node_forces(table, Touch('ball', 0.0, 0.0, stage=0.5))[1]
    assert force[:, 2].sum() == pytest.approx(table.force[1, 2] / 2, rel=1e-5)


def test_a_table_survives_being_written(table: TouchTable):
    again = TouchTable.from_arrays(table.to_arrays())
    np.testing.assert_allclose(again.coefficients, table.coefficients, atol=5e-4)
    assert again.key == table.key
    assert again.node_size_mm == table.node_size_mm


def test_forces_on_a_border_are_shared_and_none_is_lost():
    bins = BinGrid()
    border = bins.origin_mm[0] + 4 * bins.bin_size_mm[0]
    place = np.array([[border, 0.0], [20.0, -20.0]])
    force = np.array([[0.1, 0.0, 1.0], [0.0, 0.2, 2.0]])
    summed = over_bins(place, force, 1.0, bins)
    np.testing.assert_allclose(summed[4, 3:5, 2], [0.5, 0.5])
    np.testing.assert_allclose(summed[4, 3:5, 0], [0.05, 0.05])
    assert summed[0, 8, 2] == 2.0
    np.testing.assert_allclose(summed.sum(axis=(0, 1)), force.sum(axis=0))


def test_force_acts_where_the_surface_is_now():
    """A body that does not slip takes the surface under it along: as far as it was dragged, turned as it is turned."""
    bricks = Bricks(Layer(cells=32, spacing_mm=0.7, rows=5))
    way = Way(force_mm2=4.0, drag_mm=0.4, drag_rad=0.0, friction=20.0, press_stages=2, drag_stages=1)
    table = TouchTable.of_track(solve_track(bricks, make_body('ball'), way), -1.5)
    turn = 0.8
    pressed, dragged = (node_forces(table, Touch('ball', 2.0, -1.0, turn, stage)) for stage in (2.0, 3.0))
    before, after = (force[:, 2] @ place / force[:, 2].sum() for place, force in (pressed, dragged))
    np.testing.assert_allclose(before, [2.0, -1.0], atol=0.02)
    np.testing.assert_allclose(after - before, [0.4 * np.cos(turn), 0.4 * np.sin(turn)], atol=0.04)
