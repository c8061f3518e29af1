from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes.sensing import metrics
from tactile_nodes.sensing.geometry import BinGrid


def test_armse_averages_the_errors_of_the_bins():
    true = np.array([[3.0, 0.0], [4.0, 0.0]])
    assert metrics.armse(true, np.zeros((2, 2))) == pytest.approx(np.sqrt(12.5) / 2)


def test_one_bin_to_the_right_is_one_bin_width_of_location_error():
    true, predicted = np.zeros((2, 81)), np.zeros((2, 81))
    true[:, 40] = predicted[0, 40] = predicted[1, 41] = 1.0
    assert metrics.location_error_mm(true, predicted, BinGrid()) == pytest.approx(32 / 9 / 2)


def test_the_strongest_bin_may_be_negative():
    assert metrics.strongest(np.array([[0.5, -0.9, 0.1]])).tolist() == [1]


def test_peaks_are_compared_each_at_its_own_place():
    true = np.array([[1.0, 0.0, 0.0]])
    predicted = np.array([[0.0, 0.0, 0.7]])
    assert metrics.peak_rmse_n(true, predicted) == pytest.approx(0.3)


def test_the_right_bin_is_counted():
    true = np.array([[1.0, 0.0], [0.0, 1.0]])
    predicted = np.array([[0.2, 0.1], [0.2, 0.1]])
    assert metrics.right_bin_share(true, predicted) == 0.5


def test_total_errors_are_predicted_minus_true():
    errors = metrics.total_errors_n(np.array([[1.0, 0.0]]), np.array([[0.5, 0.25]]))
    assert errors.tolist() == [-0.25]


def test_the_interval_of_ninety_per_cent_reaches_1_645_standard_deviations():
    assert metrics.interval_factor() == pytest.approx(1.645, abs=1e-3)


def test_coverage_is_the_share_of_errors_within_their_interval():
    assert metrics.coverage(np.array([1.0, -2.0]), np.ones(2)) == 0.5


def test_normal_errors_are_covered_as_stated():
    sigma = np.random.default_rng(1).uniform(0.5, 5, 20_000)
    errors = np.random.default_rng(2).normal(scale=sigma)
    assert metrics.coverage(errors, sigma) == pytest.approx(0.9, abs=0.01)
    assert metrics.coverage(errors, sigma, 0.5) == pytest.approx(0.5, abs=0.015)


def test_a_model_that_states_no_uncertainty_covers_nothing_that_can_be_stated():
    assert np.isnan(metrics.coverage(np.ones(3), np.full(3, np.nan)))


def test_samples_are_binned_by_what_was_stated():
    sigma, errors = np.array([2.0, 1.0, 2.0, 1.0]), np.array([3.0, 1.0, -4.0, 1.0])
    sure, unsure = metrics.binned_uncertainty(errors, sigma, 2)
    assert (sure.stated, sure.actual, sure.count) == (1.0, 1.0, 2)
    assert (unsure.stated, unsure.actual) == (2.0, pytest.approx(np.sqrt(12.5)))
