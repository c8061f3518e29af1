"""What moved beside the rest image: measured where something may have, and nothing where nothing did."""

from __future__ import annotations

import numpy as np
import pytest
from measured import Measured

from tactile_nodes.errors import ImageError
from tactile_nodes.sensing.picture.stillness import StillnessOptions

RNG = np.random.default_rng(5)
PATTERN = np.repeat(np.repeat(RNG.integers(0, 200, (40, 40), dtype=np.uint8), 4, 0), 4, 1)
ALL = StillnessOptions(full_every=1000)


def test_the_rest_image_itself_has_not_moved() -> None:
    assert np.abs(Measured(PATTERN, 'dis')(PATTERN).features.values).max() < 1e-3


def test_a_picture_of_another_size_is_refused() -> None:
    with pytest.raises(ImageError, match='160'):
        Measured(PATTERN).rest.features(PATTERN[:80])


def test_a_frame_in_which_nothing_touches_has_no_motion_and_is_not_measured() -> None:
    found = Measured(PATTERN, check=ALL)(PATTERN)
    assert found.untouched
    assert not found.features.values.any()
    assert found.features.confidence.min() > 0.9


def test_what_the_check_saw_of_a_frame_is_reported_with_it() -> None:
    found = Measured(PATTERN, 'dis', check=ALL)(PATTERN)
    assert found.still and found.stillness is not None and found.stillness.motion < 1.0


def test_a_frame_that_moved_is_measured_as_without_the_check() -> None:
    moved = np.roll(PATTERN, 2, axis=1)
    checked, plain = (Measured(PATTERN, 'dis', check=check)(moved) for check in (StillnessOptions(), None))
    assert not checked.untouched
    assert (checked.motion.displacement_px == plain.motion.displacement_px).all()
