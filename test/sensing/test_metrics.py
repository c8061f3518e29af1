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


def test_latencies_are_summarised_in_milliseconds():
    summary = metrics.summarise_latencies([1_000_000, 2_000_000, 3_000_000])
    assert (summary.count, summary.p50_ms, summary.largest_ms) == (3, 2.0, 3.0)
    assert summary.p99_ms == pytest.approx(2.98)


def test_no_latencies_have_no_summary():
    assert np.isnan(metrics.summarise_latencies([]).p50_ms)
