"""Stated uncertainties of a calibrated model, measured on held-out presses."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from tactile_nodes.learning.axisymmetric.calibration import Judged, least_gain
from tactile_nodes.learning.coverage import COVERAGE, NORMAL_90
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout
from tactile_nodes.sensing.explain.uncertainty import Calibration
from tactile_nodes.shapes import Float

RASTER = 40
NORMAL_50 = 0.6745
"""The share of a standard deviation within which half of normal errors lie."""


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
    nearer = nearer_by(dataset.presses[dataset.presses[:, 2] > 0, :2])
    isolation = nearer_errors(nearer, beyond_noise(held, dataset))
    misfits = [fit.misfit for each in held for fit in each.fits]
    return replace(
        old,
        place_factors=(isolation * cautious(np.abs(errors[:, :2]).reshape(-1) / place, len(errors)) / NORMAL_90,),
        force_factors=(cautious(np.abs(errors[:, 2]) / force, len(errors)) / NORMAL_90,),
        misfit_limit=max(old.misfit_limit, math.sqrt(max(misfits))),
        least_gain=max(old.least_gain, least_gain(readout, dataset, untouched)),
    )


def cautious(ratios: Float[np.ndarray, ' n'], presses: int) -> float:
    """The level that 90 % of further ratios stay below: with 10 presses the largest, with 100 their 0.91 quantile."""
    level = min(1.0, COVERAGE * (1 + 1 / presses))
    return float(np.quantile(ratios, level if presses > 1 / (1 - COVERAGE) else 1.0, method='higher'))


def beyond_noise(held: list[Judged], dataset: Dataset) -> float:
    """The share of the variance of held-out places that the stated noise alone does not explain."""
    sure = [
        Judged.of(replace(each.readout, response=each.readout.response.as_if_sure()), dataset, each.rows)
        for each in held
    ]
    noise_mm = float(np.median(np.concatenate([each.sigmas[:, 0] for each in sure])))
    off_mm = np.median(np.abs(np.concatenate([each.errors[:, :2] for each in held]))) / NORMAL_50
    return max(0.0, 1 - (noise_mm / max(float(off_mm), 1e-9)) ** 2)


def nearer_errors(nearer: float, beyond: float) -> float:
    """The factor by which errors shrink if presses are nearer by the factor `nearer`.

    Only the variance beyond noise (the share `beyond`) shrinks with the distance. Presses twice as near halve it. If
    it is half of the variance, errors are 0.866 times as large.
    """
    return math.sqrt(1 - beyond + beyond * nearer)


def nearer_by(places: Float[np.ndarray, 'n 2']) -> float:
    """Distance of any point to the nearest press, relative to the distance between presses; at most 1.

    Random places are as far from one another as from any other point. Places that were chosen to be far apart are not:
    each of them, if held out, is in the middle of the largest gap, and is estimated less exactly than most points.
    """
    places = np.unique(np.round(places, 1), axis=0)
    if len(places) < 2:
        return 1.0
    tree = cKDTree(places)
    anywhere = np.stack(np.meshgrid(*np.linspace(places.min(0), places.max(0), RASTER).T), axis=-1).reshape(-1, 2)
    to_others = np.median(tree.query(places, k=2)[0][:, 1])
    return float(min(1.0, np.median(tree.query(anywhere)[0]) / to_others))
