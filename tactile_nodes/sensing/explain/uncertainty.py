"""How the uncertainties that a readout states follow from those of its fit."""

from __future__ import annotations

import math
from dataclasses import dataclass

NOWHERE_MM = 9.2
"""Standard deviation of a place of which nothing is known but that it is on 32 mm of surface: 32 / sqrt(12)."""


@dataclass(frozen=True)
class Calibration:
    """How stated uncertainties follow from the fit's: measured on presses that were held out in training.

    The standard deviation of a place along x or y is hypot(`place_floor_mm`, the fit's) times a factor for how hard the
    press is, that of a force likewise: `place_factors` and `force_factors` stand at equal steps of s, from nothing to
    the hardest press, with straight lines between. `misfit_limit` is the root of the misfit that one of a thousand
    exceeds; `least_gain` what noise alone gains in one of a thousand frames of the untouched gel (see
    `ResponseReadout.gain`).
    """

    place_floor_mm: float = 0.0
    force_floor_n: float = 0.0
    place_factors: tuple[float, ...] = (1.0,)
    force_factors: tuple[float, ...] = (1.0,)
    misfit_limit: float = 1.0
    least_gain: float = 0.0


def factor_at(factors: tuple[float, ...], height: float) -> float:
    """The factor at a share of the hardest press: of (1, 3) it is 2 at a half."""
    along = min(max(height, 0.0), 1.0) * (len(factors) - 1)
    below = min(int(along), max(len(factors) - 2, 0))
    above = min(below + 1, len(factors) - 1)
    return factors[below] + (along - below) * (factors[above] - factors[below])


NOMINAL_FLOOR_N, NOMINAL_SHARE = 0.005, 0.02
"""What a force is usually off by in pictures that are dark, blurred or noisy within reason, too: a blur of 1 px reads
2 % too little."""


def nominal_error_n(stated_n: float, total_n: float) -> float:
    """The nominal error of a total (N), where a readout states so much of presses all over: 11 mN of 0.5 N.

    It is what `ok` is measured by. In sharp, quiet pictures most models are several times better.
    """
    return max(stated_n, math.hypot(NOMINAL_FLOOR_N, NOMINAL_SHARE * total_n))
