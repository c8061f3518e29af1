"""The curve of error over presses: found again where it is known, and never bent upwards."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes.learning.calibrating.calibrator import Curve

PRESSES = [5, 10, 20, 40, 80]


def test_a_known_curve_is_found_again() -> None:
    """2 + 40 / n: 4 with 20 presses, 2.5 with 80."""
    found = Curve.fit(PRESSES, [2 + 40 / n for n in PRESSES])
    assert found is not None
    assert (found.floor, found.gain, found.power) == pytest.approx((2.0, 40.0, 1.0))
    assert found.at(160) == pytest.approx(2.25)


def test_errors_that_fall_with_the_root_fall_by_a_third_when_presses_double() -> None:
    """1 - 1 / sqrt(2) = 0.293, at any number."""
    found = Curve.fit(PRESSES, [10 / n**0.5 for n in PRESSES])
    assert found is not None
    assert found.falls(100) == pytest.approx(1 - 0.5**0.5)
    assert found.falls(7) == pytest.approx(1 - 0.5**0.5)


def test_errors_that_stay_are_expected_to_stay() -> None:
    found = Curve.fit(PRESSES, [3.0, 3.1, 2.9, 3.0, 3.0])
    assert found is not None
    assert found.falls(80) < 0.03


def test_errors_that_grow_are_not_expected_to_fall() -> None:
    found = Curve.fit(PRESSES, [2.0, 2.5, 3.0, 3.5, 4.0])
    assert found is not None
    assert found.falls(80) == pytest.approx(0.0, abs=1e-9)


def test_noise_of_an_error_known_to_its_number_of_presses_moves_the_forecast_by_as_much() -> None:
    """Each point is off by 1 / sqrt(2 n) of itself; the forecast for 160 presses, 2.25, stays within a fifth."""
    random = np.random.default_rng(1)
    clean = np.array([2 + 40 / n for n in PRESSES])
    made = [Curve.fit(PRESSES, clean * (1 + random.normal(size=5) / np.sqrt(2 * np.array(PRESSES)))) for _ in range(50)]
    expected = np.array([each.at(160) for each in made if each is not None])
    assert np.quantile(np.abs(expected / 2.25 - 1), 0.8) < 0.2


def test_two_points_make_no_curve() -> None:
    assert Curve.fit([5, 10], [3.0, 2.0]) is None
