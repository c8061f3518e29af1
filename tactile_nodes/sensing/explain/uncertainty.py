"""Stated uncertainties of a readout, from those of its fit."""

from __future__ import annotations

import math
from dataclasses import dataclass

NOWHERE_MM = 9.2
"""Standard deviation of an unknown place on 32 mm of surface: 32 / sqrt(12)."""


@dataclass(frozen=True)
class Calibration:
    """Calibration of the stated uncertainties, measured on presses that were held out in training.

    The standard deviation of a place along x or y is hypot(`place_floor_mm`, the fit's) times a factor that depends on
    the force, likewise for a force. `place_factors` and `force_factors` are at equal steps of s, from zero to the
    hardest press, with linear interpolation. `misfit_limit` is the square root of the misfit that one in a thousand
    presses exceeds. `least_gain` is the gain that noise alone exceeds in one of a thousand frames of the untouched gel
    (see `ResponseReadout.gain`).
    """

    place_floor_mm: float = 0.0
    force_floor_n: float = 0.0
    place_factors: tuple[float, ...] = (1.0,)
    force_factors: tuple[float, ...] = (1.0,)
    misfit_limit: float = 1.0
    least_gain: float = 0.0


def factor_at(factors: tuple[float, ...], height: float) -> float:
    """The factor at a share of the hardest press: for (1, 3) it is 2 at 0.5."""
    along = min(max(height, 0.0), 1.0) * (len(factors) - 1)
    below = min(int(along), max(len(factors) - 2, 0))
    above = min(below + 1, len(factors) - 1)
    return factors[below] + (along - below) * (factors[above] - factors[below])


NOMINAL_FLOOR_N, NOMINAL_SHARE = 0.005, 0.02
"""Usual error of a force, also in images that are moderately dark, blurred or noisy: with a blur of 1 px a force is
underestimated by 2 %."""


def nominal_error_n(stated_n: float, total_n: float) -> float:
    """The nominal error of a total [N], given the stated uncertainty over all presses: 11 mN for 0.5 N.

    The status `ok` is relative to it. In sharp images with little noise most models are several times better.
    """
    return max(stated_n, math.hypot(NOMINAL_FLOOR_N, NOMINAL_SHARE * total_n))
