"""Frames that are no news: too old, behind a newer one, twice."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tactile_nodes.sensing.judge.freshness import Freshness

S = 1_000_000_000


def staleness(stamps_s: list[float], age_s: float = 0.0) -> list[bool]:
    found = Freshness(0.1)
    return [found.stale(round(each * S), age_s) for each in stamps_s]


def test_a_frame_that_comes_after_a_newer_one_or_twice_is_stale_and_the_next_is_not() -> None:
    assert staleness([1, 3, 2, 4]) == [False, False, True, False]
    assert staleness([1, 1, 2]) == [False, True, False]


def test_stamps_that_jump_back_for_good_are_believed_after_three_in_order() -> None:
    assert staleness([100, 101, 1, 2, 3, 4, 5]) == [False, False, True, True, True, False, False]


def test_a_frame_is_stale_by_its_age_and_not_judged_where_that_is_not_known() -> None:
    assert staleness([1], 0.11) == [True]
    assert staleness([1], 0.09) == [False]
    assert staleness([1], -1.0) == [True]
    assert staleness([1], math.nan) == [False]


def test_an_image_that_a_camera_repeats_is_stale_from_the_same_age_on_until_another_comes() -> None:
    found, one, other = Freshness(0.1), np.zeros((8, 8), np.uint8), np.ones((8, 8), np.uint8)
    shown = [found.stale(round(each * S), 0.0, one) for each in (1.0, 1.06, 1.12)]
    assert [*shown, found.stale(2 * S, 0.0, other)] == [False, False, True, False]


@given(st.lists(st.integers(1, 10**10), min_size=1, max_size=50, unique=True))
def test_frames_in_order_are_never_stale(stamps_ns: list[int]) -> None:
    found = Freshness(0.1)
    assert not any(found.stale(each, 0.0) for each in sorted(stamps_ns))
