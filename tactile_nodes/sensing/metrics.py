"""Figures of merit: the paper's three for force maps, and summaries of latencies."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from tactile_nodes.sensing.geometry import BinGrid


def armse(true_n: Float[np.ndarray, 'samples bins'], predicted_n: Float[np.ndarray, 'samples bins']) -> float:
    """Root mean squared error of each bin over the samples, averaged over the bins (the paper's aRMSE), in N.

    Two bins and two samples, errors (3, 0) and (4, 0): sqrt((9 + 16) / 2) = 3.536 and 0 give 1.768.
    """
    return float(np.sqrt(np.mean((true_n - predicted_n) ** 2, axis=0)).mean())


def location_error_mm(
    true_n: Float[np.ndarray, 'samples bins'], predicted_n: Float[np.ndarray, 'samples bins'], bins: BinGrid
) -> float:
    """Mean distance between the centres of the strongest true and the strongest predicted bin (d_loc), in mm.

    One bin to the right in every sample is 3.556 mm on the paper's grid.
    """
    centres = bins.centres_mm.reshape(-1, 2)
    apart = centres[strongest(true_n)] - centres[strongest(predicted_n)]
    return float(np.hypot(apart[:, 0], apart[:, 1]).mean())


def peak_rmse_n(true_n: Float[np.ndarray, 'samples bins'], predicted_n: Float[np.ndarray, 'samples bins']) -> float:
    """Root mean squared difference of the strongest bins' values, each at its own place (RMSE_mc), in N."""
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


@dataclass(frozen=True)
class LatencySummary:
    """Latencies of one stage in milliseconds; percentiles interpolate linearly between samples."""

    count: int
    p50_ms: float
    p99_ms: float
    largest_ms: float


def summarise_latencies(latencies_ns: Iterable[int]) -> LatencySummary:
    """Median, 99th percentile and maximum: 1, 2 and 3 ms give 2, 2.98 and 3 ms. No sample gives NaN."""
    milliseconds = np.fromiter(latencies_ns, dtype=np.float64) / 1e6
    if not milliseconds.size:
        return LatencySummary(0, float('nan'), float('nan'), float('nan'))
    p50, p99 = np.percentile(milliseconds, [50, 99])
    return LatencySummary(milliseconds.size, float(p50), float(p99), float(milliseconds.max()))
