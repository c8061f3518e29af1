"""Features outside of the directions that presses take are unlike them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_nodes.sensing.explain.likeness import Likeness, known
from tactile_nodes.sensing.explain.reading import BEYOND_UNLIKENESS, Contact

MEAN = np.array([1, 1, 1, 1], np.float32)
AXES = Likeness(MEAN, np.eye(2, 4, dtype=np.float32), floor=0.5, share=0.1)


def test_what_directions_explain_leaves_nothing_over() -> None:
    left, size = AXES.left_over(MEAN + np.array([6, -8, 0, 0], np.float32))
    assert left == pytest.approx(0.0, abs=1e-3)
    assert size == pytest.approx(5.0)  # the root of (36 + 64) / 4


def test_what_is_left_over_counts_against_floor_and_share() -> None:
    inputs = MEAN + np.array([6, 0, 8, 0], np.float32)
    assert AXES.left_over(inputs) == pytest.approx((4.0, 5.0))
    assert AXES.unlikeness(inputs) == pytest.approx(4 / (0.5 + 0.1 * 5))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 999), st.floats(0.1, 1000))
def test_features_outside_of_the_subspace_are_unlike_and_those_inside_are_not(seed: int, size: float) -> None:
    random = np.random.default_rng(seed)
    directions = np.linalg.qr(random.normal(size=(40, 5)))[0].T.astype(np.float32)
    likeness = Likeness(np.zeros(40, np.float32), directions, floor=0.02, share=0.02)
    inside = directions.T @ random.normal(size=5).astype(np.float32)
    outside = random.normal(size=40).astype(np.float32)
    outside -= directions.T @ (directions @ outside)
    for values, unlike in ((inside, False), (outside, True)):
        scaled = values * np.float32(size / math.sqrt(np.mean(values**2)))
        assert (likeness.unlikeness(scaled) > 1) == unlike


@pytest.mark.parametrize('value', [math.nan, math.inf])
@pytest.mark.filterwarnings('ignore::RuntimeWarning')
def test_inputs_that_are_no_numbers_have_no_likeness(value: float) -> None:
    assert not math.isfinite(AXES.unlikeness(np.array([0, 0, value, 0], np.float32)))


def test_contacts_are_known_up_to_the_ends_of_the_training() -> None:
    pressed = [Contact(0.0, 0.0, 0.3)]
    assert known(BEYOND_UNLIKENESS - 0.01, pressed) and not known(BEYOND_UNLIKENESS, pressed)
    assert known(math.nan, pressed)  # it cannot tell


def test_contacts_that_are_close_are_not_known_from_the_single_ones_of_a_training() -> None:
    far, near = ([Contact(-apart / 2, 0.0, 0.3), Contact(apart / 2, 0.0, 0.2)] for apart in (16.0, 14.0))
    assert known(0.4, far)
    assert not known(0.4, near)
    assert known(0.4, [near[0], Contact(7.0, 0.0, 0.0)])  # one that does not press is none
