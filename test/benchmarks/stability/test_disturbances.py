"""Disturbances of a simulated sensor: each does what it says, and nothing at none."""

from __future__ import annotations

import math

import numpy as np
import pytest
from coarse_table import linear_table
from hypothesis import given, settings
from hypothesis import strategies as draw

from benchmarks import disturbances as disturb
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import NoiseBank, Press, place_markers

LINEAR = Gel(mechanics='linear', marker_count=2000, image_width=320, image_height=240, focal_px_per_rad=145.0)
LIGHT = np.random.default_rng(3).uniform(5, 200, (48, 64)).astype(np.float32)


def middle_px(gel: Gel) -> np.ndarray:
    """Where the camera sees the middle of the gel's surface."""
    from tactile_nodes.simulation.camera import camera_of, camera_turn, pupil

    seen, turn = -pupil(gel)[None], camera_turn(gel)
    return camera_of(gel).project(seen if turn is None else seen @ turn)[0]


@pytest.mark.parametrize('shift_px', [0.3, 1.0, 3.0])
def test_a_knock_moves_the_middle_of_the_picture_by_so_many_pixels(shift_px: float) -> None:
    moved = middle_px(disturb.knocked(Gel(), shift_px)) - middle_px(Gel())
    assert math.hypot(*moved) == pytest.approx(shift_px, rel=0.02, abs=1e-3)
    assert abs(moved[0]) == pytest.approx(abs(moved[1]), rel=0.02, abs=1e-3)


def test_a_longer_lens_moves_what_lies_off_the_middle_in_proportion() -> None:
    from tactile_nodes.simulation.camera import camera_of, pupil

    point = np.array([[8.0, 0.0, 0.0]], np.float32)
    far = [camera_of(gel).project(point - pupil(gel))[0, 0] - 319.5 for gel in (Gel(), disturb.magnified(Gel(), 1.0))]
    assert far[1] / far[0] == pytest.approx(1.01, rel=1e-4)


def test_a_gel_put_back_aside_is_seen_from_so_far_aside() -> None:
    gel = disturb.reseated(Gel(camera_shift_mm=(0.5, 0.0)), 0.1)
    assert math.dist(gel.camera_shift_mm, (0.5, 0.0)) == pytest.approx(0.1)


def test_a_warm_sensor_ends_at_the_longer_lens_the_knock_and_the_dimmer_lamp_and_begins_at_none() -> None:
    assert disturb.warmed(Gel(), 0.0) == Gel()
    warm = disturb.warmed(Gel(), 1e9)
    assert warm.focal_px_per_rad == pytest.approx(290 * 1.0002)
    assert warm.light_gain == pytest.approx(0.95)


@settings(max_examples=30, deadline=None)
@given(share=draw.floats(0.0, 0.9), seed=draw.integers(0, 1000))
def test_so_many_markers_go_and_clusters_are_whole_holes(share: float, seed: int) -> None:
    markers, _ = place_markers(LINEAR)
    assert disturb.gone_anywhere(markers, share, seed).mean() == pytest.approx(share, abs=1 / 2000)
    gone = disturb.gone_in_clusters(markers, share, seed)
    hole = math.pi * 3.0**2 / 32**2
    assert share <= gone.mean() <= share + 1.5 * hole or share == gone.mean() == 0


def test_no_marker_is_left_in_the_corner_and_all_are_elsewhere() -> None:
    markers, _ = place_markers(LINEAR)
    gone = disturb.gone_in_a_corner(markers, 0.25)
    assert (gone == ((markers[:, 0] > 0) & (markers[:, 1] > 0))).mean() > 0.995


def test_markers_that_lost_their_light_are_not_drawn() -> None:
    tables = {'tip': linear_table(LINEAR)}
    whole = disturb.WornOptics(LINEAR, tables)
    none = disturb.WornOptics(LINEAR, tables, np.ones(2000, bool))
    dark = none.light(((Press(0.0, 0.0, 1.0),),))
    assert dark.max() == pytest.approx(LINEAR.background_grey, rel=1e-4)
    assert whole.light(((),)).max() > 60


def test_an_exposure_shows_the_mean_of_its_moments() -> None:
    optics = disturb.WornOptics(LINEAR, {'tip': linear_table(LINEAR)})
    up, down = ((Press(0.0, 0.0, depth),) for depth in (0.2, 0.6))
    mean = (optics.light((up,)) + optics.light((down,))) / 2
    assert np.abs(optics.light((up, down)) - mean).max() < 0.5


def test_a_gradient_leaves_the_middle_and_takes_as_much_left_as_it_gives_right() -> None:
    even = np.full((4, 101), 100, np.float32)
    assert disturb.graded(even, 0.2)[0, [0, 50, 100]] == pytest.approx([80, 100, 120])


def test_a_hot_spot_is_brightest_at_its_place() -> None:
    spot = disturb.with_hot_spot(np.zeros((100, 200), np.float32), 60.0, (0.25, 0.5))
    assert np.unravel_index(spot.argmax(), spot.shape) == (50, 50)
    assert spot.max() == pytest.approx(60)


@settings(max_examples=15, deadline=None)
@given(sigma_px=draw.floats(0.0, 3.0))
def test_blur_keeps_the_light(sigma_px: float) -> None:
    point = np.zeros((41, 41), np.float32)
    point[20, 20] = 100
    soft = disturb.blurred(point, sigma_px)
    assert soft.sum() == pytest.approx(100, rel=1e-3)
    assert soft.max() <= 100


@pytest.mark.parametrize('share', [0.01, 0.1, 0.3])
def test_dirt_covers_so_much_and_lets_a_tenth_through(share: float) -> None:
    through = disturb.dirt((480, 640), share)
    assert share * 0.8 < (through < 0.55).mean() < share + 0.01
    assert through.min() == pytest.approx(disturb.DIRT_LIGHT, abs=0.05)
    assert through.max() == pytest.approx(1.0)


def test_bands_roll_on_and_have_no_mean() -> None:
    dark = np.zeros((600, 4), np.float32)
    first, second = (disturb.banded(dark, 10.0, number) for number in (0, 1))
    assert abs(first.mean()) < 0.1
    assert first.max() == pytest.approx(10, abs=0.1)
    assert np.abs(first - second).max() > 5


def test_stuck_pixels_are_always_the_same_and_as_many_as_said() -> None:
    dark = np.zeros((200, 200), np.uint8)
    first, second = (disturb.stuck_pixels(dark, 0.05, 255) for _ in range(2))
    assert (first == second).all()
    assert (first == 255).mean() == pytest.approx(0.05, abs=0.01)
    assert not dark.any()


def test_noise_has_so_many_times_the_standard_deviation() -> None:
    gel = Gel(image_width=200, image_height=200)
    level = np.full((200, 200), 100, np.float32)
    plain, loud = (NoiseBank(each).expose(level, 1).astype(float).std() for each in (gel, disturb.noisier(gel, 4.0)))
    assert loud / plain == pytest.approx(4.0, rel=0.03)
