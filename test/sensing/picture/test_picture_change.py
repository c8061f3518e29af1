"""Moved, turned, scaled, dimmed, touched, another: each known beforehand, each found."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from shifting import shifted

from tactile_nodes.errors import ImageError
from tactile_nodes.sensing.picture.change import PictureComparison, common_motion


def warped(picture: np.ndarray, turn_deg: float, scale: float) -> np.ndarray:
    """Turned (clockwise as seen) and scaled about the middle."""
    middle = (picture.shape[1] - 1) / 2, (picture.shape[0] - 1) / 2
    matrix = cv2.getRotationMatrix2D(middle, -turn_deg, scale)
    return cv2.warpAffine(picture, matrix, picture.shape[::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)


@pytest.fixture(scope='module')
def comparison(speckle: np.ndarray) -> PictureComparison:
    return PictureComparison(speckle)


def test_the_same_picture_has_not_changed(comparison: PictureComparison, speckle: np.ndarray) -> None:
    change = comparison.of(speckle)
    assert change.quiet
    assert (change.found, change.contrast) == pytest.approx((1, 1))
    assert change.size_px < 0.001


@pytest.mark.parametrize('shift', [(0.05, 0.0), (0.3, -0.2), (-2.0, 1.0), (12.0, 9.0)])
def test_a_shift_is_found_to_a_hundredth_or_so(
    comparison: PictureComparison, speckle: np.ndarray, shift: tuple[float, float]
) -> None:
    change = comparison.of(shifted(speckle, *shift))
    assert change.shift_px == pytest.approx(shift, abs=0.005 + 0.01 * max(map(abs, shift)))
    assert change.size_px == pytest.approx(np.hypot(*shift), rel=0.01, abs=0.005)
    assert change.quiet


def test_turn_and_growth_are_told_apart(comparison: PictureComparison, speckle: np.ndarray) -> None:
    change = comparison.of(warped(speckle, turn_deg=0.2, scale=1.004))
    assert change.turn_deg == pytest.approx(0.2, abs=0.02)
    assert change.growth == pytest.approx(0.004, abs=0.0003)
    assert np.hypot(*change.shift_px) < 0.05


def test_light_is_reported_and_is_no_motion(comparison: PictureComparison, speckle: np.ndarray) -> None:
    change = comparison.of(np.rint(speckle * 0.5).astype(np.uint8))
    assert change.contrast == pytest.approx(0.5, abs=0.01)
    assert change.size_px < 0.005


def test_a_dent_does_not_move_the_picture(comparison: PictureComparison, speckle: np.ndarray) -> None:
    """A bulge of 2 px within 50 px of a place: others stay where they are."""
    y, x = np.mgrid[:440, :440].astype(np.float32)
    away = np.hypot(x - 150, y - 260)
    push = 2 * np.exp(-((away / 50) ** 2)) / np.maximum(away, 1)
    dented = cv2.remap(speckle, x - (x - 150) * push, y - (y - 260) * push, cv2.INTER_CUBIC)
    change = comparison.of(dented)
    assert not change.quiet
    assert change.middle_px < 0.02
    assert np.hypot(*change.shift_px) < 0.03


def test_lost_markers_are_no_dent_and_a_dent_is_one(comparison: PictureComparison, speckle: np.ndarray) -> None:
    """Spots go dark at random, so patches show the mean of others: nothing has moved."""
    random = np.random.default_rng(4)
    small = (random.random((speckle.shape[0] // 8, speckle.shape[1] // 8)) < 0.2).astype(np.uint8)
    gone = cv2.resize(small, speckle.shape[::-1], interpolation=cv2.INTER_NEAREST).astype(bool)
    lost = comparison.of(np.where(gone, np.uint8(np.median(speckle)), speckle))
    assert lost.alike < 0.9
    assert lost.apart_px > 0.02
    assert lost.dented_px < lost.apart_px - 0.02
    dented = comparison.of(shifted(speckle, 0.1, 0.0))
    assert dented.alike > 0.95
    assert dented.dented_px == pytest.approx(dented.apart_px, abs=0.01)


def test_another_pattern_is_not_found(comparison: PictureComparison, speckle: np.ndarray) -> None:
    change = comparison.of(np.ascontiguousarray(speckle[::-1]))
    assert change.found < 0.1
    assert not change.same
    assert change.contrast == pytest.approx(1, abs=0.05)
    assert np.isnan(change.size_px)


def test_a_covered_half_is_lost_and_the_rest_stays_where_it_is(
    comparison: PictureComparison, speckle: np.ndarray
) -> None:
    covered = speckle.copy()
    covered[:, :220] = 3
    change = comparison.of(covered)
    assert change.found == pytest.approx(0.5, abs=0.06)
    assert change.middle_px < 0.01


def test_a_picture_without_pattern_cannot_be_compared_with() -> None:
    with pytest.raises(ImageError, match='of the rest image shows a pattern'):
        PictureComparison(np.full((440, 440), 20, np.uint8))


def test_another_size_is_refused_with_both(comparison: PictureComparison) -> None:
    with pytest.raises(ImageError, match=r'240x200 .* 440x440'):
        comparison.of(np.zeros((200, 240), np.uint8))


def test_common_motion_is_that_of_the_many() -> None:
    """Of 100 places 70 turn by 0.01 rad and move by (0.3, -0.1); 30 go their own way by 2 px."""
    places = np.random.default_rng(0).uniform(-200, 200, (100, 2))
    motion = np.array([0.3, -0.1]) + 0.01 * np.column_stack([-places[:, 1], places[:, 0]])
    motion[:30] += 2.0
    assert common_motion(motion, places) == pytest.approx([0.3, -0.1, 0.0, 0.01], abs=0.02)
