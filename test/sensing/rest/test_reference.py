from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes.errors import ImageError
from tactile_nodes.sensing.rest.reference import average, content_id


def test_frames_are_averaged_and_rounded():
    frames = [np.full((2, 2), grey, np.uint8) for grey in (10, 13)]
    np.testing.assert_array_equal(average(frames), 12)


def test_bright_frames_do_not_overflow():
    np.testing.assert_array_equal(average([np.full((2, 2), 255, np.uint8)] * 300), 255)


def test_averaging_sixteen_frames_lowers_the_noise_to_a_quarter():
    random = np.random.default_rng(0)
    frames = [np.clip(np.round(random.normal(100, 8, (200, 200))), 0, 255).astype(np.uint8) for _ in range(16)]
    assert average(frames).std() == pytest.approx(8 / 4, rel=0.05)


def test_frames_of_different_sizes_are_refused():
    with pytest.raises(ImageError, match='differ in size'):
        average([np.zeros((2, 2), np.uint8), np.zeros((2, 3), np.uint8)])


def test_no_frame_gives_no_rest_image():
    with pytest.raises(ImageError, match='no frame'):
        average([])


def test_one_changed_pixel_changes_the_name():
    image = np.zeros((4, 6), np.uint8)
    other = image.copy()
    other[0, 0] = 1
    assert content_id(image) == content_id(image.copy())
    assert content_id(image) != content_id(other)


def test_the_same_pixels_in_another_size_have_another_name():
    assert content_id(np.zeros((4, 6), np.uint8)) != content_id(np.zeros((6, 4), np.uint8))
