"""Stated uncertainties: factors that hold 90 % of the errors at every force, limits that one of a thousand exceeds."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from responding_gel import CONFIG, presses

from tactile_nodes.learning.coverage import to_coverage
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.measured.calibration import (
    LEAST_JUDGES,
    MOST_PRESSES,
    _factors,
    _likeness,
    _thinned,
    calibrated,
    rescaled,
    spread_of,
)
from tactile_nodes.learning.measured.fit import fit_response
from tactile_nodes.learning.progress import Progress
from tactile_nodes.sensing.explain.likeness import Likeness
from tactile_nodes.sensing.explain.measured.readout import ResponseReadout
from tactile_nodes.sensing.explain.uncertainty import factor_at
from tactile_nodes.sensing.geometry import BinGrid

LIKENESS = Likeness(np.zeros(4, np.float32), np.eye(2, 4, dtype=np.float32), 1.0, 1.0)


@pytest.fixture(scope='module')
def readout() -> ResponseReadout:
    config = dataclasses.replace(CONFIG, smoothing=(1e-3,))
    return fit_response(presses(500, seed=1), np.zeros(500, bool), config, BinGrid(), Progress())


@pytest.fixture(scope='module')
def judges() -> Dataset:
    return presses(240, seed=3)


def test_normal_errors_need_no_factor() -> None:
    errors = np.random.default_rng(0).normal(size=20000)
    # The density of |error| at its 90th percentile is 0.206, so it is known to 0.3 / 0.206 / 1.645 / sqrt(20000).
    assert to_coverage(errors, np.ones(20000)) == pytest.approx(1.0, abs=4 * 0.0063)
    assert to_coverage(3 * errors, np.ones(20000)) == pytest.approx(3.0, abs=12 * 0.0063)


def test_factors_follow_errors_that_grow_with_the_force() -> None:
    random = np.random.default_rng(1)
    heights = random.uniform(0, 1, 9000)
    factors = _factors(np.abs(random.normal(size=9000)) * (1 + 2 * heights), heights)
    # Of the ends the nearest ninth lies to one side, where the growth is 1/18 away in the mean.
    assert [factor_at(factors, each) for each in (0.25, 0.5, 0.75)] == pytest.approx([1.5, 2.0, 2.5], rel=0.12)
    assert factors[0] == pytest.approx(1 + 2 / 18, rel=0.12)
    assert factors[-1] == pytest.approx(3 - 2 / 18, rel=0.12)


def test_a_floor_is_found_where_errors_do_not_follow_the_fits() -> None:
    """Errors of 0.1 throughout, though the fit states anything between 0.001 and 0.05."""
    random = np.random.default_rng(2)
    sigmas, heights = random.uniform(0.001, 0.05, 6000), random.uniform(0, 1, 6000)
    errors = 0.1 * random.normal(size=6000)
    floor, factors = spread_of(errors, sigmas, heights)
    stated = np.hypot(floor, sigmas) * [factor_at(factors, each) for each in heights]
    assert floor > 0.05
    for who in (sigmas < 0.01, sigmas > 0.04):
        assert np.mean(np.abs(errors[who]) < 1.645 * stated[who]) == pytest.approx(0.9, abs=0.03)


def test_no_floor_is_found_where_the_fits_are_right() -> None:
    random = np.random.default_rng(3)
    sigmas, heights = np.exp(random.uniform(-5, 0, 6000)), random.uniform(0, 1, 6000)
    floor, factors = spread_of(sigmas * random.normal(size=6000), sigmas, heights)
    assert floor < 0.005
    assert factors == pytest.approx([1.0] * len(factors), abs=0.15)


def test_limits_of_likeness_hold_all_but_one_of_a_thousand() -> None:
    random = np.random.default_rng(4)
    size = np.concatenate([np.full(3000, 1.0), random.uniform(2, 50, 5000)])
    left = np.abs(random.normal(1, 0.2, 8000)) + 0.1 * size * (size > 1)
    limits = _likeness(LIKENESS, np.column_stack([left, size]), size > 1)
    over = left > limits.floor + limits.share * size
    assert over.mean() == pytest.approx(0.001, abs=0.0006)


def test_directions_that_explain_everything_still_leave_a_limit() -> None:
    limits = _likeness(LIKENESS, np.column_stack([np.zeros(50), np.full(50, 3.0)]), np.arange(50) > 25)
    assert limits.floor > 0


def test_without_frames_at_rest_the_stillest_set_the_floor() -> None:
    size = np.arange(1.0, 101.0)
    limits = _likeness(LIKENESS, np.column_stack([0.01 * size, size]), np.ones(100, bool))
    assert limits.floor == pytest.approx(0.1, rel=0.1)  # what the tenth of a hundred leaves over


@pytest.mark.parametrize(('count', 'kept'), [(5, 5), (2000, 2000), (2001, 1001), (3999, 2000), (4001, 1334)])
def test_no_more_presses_judge_than_needed(count: int, kept: int) -> None:
    assert len(_thinned(np.arange(count))) == kept <= MOST_PRESSES


def test_stated_errors_are_scaled_to_presses_that_the_final_fit_did_not_see(
    readout: ResponseReadout, judges: Dataset
) -> None:
    halved = dataclasses.replace(
        readout.calibration,
        place_factors=tuple(each / 2 for each in readout.calibration.place_factors),
        force_factors=tuple(each / 4 for each in readout.calibration.force_factors),
    )
    right = rescaled(readout, judges, np.arange(240))
    again = rescaled(dataclasses.replace(readout, calibration=halved), judges, np.arange(240))
    assert again.place_factors == pytest.approx(right.place_factors)
    assert again.force_factors == pytest.approx(right.force_factors)


def test_with_few_new_presses_nothing_is_scaled(readout: ResponseReadout, judges: Dataset) -> None:
    few = np.flatnonzero(judges.presses[:, 2] > 0)[: LEAST_JUDGES - 1]
    assert rescaled(readout, judges, few) is readout.calibration


def test_a_frame_without_regions_does_not_judge(readout: ResponseReadout, judges: Dataset) -> None:
    confidence = np.concatenate([judges.confidence, np.zeros((1, 6, 6), np.float32)])
    dark = judges.rest.copy()
    dark[7] = 1
    with_dark = dataclasses.replace(judges, confidence=confidence, rest=dark)
    without = np.delete(np.arange(240), 7)
    assert calibrated(readout, with_dark, np.arange(240))[0] == calibrated(readout, judges, without)[0]


def test_what_noise_gains_at_rest_is_no_contact(readout: ResponseReadout, judges: Dataset) -> None:
    calibration, _ = calibrated(readout, judges, np.arange(240))
    still = np.flatnonzero(judges.presses[:, 2] < 0)
    seen = [readout.observed(judges.features[i].astype(np.float32), judges.confidence[0]) for i in still]
    components = [readout.whitening @ each.scores for each in seen]
    gains = [readout.gain(each, readout.fit(each)) for each in components]
    assert np.sort(gains)[-2] < calibration.least_gain <= max(gains)
