"""Scores of a network in training, and whether it gives any answer at all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_nodes.sensing import metrics
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.shapes import Float32

SILENT_SHARE = 0.2
"""Mean predicted peaks below this share of the true ones count as no answer."""


@dataclass(frozen=True)
class Validation:
    """Scores on samples that the network does not learn from.

    `peak_share` is the mean predicted peak over the mean true one. `of_zero` is the RMS error of all bins over that of
    predicting zero.
    """

    armse_n: float
    rmse_mc_n: float
    d_loc_mm: float
    total_rmse_n: float
    right_bin: float
    peak_share: float
    of_zero: float

    @property
    def silent(self) -> bool:
        """Whether the network still gives the all-zero answer that sparse labels reward, or a worse one."""
        return self.peak_share < SILENT_SHARE or self.of_zero >= 1.0

    @classmethod
    def of(
        cls,
        true_n: Float32[np.ndarray, 'samples bins'],
        predicted_n: Float32[np.ndarray, 'samples bins'],
        bins: BinGrid,
    ) -> Validation:
        """Scores; place and peak are evaluated on samples with a force only."""
        touched = np.abs(true_n).max(axis=1) > 0
        chosen = touched if touched.any() else ~touched
        true, predicted = true_n[chosen], predicted_n[chosen]
        peak_n = max(float(true.max(axis=1).mean()), 1e-12)
        error, zero = float(np.square(predicted_n - true_n).mean()), float(np.square(true_n).mean())
        return cls(
            armse_n=metrics.armse(true_n, predicted_n),
            rmse_mc_n=metrics.peak_rmse_n(true, predicted),
            d_loc_mm=metrics.location_error_mm(true, predicted, bins),
            total_rmse_n=float(np.sqrt(np.mean(metrics.total_errors_n(true_n, predicted_n) ** 2))),
            right_bin=metrics.right_bin_share(true, predicted),
            peak_share=float(predicted.max(axis=1).mean()) / peak_n,
            of_zero=(error / max(zero, 1e-12)) ** 0.5,
        )

    def __str__(self) -> str:
        silent = '  (still the all-zero answer)' if self.silent else ''
        return (
            f'held out: aRMSE {self.armse_n:.4f} N  RMSE_mc {self.rmse_mc_n:.4f} N  d_loc {self.d_loc_mm:.3f} mm  '
            f'right bin {self.right_bin:.1%}{silent}'
        )
