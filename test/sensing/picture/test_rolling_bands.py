"""Bands that roll over the picture are taken out of it; nothing else is taken for bands."""

from __future__ import annotations

import numpy as np
import pytest
from dots import SIDE, grow, picture, press, shift, turn
from hypothesis import given, settings
from hypothesis import strategies as st
from measured import Measured

from tactile_nodes.sensing.picture.registration import Registration
from tactile_nodes.sensing.picture.rolling_bands import RollingBands

REST = np.rint(np.mean([picture(number=number) for number in range(8)], axis=0)).astype(np.uint8) + 20
"""Dots on a ground so bright that a band of 20 grey levels blackens none of it."""


def rolled(image: np.ndarray, grey: float, period_px: float = 60.0, phase: float = 0.0) -> np.ndarray:
    bands = grey * np.sin(2 * np.pi * np.arange(SIDE) / period_px + phase)
    return np.clip(np.rint(image + bands[:, None]), 0, 255).astype(np.uint8)


@settings(max_examples=10, deadline=None)
@given(st.floats(5, 25), st.floats(40, 300), st.floats(0, 6.28), st.floats(0, 6))
def test_a_picture_is_what_it_was_between_its_bands(grey: float, period: float, phase: float, most_px: float) -> None:
    """To the noise of a row's mean: dots that a press moves change it by less than a grey level and a half."""
    plain = picture(press(200, 240, most_px), number=3) + 20
    bands = RollingBands(REST)
    image = rolled(plain, grey, period, phase)
    mended = bands.without(image)
    assert mended is not image
    inside = (mended > 0) & (mended < 255) & (plain < 255 - 26)
    assert np.square(mended.astype(float) - plain)[inside].mean() < 1.5**2


@settings(max_examples=12, deadline=None)
@given(
    st.sampled_from([press(150, 300, 8.0), shift(0.5, -3.0), shift(0, 8), turn(2.0), grow(0.01), None]),
    st.floats(0.2, 1.6), st.floats(0, 0.6), st.integers(0, 7), st.floats(0, 200),
)  # fmt: skip
def test_nothing_else_is_taken_for_bands(motion, light: float, gone: float, number: int, spot_grey: float) -> None:
    """Presses, knocks, another light, dots that are gone and a hot spot change parts of a row each otherwise."""
    motions = () if motion is None else (motion,)
    image = picture(*motions, number=number, light=light, gone=gone).astype(float) + 20
    y, x = np.mgrid[:SIDE, :SIDE]
    image += spot_grey * np.exp(-0.5 * ((x - 150) ** 2 + (y - 280) ** 2) / 40**2)
    seen = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    bands = RollingBands(REST)
    assert bands.without(seen) is seen


def test_a_picture_that_is_nearly_black_has_no_bands() -> None:
    image = (0.3 * rolled(REST, 20.0)).astype(np.uint8)
    assert RollingBands(REST).without(image) is image


@pytest.mark.parametrize('patches', [10, 20])
def test_motion_among_bands_is_measured_as_without_them(patches: int) -> None:
    measure = Measured(REST, regions=patches, registration=Registration())
    plain = picture(press(200, 240, 3.0), number=3) + 20
    without, banded, after = measure(plain, 1), measure(rolled(plain, 20.0), 2), measure(plain, 3)
    assert (without.banded, banded.banded, after.banded) == (False, True, False)
    off = banded.motion.displacement_px - without.motion.displacement_px
    assert np.abs(off).max() < 0.1
    assert np.square(off).mean() < 0.01**2
    assert after.motion.displacement_px == pytest.approx(without.motion.displacement_px, abs=1e-6)
