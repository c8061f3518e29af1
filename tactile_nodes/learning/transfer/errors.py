"""Errors on held-out presses, before and after a calibration."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import numpy as np

from tactile_nodes.shapes import Float


@dataclass(frozen=True)
class Errors:
    """Errors on held-out presses: RMS and median of the force error, median distance of the place.

    Errors that are unknown are NaN.
    """

    force_rmse_n: float
    force_median_n: float
    place_median_mm: float

    @classmethod
    def of(cls, errors: Float[np.ndarray, 'n 3']) -> Errors:
        """From errors of x, y (mm) and force (N); NaN is ignored."""
        away = np.hypot(errors[:, 0], errors[:, 1])
        off, away = np.abs(errors[np.isfinite(errors[:, 2]), 2]), away[np.isfinite(away)]
        force = (float(np.sqrt(np.mean(off**2))), float(np.median(off))) if len(off) else (math.nan, math.nan)
        return cls(*force, float(np.median(away)) if len(away) else math.nan)

    def as_dict(self) -> dict[str, float | None]:
        """For the model card; NaN becomes None, since JSON has no NaN."""
        return {name: value if math.isfinite(value) else None for name, value in asdict(self).items()}


UNKNOWN = Errors(math.nan, math.nan, math.nan)


@dataclass(frozen=True)
class Point:
    """Errors on held-out presses for fits with this number of presses, and the form chosen most often."""

    presses: int
    form: str
    errors: Errors
