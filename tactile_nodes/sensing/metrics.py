"""Metrics: the paper's three for force maps, and the calibration of stated uncertainties."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.shapes import Float


def armse(true_n: Float[np.ndarray, 'samples bins'], predicted_n: Float[np.ndarray, 'samples bins']) -> float:
    """Root mean squared error of each bin over the samples, averaged over the bins (the paper's aRMSE), in N.

    For two bins and two samples with errors (3, 0) and (4, 0), sqrt((9 + 16) / 2) = 3.536 and 0 give 1.768.
    """
    return float(np.sqrt(np.mean((true_n - predicted_n) ** 2, axis=0)).mean())


def location_error_mm(
    true_n: Float[np.ndarray, 'samples bins'], predicted_n: Float[np.ndarray, 'samples bins'], bins: BinGrid
) -> float:
    """Mean distance between the centres of the strongest true and the strongest predicted bin (d_loc), in mm.

    A prediction one bin to the right in every sample gives 3.556 mm on the paper's grid.
    """
    centres = bins.centres_mm.reshape(-1, 2)
    apart = centres[strongest(true_n)] - centres[strongest(predicted_n)]
    return float(np.hypot(apart[:, 0], apart[:, 1]).mean())


def peak_rmse_n(true_n: Float[np.ndarray, 'samples bins'], predicted_n: Float[np.ndarray, 'samples bins']) -> float:
    """Root mean squared difference of the strongest true and the strongest predicted bin's force (RMSE_mc), in N."""
    rows = np.arange(len(true_n))
    difference = true_n[rows, strongest(true_n)] - predicted_n[rows, strongest(predicted_n)]
    return float(np.sqrt(np.mean(difference**2)))


def strongest(forces_n: Float[np.ndarray, 'samples bins']) -> np.ndarray:
    """Index of the bin with the largest absolute force in each sample."""
    best: np.ndarray = np.abs(forces_n).argmax(axis=1)
    return best


def right_bin_share(true_n: Float[np.ndarray, 'samples bins'], predicted_n: Float[np.ndarray, 'samples bins']) -> float:
    """Share of the samples whose strongest predicted bin is the true one."""
    return float((strongest(true_n) == strongest(predicted_n)).mean())


def total_errors_n(
    true_n: Float[np.ndarray, 'samples bins'], predicted_n: Float[np.ndarray, 'samples bins']
) -> Float[np.ndarray, ' samples']:
    """Predicted minus true total force of each sample."""
    errors: np.ndarray = predicted_n.sum(axis=1) - true_n.sum(axis=1)
    return errors


INTERVAL = 0.9
"""The confidence level at which stated uncertainties are checked."""


def interval_factor(level: float = INTERVAL) -> float:
    """Half width, in standard deviations, of the central interval of a normal distribution: 1.645 for 90 %."""
    return NormalDist().inv_cdf((1 + level) / 2)


def coverage(
    errors: Float[np.ndarray, '*samples'], sigma: Float[np.ndarray, '*samples'], level: float = INTERVAL
) -> float:
    """Share of errors within the interval of their standard deviations. NaN if any of those is NaN.

    For errors 1 and 2 with a standard deviation of 1 each, the 90 % interval of 1.645 contains one of two, so 0.5.
    """
    if not errors.size or np.isnan(sigma).any():
        return float('nan')
    return float((np.abs(errors) <= interval_factor(level) * sigma).mean())


@dataclass(frozen=True)
class UncertaintyBin:
    """Samples of similar stated uncertainty: root mean square of the stated and of the actual errors."""

    count: int
    stated: float
    actual: float


def binned_uncertainty(
    errors: Float[np.ndarray, ' samples'], sigma: Float[np.ndarray, ' samples'], bins: int = 10
) -> list[UncertaintyBin]:
    """Stated and actual errors in bins of equally many samples, from the smallest to the largest uncertainty."""
    order = np.argsort(sigma, kind='stable')
    parts = [part for part in np.array_split(order, bins) if len(part)]
    return [UncertaintyBin(len(part), root_mean_square(sigma[part]), root_mean_square(errors[part])) for part in parts]


def root_mean_square(values: Float[np.ndarray, '*samples']) -> float:
    """Root mean square: 3.536 for 3 and 4. NaN without values."""
    return float(np.sqrt(np.mean(np.square(values)))) if np.size(values) else float('nan')


def pareto_front(costs: Sequence[float], errors: Sequence[float]) -> list[int]:
    """Indices of the Pareto front of cost and error, from the cheapest to the most accurate.

    For costs 1, 2, 3 and errors 5, 6, 4 the second is dearer and worse than the first, so 0 and 2 remain. Of equal
    entries the first remains. NaN is never on the front.
    """
    front: list[int] = []
    least = float('inf')
    for place in sorted(range(len(costs)), key=lambda each: (costs[each], errors[each])):
        if errors[place] < least and costs[place] < float('inf'):
            least = errors[place]
            front.append(place)
    return front
