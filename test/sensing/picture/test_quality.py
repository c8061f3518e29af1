from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes.errors import ImageError
from tactile_nodes.sensing.picture.quality import ContactDetector, require_picture, require_rest_image


def test_a_black_image_is_refused():
    with pytest.raises(ImageError, match='black'):
        require_picture(np.full((440, 440), 3, np.uint8))


def test_an_overexposed_image_is_refused():
    with pytest.raises(ImageError, match='overexposed'):
        require_picture(np.full((440, 440), 255, np.uint8))


def test_markers_on_black_are_a_picture():
    image = np.zeros((440, 440), np.uint8)
    image[::8, ::8] = 200
    require_picture(image)


def test_a_rest_image_without_markers_is_refused():
    with pytest.raises(ImageError, match='markers in only 0% of its regions'):
        require_rest_image(np.full((440, 440), 90, np.uint8), np.zeros((40, 40), np.float32))


def test_contact_begins_at_the_threshold_and_ends_below_its_release():
    detector = ContactDetector(threshold_n=0.05, release_share=0.6)
    assert [detector.update(force) for force in (0.0, 0.04, 0.05, 0.04, 0.031, 0.029, 0.04)] == [
        False, False, True, True, True, False, False,
    ]  # fmt: skip
