"""Cubics that rise where their samples rise."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from tactile_nodes.simulation.monotone import monotone_cubic

RANDOM = np.random.default_rng(7)


@pytest.mark.parametrize('samples', [3, 4, 20])
def test_the_cubics_are_those_of_scipy(samples: int) -> None:
    x = np.cumsum(RANDOM.uniform(0.05, 1.0, samples))
    y = RANDOM.normal(size=(samples, 30, 2))
    y[:, :10] = np.cumsum(np.abs(y[:, :10]), axis=0)
    y[:, 10] = 2.0
    at = np.linspace(x[0], x[-1], 97)
    np.testing.assert_allclose(monotone_cubic(x, y, at), PchipInterpolator(x, y)(at), rtol=0, atol=1e-12)


def test_samples_on_a_line_stay_on_it() -> None:
    x, at = np.array([0.0, 0.1, 0.5, 2.0]), np.linspace(0.0, 2.0, 11)
    np.testing.assert_allclose(monotone_cubic(x, 3 * x + 1, at), 3 * at + 1, rtol=1e-12)
