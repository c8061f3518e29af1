"""The bench of described sensors in disturbed pictures: presses, sums, and what it calls not reached."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks import sensors_disturbed as bench
from tactile_nodes.messages import types
from tactile_nodes.sensors import load_sensor


def told(total: float, true_n: float, sigma: float = 0.1) -> bench.Told:
    return bench.Told(types.ForceDistribution(total=total, total_sigma=sigma), true_n)


def test_presses_lie_on_the_gel_and_are_the_same_each_time() -> None:
    sensor = load_sensor('digit_like')
    presses = bench._presses(sensor, 50, 1)
    assert presses == bench._presses(sensor, 50, 1)
    assert max(abs(each.x_mm) for each in presses) <= sensor.gel.width_mm / 2 - bench.RIM_MM
    assert max(abs(each.y_mm) for each in presses) <= sensor.gel.height_mm / 2 - bench.RIM_MM
    assert np.ptp([each.y_mm for each in presses]) > sensor.gel.height_mm / 2


def test_false_forces_errors_intervals_and_frames_without_a_force_are_counted() -> None:
    """Off by 0.1, 0.3 and 0.2 N of 1 N; 0.1 N of standard deviation holds 0.16 N."""
    summed = bench._summed(
        [told(0.0, 0.0), told(1.1, 1.0), told(0.03, 0.0), told(0.7, 1.0), told(math.nan, 0.0), told(math.nan, 1.0),
         told(0.8, 1.0)]
    )  # fmt: skip
    assert summed == pytest.approx({'false_n': 0.03, 'error': 0.2, 'covered': 1 / 3, 'invalid': 1 / 4})


def test_the_worst_disturbance_of_each_sensor_is_named() -> None:
    good = {'false_n': 0.0, 'error': 0.1}
    found = {'undisturbed': good, 'knocked by 3 px': {'false_n': 0.5, 'error': 0.14}, 'blur 1 px': good}
    result = {'sensors': {'dots': found, 'still': {'undisturbed': good, 'blur 1 px': {'false_n': 0.01, 'error': 0.2}}}}
    false, error = (aim.reached(result) for aim in bench.AIMS)
    assert false == {'dots': '0.500 N, knocked by 3 px, **not reached**', 'still': '0.010 N, blur 1 px'}
    assert error == {'dots': '14 %, knocked by 3 px', 'still': '20 %, blur 1 px, **not reached**'}
