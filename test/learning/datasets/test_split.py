"""Splits: the paper's counts, disjoint parts, depths in proportion, and positions that stay on one side."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.datasets.split import Split, apportioned, by_position, by_sample, depth_strata, position_ids

AXIS_MM = np.arange(-18, 19) * 0.75
DEPTHS_MM = np.arange(1, 9) * 0.25


@pytest.fixture(scope='module')
def plan() -> tuple[np.ndarray, np.ndarray]:
    """The paper's: 37x37 positions at eight depths."""
    y, x, depth = np.meshgrid(AXIS_MM, AXIS_MM, DEPTHS_MM, indexing='ij')
    return np.stack([x.ravel(), y.ravel()], axis=1), depth.ravel()


def parts(split: Split) -> list[np.ndarray]:
    return [split.train, split.validation, split.test]


@pytest.mark.parametrize('kind', ['sample', 'position'])
def test_every_sample_is_in_one_part(plan, kind: str) -> None:
    split = by_sample(np.arange(10952), plan[1], seed=3) if kind == 'sample' else by_position(plan[0], seed=3)
    assert sorted(np.concatenate(parts(split)).tolist()) == list(range(10952))


def test_each_depth_is_in_the_test_set_by_its_share(plan) -> None:
    """1369 presses a depth, a fifth of them 273.8, so 273 or 274."""
    test = plan[1][by_sample(np.arange(10952), plan[1], seed=1).test]
    counts = np.unique(test, return_counts=True)[1]
    assert len(counts) == 8
    assert set(counts.tolist()) == {273, 274}


def test_by_sample_most_positions_of_the_test_set_were_trained_at_other_depths(plan) -> None:
    """What the other split is for: a position is unknown only if its eight presses are all held out."""
    split = by_sample(np.arange(10952), plan[1], seed=1)
    places = position_ids(plan[0])
    assert np.isin(places[split.test], places[split.train]).mean() > 0.99


def test_the_same_seed_gives_the_same_split_and_another_one_another(plan) -> None:
    ids = [by_position(plan[0], seed=seed).split_id for seed in (1, 1, 2)]
    assert ids[0] == ids[1] != ids[2]


def test_samples_of_one_press_stay_together() -> None:
    press = np.repeat(np.arange(50), 3)
    depth = np.tile([0.0, 1.0, 1.0], 50)
    for part in parts(by_sample(press, depth, seed=1)):
        assert len(part) == 3 * len(np.unique(press[part]))


def test_positions_stated_with_an_error_below_a_nanometre_are_one() -> None:
    assert position_ids(np.array([[1.5, 0.0], [1.5 + 1e-7, -1e-9], [2.25, 0.0]])).tolist() == [0, 0, 1]


def test_random_depths_are_eight_equal_strata() -> None:
    strata = depth_strata(np.random.default_rng(1).uniform(0.25, 2.0, 800))
    assert np.bincount(strata).tolist() == [100] * 8


def test_too_few_presses_are_refused_with_a_sentence() -> None:
    with pytest.raises(DatasetError, match='2 presses or positions are too few'):
        by_sample(np.arange(2), np.ones(2), seed=1)


@given(st.lists(st.integers(1, 50), min_size=1, max_size=8), st.floats(0, 1))
def test_seats_are_all_given_and_none_is_off_by_one(sizes: list[int], share: float) -> None:
    given_sizes = np.array(sizes)
    count = int(share * given_sizes.sum())
    seats = apportioned(given_sizes, count)
    assert seats.sum() == count
    assert (np.abs(seats - given_sizes * count / given_sizes.sum()) < 1).all()
    assert (seats <= given_sizes).all()
