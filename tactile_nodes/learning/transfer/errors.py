"""How far off held-out presses are read, before a calibration and with it."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Errors:
    """Of held-out presses: root mean square and median of the force's error, median distance of the place.

    NaN of none that is known.
    """

    force_rmse_n: float
    force_median_n: float
    place_median_mm: float

    @classmethod
    def of(cls, errors: Float[np.ndarray, 'n 3']) -> Errors:
        """Of x, y (mm) and force (N); NaN counts for none."""
        away = np.hypot(errors[:, 0], errors[:, 1])
        off, away = np.abs(errors[np.isfinite(errors[:, 2]), 2]), away[np.isfinite(away)]
        force = (float(np.sqrt(np.mean(off**2))), float(np.median(off))) if len(off) else (math.nan, math.nan)
        return cls(*force, float(np.median(away)) if len(away) else math.nan)

    def as_dict(self) -> dict[str, float | None]:
        """For a model's card; JSON knows no NaN."""
        return {name: value if math.isfinite(value) else None for name, value in asdict(self).items()}


UNKNOWN = Errors(math.nan, math.nan, math.nan)


@dataclass(frozen=True)
class Point:
    """What held-out presses are read off by, with so many presses for each fit, and the form that most of them took."""

    presses: int
    form: str
    errors: Errors
