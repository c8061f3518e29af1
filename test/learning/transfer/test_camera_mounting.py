"""Whether a mounting gives way is told from the residuals of presses, in pixels per newton."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes.learning.transfer.mounting import gives_way_px, in_words
from tactile_nodes.sensing.explain.camera import camera_terms, without_camera

SIDE, NOISE_PX = 10, 0.01
CAMERA = camera_terms((SIDE, SIDE), np.arange(SIDE * SIDE))
FORCE_N = np.linspace(0.1, 2.0, 30)
CERTAINTY = np.full((30, SIDE * SIDE, 2), NOISE_PX**-2)


def residuals(right_px_per_n: float) -> np.ndarray:
    """Noise, and a picture that moves to the right with the force."""
    noise = np.random.default_rng(1).normal(0, NOISE_PX, CERTAINTY.shape)
    return np.asarray(noise + right_px_per_n * FORCE_N[:, None, None] * np.array([1.0, 0.0]))


def test_a_mounting_that_holds_leaves_noise_alone() -> None:
    assert gives_way_px(CAMERA, residuals(0.0), CERTAINTY, FORCE_N) == 0
    assert in_words(0.0, 'the body is wide') == ''


def test_the_motion_of_the_picture_is_told_in_pixels_per_newton() -> None:
    assert gives_way_px(CAMERA, residuals(0.1), CERTAINTY, FORCE_N) == pytest.approx(0.1, rel=0.05)
    assert 'at least 0.1 px per newton' in in_words(0.1, 'the body is wide')


def test_presses_without_a_force_tell_nothing() -> None:
    force_n = np.where(np.arange(30) % 2, FORCE_N, 0.0)
    assert gives_way_px(CAMERA, residuals(0.1), CERTAINTY, force_n) == pytest.approx(0.1, rel=0.05)
    assert gives_way_px(CAMERA, residuals(0.1), CERTAINTY, np.zeros(30)) == 0


def test_regions_that_were_not_seen_have_no_say_in_the_motion_of_the_camera() -> None:
    left, certainty = residuals(0.1), CERTAINTY.copy()
    certainty[:, :20], left[:, :20] = 0.0, 100.0
    still = without_camera(CAMERA, left, certainty)
    assert np.std(still[:, 20:]) == pytest.approx(NOISE_PX, rel=0.1)
