"""The gel's outline in two rest images: how the one maps onto the other, whatever the markers and the light are."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tactile_nodes.errors import ImageError
from tactile_nodes.sensing.picture.outline import outline_map

SIDE = 240
HALF_PX = 85.0


def gel_picture(seed: int, turn: np.ndarray, shift_px: tuple[float, float], light: float = 1.0) -> np.ndarray:
    """Random bright dots in a square, mapped about the middle of the picture, blurred, with noise."""
    random = np.random.default_rng(seed)
    places = random.uniform(-HALF_PX, HALF_PX, (2500, 2)) @ turn.T + np.array(shift_px) + (SIDE - 1) / 2
    picture = np.zeros((SIDE, SIDE))
    u, v = np.round(places).astype(int).T
    np.add.at(picture, (v, u), 400.0 * light)
    picture = 14 + cv2.GaussianBlur(picture, (0, 0), 1.0) + random.normal(0, 1.2, picture.shape)
    return np.clip(picture, 0, 255).astype(np.uint8)


def test_a_shift_is_found_between_gels_with_other_markers_and_light() -> None:
    found = outline_map(gel_picture(1, np.eye(2), (0, 0)), gel_picture(2, np.eye(2), (7.0, -4.0), light=0.7))
    assert found.shift_px == pytest.approx([7.0, -4.0], abs=1.0)
    assert found.turn == pytest.approx(np.eye(2), abs=0.02)


def test_a_roll_and_a_scale_are_found() -> None:
    turn = 1.04 * np.array([[np.cos(0.06), -np.sin(0.06)], [np.sin(0.06), np.cos(0.06)]])
    found = outline_map(gel_picture(1, np.eye(2), (0, 0)), gel_picture(2, turn, (2.0, 3.0)))
    assert found.turn == pytest.approx(turn, abs=0.025)


def test_the_stated_uncertainty_covers_chance_differences() -> None:
    still = gel_picture(1, np.eye(2), (0, 0))
    shifts = [outline_map(still, gel_picture(seed, np.eye(2), (3.0, 0.0))) for seed in range(10, 18)]
    ratios = [(found.shift_px - (3.0, 0.0)) / found.sigma_px for found in shifts]
    assert 0.1 < np.sqrt(np.mean(np.square(ratios))) < 2.0


def test_places_are_carried_back() -> None:
    turn = np.array([[1.03, 0.02], [-0.02, 1.03]])
    found = outline_map(gel_picture(1, np.eye(2), (0, 0)), gel_picture(2, turn, (6.0, 0.0)))
    there = np.array([[20.0, -10.0]]) @ turn.T + (6.0, 0.0)
    assert found.back(there) == pytest.approx(np.array([[20.0, -10.0]]), abs=1.5)


def test_a_picture_full_of_markers_shows_no_outline() -> None:
    random = np.random.default_rng(3)
    dots = np.zeros((SIDE, SIDE))
    dots[random.integers(0, SIDE, 5000), random.integers(0, SIDE, 5000)] = 400.0
    full = np.clip(14 + cv2.GaussianBlur(dots, (0, 0), 1.0), 0, 255).astype(np.uint8)
    with pytest.raises(ImageError, match='outline of the gel is not in it'):
        outline_map(full, full)


def test_pictures_of_two_sizes_are_refused() -> None:
    with pytest.raises(ImageError, match='one crop'):
        outline_map(gel_picture(1, np.eye(2), (0, 0)), np.zeros((100, 100), np.uint8))
