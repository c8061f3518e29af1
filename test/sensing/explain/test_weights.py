"""How much regions count, and what the camera's own motion takes from them."""

import numpy as np
import pytest

from tactile_nodes.sensing.explain.field.weights import CAMERA_PX, Weights, camera_ways, region_weights
from tactile_nodes.sensing.explain.noise import inside_of, noise_of

NOISE_PX = 0.004
STILL = np.zeros((4, 2))


def test_a_region_of_which_two_fifths_of_the_pattern_are_not_explained_is_off_by_a_tenth_of_a_pixel() -> None:
    """Confidence is the square of the share explained: of 0.36, 0.4 is left, and 0.4 times 0.25 px is 0.1 px."""
    weights = region_weights(STILL, np.array([1.0, 1.0, 1.0, 0.36]), NOISE_PX, 0.02)
    assert 1 / np.sqrt(weights) == pytest.approx([NOISE_PX] * 3 + [0.1], rel=1e-3)


def test_what_blur_or_darkness_takes_from_all_regions_alike_makes_none_of_them_unlike_the_others() -> None:
    assert region_weights(STILL, np.full(4, 0.5), NOISE_PX, 0.02) == pytest.approx(np.full(4, NOISE_PX**-2))


def test_a_share_of_the_motion_is_expected_to_be_off() -> None:
    moved = np.array([[0.0, 0.0], [3.0, 4.0]])
    assert 1 / region_weights(moved, np.ones(2), 0.0 + NOISE_PX, 0.02) == pytest.approx([1.6e-5, 1.6e-5 + 0.01])


def test_lost_regions_count_next_to_nothing() -> None:
    weights = region_weights(STILL, np.array([1.0, 1.0, 1.0, 0.05]), NOISE_PX, 0.02)
    assert weights[3] < 1e-6 * weights[0]


def test_the_camera_moves_right_and_down_rolls_and_comes_nearer() -> None:
    """In a picture of 2x2 regions their middles are half way to the edge."""
    first, *_, last = camera_ways((2, 2), np.arange(4)).reshape(4, 2, 4) / CAMERA_PX
    np.testing.assert_allclose(first.T, [[1, 0], [0, 1], [0.5, -0.5], [-0.5, -0.5]])
    np.testing.assert_allclose(last.T, [[1, 0], [0, 1], [-0.5, 0.5], [0.5, 0.5]])


def test_weights_without_the_camera_are_those_of_both_found_together() -> None:
    """W - W C (1 + C'WC)^-1 C'W, written out."""
    random = np.random.default_rng(1)
    regions, camera = random.uniform(1, 9, 5), random.standard_normal((10, 4))
    single = np.diag(np.repeat(regions, 2))
    together = np.linalg.inv(np.eye(4) + camera.T @ single @ camera)
    expected = single - single @ camera @ together @ camera.T @ single
    weights = Weights.of(regions, camera)
    assert weights.times(np.eye(10)) == pytest.approx(expected, abs=1e-4)
    motions = random.standard_normal((3, 10)).astype(np.float32)
    assert weights.among(motions) == pytest.approx(np.tril(motions @ expected @ motions.T), rel=1e-4, abs=1e-4)
    motion = random.standard_normal(10)
    assert weights.squared(motion) == pytest.approx(motion @ expected @ motion, rel=1e-4)


EVERYWHERE = inside_of(np.ones((20, 20), bool))


def test_the_noise_of_a_frame_is_reported_beside_a_strong_contact() -> None:
    """0.03 px of noise; a contact that moves its 25 regions by up to 1 px in all directions, all others smoothly."""
    random = np.random.default_rng(1)
    along = np.linspace(-1, 1, 20)
    smooth = 0.2 * np.stack(np.broadcast_arrays(along**2, along[:, None] ** 2), -1)
    moved = smooth + random.normal(0, 0.03, (20, 20, 2))
    moved[5:10, 8:13] += random.uniform(-1, 1, (5, 5, 2))
    assert noise_of(moved.astype(np.float32), EVERYWHERE) == pytest.approx(0.03, rel=0.35)
    assert noise_of(smooth.astype(np.float32), EVERYWHERE) < 0.001


def test_of_noise_alone_so_much_is_reported_as_there_is() -> None:
    """648 differences, whose three tenths quantile is known to a twentieth."""
    moved = np.random.default_rng(2).normal(0, 0.03, (20, 20, 2))
    assert noise_of(moved.astype(np.float32), EVERYWHERE) == pytest.approx(0.03, rel=0.15)


def test_too_few_regions_tell_no_noise() -> None:
    assert noise_of(np.ones((4, 4, 2), np.float32), inside_of(np.ones((4, 4), bool))) == 0.0
