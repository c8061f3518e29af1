"""The uncertainty of a network's total force, and the novelty of its inputs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactile_nodes.learning.coverage import ONE_OF_A_THOUSAND, to_coverage
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.network.inputs import prepare
from tactile_nodes.sensing.explain.likeness import Likeness
from tactile_nodes.sensing.explain.network import NetworkReadout, TotalSpread
from tactile_nodes.shapes import Float, Float32, Int

SHARES = np.concatenate([[0.0], np.geomspace(0.1, 30.0, 25)])
LEAST_FLOOR_N = 1e-4
DIRECTIONS = 48
ROUNDS = 4
PEAK = 1e-6


def calibrated(
    readout: NetworkReadout,
    dataset: Dataset,
    learned: Int[np.ndarray, ' learned'],
    judges: Int[np.ndarray, ' judges'],
) -> NetworkReadout:
    """The readout with its uncertainty and its novelty limit, both measured on the held-out samples."""
    judged = dataset.take(judges)
    inputs = prepare(judged, readout.scaling)
    predicted_n = np.stack([readout.network(each) for each in inputs]).sum(axis=1) * readout.output_scale_n
    spread = fit_spread(predicted_n, predicted_n - judged.presses[:, 3])
    likeness = fit_likeness(prepare(dataset.take(np.unique(learned)), readout.scaling), inputs)
    return replace(readout, spread=spread, likeness=likeness)


def fit_spread(total_n: Float[np.ndarray, ' n'], error_n: Float[np.ndarray, ' n']) -> TotalSpread:
    """Floor and share: the most probable pair under a Laplace distribution, then scaled to a coverage of 90 %.

    (Errors near the borders of bins are outliers, which would dominate a normal distribution.)
    """
    unit = max(float(np.median(np.abs(error_n))), LEAST_FLOOR_N)
    sigmas = {share: np.hypot(unit, share * unit * total_n) for share in SHARES.tolist()}
    share = min(sigmas, key=lambda each: _surprise(error_n, sigmas[each]))
    scale = to_coverage(error_n, sigmas[share])
    scale = max(scale, LEAST_FLOOR_N / unit)
    return TotalSpread(floor_n=unit * scale, share=share * unit * scale)


def _surprise(error_n: np.ndarray, sigma_n: np.ndarray) -> float:
    """Negative log likelihood of a Laplace distribution of the best common scale."""
    return float(np.mean(np.log(sigma_n)) + np.log(np.mean(np.abs(error_n) / sigma_n) + LEAST_FLOOR_N))


def fit_likeness(
    inputs: Float32[np.ndarray, 'samples inputs'], judges: Float32[np.ndarray, 'judges inputs']
) -> Likeness:
    """Principal directions of the inputs, and the limit on their residuals, measured on the held-out samples."""
    mean = np.asarray(inputs.mean(axis=0), np.float32)
    return fit_limit(Likeness(mean, principal_directions(inputs - mean), 1.0, 0.0), judges)


def fit_limit(likeness: Likeness, judges: Float32[np.ndarray, 'judges inputs']) -> Likeness:
    """The same directions, with the limit on their residuals measured on the held-out samples."""
    left, size = np.array([likeness.left_over(each) for each in judges]).T
    share = max(float(np.polyfit(size, left, 1)[0]), 0.0) if np.ptp(size) > 0 else 0.0
    floor = float(np.percentile(left - share * size, ONE_OF_A_THOUSAND))
    return replace(likeness, floor=max(floor, PEAK), share=share)


def principal_directions(
    centred: Float32[np.ndarray, 'samples inputs'], count: int = DIRECTIONS
) -> Float32[np.ndarray, 'directions inputs']:
    """The directions of the largest variance, by subspace iteration (Halko et al., SIAM Review 53, 2011).

    Of samples along (3, 4) only, the first direction is (0.6, 0.8), or its negative.
    """
    count = min(count, *centred.shape)
    basis = np.random.default_rng(0).normal(size=(centred.shape[1], count)).astype(np.float32)
    for _ in range(ROUNDS):
        basis = np.linalg.qr(centred.T @ (centred @ basis))[0]
    turned = np.linalg.svd(centred @ basis, full_matrices=False)[2]
    return np.ascontiguousarray((basis @ turned.T).T, np.float32)
