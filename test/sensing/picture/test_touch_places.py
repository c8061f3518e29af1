"""Motion away from places: what a touch makes of the blocks around it."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes.sensing.picture.touch_places import TOUCH_BLOCKS, TouchPlaces

EVEN = np.ones((100, 2))


def burst(x: float, y: float) -> np.ndarray:
    """Motion away from a place among 10x10 blocks, as TouchPlaces expects it around a touch."""
    apart = np.stack(np.meshgrid(np.arange(10) - x, np.arange(10) - y), axis=-1).reshape(-1, 2)
    away: np.ndarray = apart * np.exp(-0.5 * np.square(apart / TOUCH_BLOCKS).sum(axis=1, keepdims=True))
    return away.astype(np.float32)


def test_motion_goes_away_most_from_the_place_of_the_touch():
    away = TouchPlaces(10, EVEN).away(burst(6.5, 2.0))
    row, column = np.unravel_index(away.argmax(), away.shape)
    assert ((column - 1) / 2, (row - 1) / 2) == (6.5, 2.0)  # two places a block, from half a block outside on


def test_motion_towards_a_place_is_as_much_as_motion_away():
    places = TouchPlaces(10, EVEN)
    assert places.most(-burst(3.0, 4.0)) == pytest.approx(places.most(burst(3.0, 4.0)), rel=1e-6)


def test_what_a_touch_makes_counts_by_its_length():
    motion = burst(5.0, 5.0)  # a scalar product with itself over its length is its length
    assert TouchPlaces(10, EVEN).most(motion) == pytest.approx(float(np.linalg.norm(motion)), rel=1e-5)


def test_independent_noise_of_one_gives_one_at_every_place():
    random = np.random.default_rng(4)
    places = TouchPlaces(10, random.uniform(0.5, 2.0, (100, 2)))
    noise = random.normal(size=(4000, 100, 2)).astype(np.float32)
    spread = np.std([places.away(each) for each in noise], axis=0)
    np.testing.assert_allclose(spread, 1.0, atol=0.06)  # of 4000 a standard deviation is known to 1.1 %


def test_blocks_that_show_nothing_count_for_nothing():
    texture = EVEN.copy()
    texture[:50] = 0.0
    hidden = burst(5.0, 5.0)
    hidden[50:] = 0.0
    assert TouchPlaces(10, texture).most(hidden) == 0.0
