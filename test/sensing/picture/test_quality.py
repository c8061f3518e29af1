from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes.errors import ImageError
from tactile_nodes.sensing.picture.quality import (
    ContactDetector,
    PictureLikeness,
    require_picture,
    sharpness,
)


@pytest.mark.parametrize(('grey', 'said'), [(3, 'black'), (255, 'overexposed')])
def test_a_black_or_overexposed_image_is_refused(grey: int, said: str):
    with pytest.raises(ImageError, match=said):
        require_picture(np.full((440, 440), grey, np.uint8))


def test_markers_on_black_are_a_picture():
    image = np.zeros((440, 440), np.uint8)
    image[::8, ::8] = 200
    require_picture(image)


def test_contact_begins_at_the_threshold_and_ends_below_its_release():
    detector = ContactDetector(threshold_n=0.05, release_share=0.6)
    assert [detector.update(force) for force in (0.0, 0.04, 0.05, 0.04, 0.031, 0.029, 0.04)] == [
        False, False, True, True, True, False, False,
    ]  # fmt: skip


def test_the_usual_noise_of_a_smooth_pattern_is_not_too_much():
    """Waves of 60 px differ by 2 grey from pixel to pixel, noise of 3 grey by 3.4: frames are the sharper ones."""
    waves, random = 100 + 30 * np.sin(np.arange(440) * 2 * np.pi / 60), np.random.default_rng(1)
    frames = [np.rint(waves + random.normal(0, 3, (440, 440))).astype(np.uint8) for _ in range(16)]
    rest = np.rint(np.mean(frames, axis=0)).astype(np.uint8)
    like = PictureLikeness.of(rest, 'dots', sharpness(frames[0]) - sharpness(rest))
    assert not like.near(100.0, sharpness(frames[1]))
    assert like.near(100.0, sharpness(np.rint(waves + random.normal(0, 9, (440, 440))).astype(np.uint8))).noisy
