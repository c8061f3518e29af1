"""Stated uncertainties of a calibrated model, measured on held-out presses."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tactile_nodes.learning.axisymmetric.calibration import Judged, least_gain
from tactile_nodes.learning.coverage import COVERAGE, NORMAL_90
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout
from tactile_nodes.sensing.explain.uncertainty import Calibration
from tactile_nodes.shapes import Float


def calibration_of(
    readout: AxisymmetricReadout, held: list[Judged], dataset: Dataset, untouched: np.ndarray
) -> Calibration:
    """Stated uncertainties that cover nine of ten held-out presses, and rather more if presses are few.

    `readout` still has the calibration of its source. The floors and limits of that calibration are never lowered.
    """
    old = readout.calibration
    errors, sigmas = (np.concatenate([getattr(each, name) for each in held]) for name in ('errors', 'sigmas'))
    place = np.hypot(old.place_floor_mm, np.repeat(sigmas[:, 0], 2))
    force = np.hypot(old.force_floor_n, sigmas[:, 1])
    misfits = [fit.misfit for each in held for fit in each.fits]
    return replace(
        old,
        place_factors=(cautious(np.abs(errors[:, :2]).reshape(-1) / place, len(errors)) / NORMAL_90,),
        force_factors=(cautious(np.abs(errors[:, 2]) / force, len(errors)) / NORMAL_90,),
        misfit_limit=max(old.misfit_limit, math.sqrt(max(misfits))),
        least_gain=max(old.least_gain, least_gain(readout, dataset, untouched)),
    )


def cautious(ratios: Float[np.ndarray, ' n'], presses: int) -> float:
    """The level that 90 % of further ratios stay below: with 10 presses the largest, with 100 their 0.91 quantile."""
    level = min(1.0, COVERAGE * (1 + 1 / presses))
    return float(np.quantile(ratios, level if presses > 1 / (1 - COVERAGE) else 1.0, method='higher'))
