"""Motion of the whole picture and touches, in 6x8 regions of a picture of 320x240 px of printed dots."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes.sensing.flow.methods import DisplacementField
from tactile_nodes.sensing.picture.moved_dots import SETTLE_FRAMES, MovedDots

SHAPE, ROWS, COLS = (240, 320), 6, 8
AT_PX = np.stack(np.meshgrid((np.arange(COLS) + 0.5) * 40 - 160, (np.arange(ROWS) + 0.5) * 40 - 120), -1)
"""Middles of the regions, from that of the picture."""
STILL = np.zeros_like(AT_PX)
SHIFT = np.broadcast_to([2.0, -1.0], AT_PX.shape)
TURN = np.deg2rad(0.5) * np.stack([-AT_PX[..., 1], AT_PX[..., 0]], -1)
GROWTH = 0.005 * AT_PX
KNOCKS = {'shift': SHIFT, 'turn': TURN, 'growth': GROWTH, 'all three': SHIFT + TURN + GROWTH}


def touch(most_px: float) -> np.ndarray:
    """Outwards from a place right of the middle, most at 40 px from it."""
    away = AT_PX - [40.0, 20.0]
    motion: np.ndarray = most_px * away / 40 * np.exp(0.5 - 0.5 * np.square(away / 40).sum(axis=-1, keepdims=True))
    return motion


def seen(dots: MovedDots, motion: np.ndarray, seed: int = 0, confidence: float = 1.0) -> np.ndarray:
    """What is left of a motion that is measured with 0.01 px of noise."""
    noise = np.random.default_rng(seed).normal(0, 0.01, motion.shape)
    field = DisplacementField((motion + noise).astype(np.float32), np.full((ROWS, COLS), confidence, np.float32))
    return dots.without(field, np.ones((ROWS, COLS), np.float32), SHAPE).displacement_px


@pytest.mark.parametrize('knock', KNOCKS.values(), ids=list(KNOCKS))
def test_a_knocked_camera_moves_nothing_and_a_touch_after_it_is_seen_alone(knock: np.ndarray) -> None:
    dots = MovedDots()
    for seed in range(SETTLE_FRAMES + 1):
        assert seen(dots, knock, seed) == pytest.approx(STILL, abs=0.06)
    assert dots.size_px == pytest.approx(np.sqrt(np.square(knock).sum(axis=-1).mean()), rel=0.05)
    assert seen(dots, knock + touch(1.0), 20) == pytest.approx(touch(1.0), abs=0.06)


def test_a_camera_that_is_pushed_back_moves_nothing_either() -> None:
    dots = MovedDots()
    seen(dots, SHIFT)
    assert seen(dots, STILL, 1) == pytest.approx(STILL, abs=0.06)
    assert dots.size_px < 0.02


def test_what_a_knock_is_found_to_be_in_its_first_frame_is_corrected_in_the_next_ones() -> None:
    """It shows the camera on its way, a tenth of a pixel from its new place."""
    dots = MovedDots()
    seen(dots, SHIFT - 0.1)
    for seed in range(SETTLE_FRAMES):
        seen(dots, SHIFT, seed)
    left = np.mean([seen(dots, SHIFT, 30 + seed) for seed in range(20)], axis=0)
    assert left == pytest.approx(STILL, abs=0.02)


@pytest.mark.parametrize('most_px', [0.2, 1.0, 4.0, 15.0])
def test_a_touch_stays_as_it_was_measured_however_many_dots_it_moves(most_px: float) -> None:
    dots = MovedDots()
    assert seen(dots, touch(most_px)) == pytest.approx(touch(most_px), abs=0.06)
    assert dots.size_px == 0.0
    assert not dots.lost


def test_a_touch_that_carries_most_dots_along_is_no_knock() -> None:
    """Sideways with a third of it left to each dot by itself, as least in recordings of a real sensor."""
    beside = np.random.default_rng(5).normal(0, 1, AT_PX.shape)
    motion = SHIFT + beside * np.sqrt(np.square(SHIFT).mean() / np.square(beside).mean()) / 3
    dots = MovedDots()
    assert seen(dots, motion) == pytest.approx(motion, abs=0.06)


def test_motion_that_is_too_large_and_dots_that_are_not_found_are_left_alone() -> None:
    for dots, motion, confidence in ((MovedDots(1.0), SHIFT, 1.0), (MovedDots(), SHIFT, 0.1)):
        assert seen(dots, motion, confidence=confidence) == pytest.approx(motion, abs=0.06)


def test_a_picture_that_moved_too_far_is_lost_until_it_is_back() -> None:
    dots = MovedDots()
    seen(dots, 6 * SHIFT)
    assert dots.lost
    seen(dots, SHIFT)
    assert not dots.lost


def test_at_rest_all_is_forgotten() -> None:
    dots = MovedDots()
    seen(dots, SHIFT)
    dots.at_rest()
    assert dots.size_px == 0.0
    assert seen(dots, touch(1.0)) == pytest.approx(touch(1.0), abs=0.06)


def test_under_a_mask_over_most_of_the_picture_a_knock_is_found_in_what_is_left_of_it() -> None:
    """Of 8 columns 3 show dots, at rest and now; where they show none, motion has no meaning."""
    dots, confidence = MovedDots(), np.zeros((ROWS, COLS), np.float32)
    confidence[:, 5:] = 1.0
    field = DisplacementField(np.where(confidence[..., None] > 0, SHIFT, 0.0).astype(np.float32), confidence)
    left = dots.without(field, confidence, SHAPE).displacement_px
    assert left[:, 5:] == pytest.approx(STILL[:, 5:], abs=0.01)
    assert dots.size_px == pytest.approx(np.hypot(2.0, 1.0), rel=0.01)
