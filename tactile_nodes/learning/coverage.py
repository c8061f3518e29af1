"""Calibrated uncertainty: 90 % of the errors lie within 1.645 standard deviations to either side."""

from __future__ import annotations

import numpy as np

from tactile_nodes.shapes import Float

COVERAGE = 0.90
NORMAL_90 = 1.6449
"""Number of standard deviations to either side that hold 90 % of a normal distribution."""
ONE_OF_A_THOUSAND = 99.9
"""The percentile at which limits are set."""


def to_coverage(errors: Float[np.ndarray, ' n'], sigmas: Float[np.ndarray, ' n']) -> float:
    """The factor by which standard deviations must be multiplied to hold 90 % of the errors."""
    return float(np.percentile(np.abs(errors) / sigmas, 100 * COVERAGE)) / NORMAL_90
