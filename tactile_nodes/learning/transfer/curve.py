"""How the error of a calibration falls with the number of presses: a + b / n^c, and whether more presses pay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.optimize
from jaxtyping import Float

POWERS = tuple(0.25 * step for step in range(1, 9))
"""Of the presses: 0.5 is what averages of noise fall with, 2 a curve that bends off at once."""
LEAST_POINTS = 3


@dataclass(frozen=True)
class Curve:
    """The error expected with n presses: floor + gain / n^power, in the unit of the errors that it was fitted to.

    With a floor of 2, a gain of 40 and a power of 1, 20 presses give 4 and 40 presses give 3.
    """

    floor: float
    gain: float
    power: float

    def at(self, presses: float) -> float:
        """The error expected with so many presses."""
        return float(self.floor + self.gain / presses**self.power)

    def falls(self, presses: float) -> float:
        """By which share of itself the error is expected to fall with twice as many presses."""
        now = self.at(presses)
        return 1 - self.at(2 * presses) / now if now > 0 else 0.0

    @classmethod
    def fit(cls, presses: Sequence[float], errors: Sequence[float]) -> Curve | None:
        """The curve that fits measured errors best; None with fewer than three points.

        Neither the floor nor the gain is negative. An error measured on n presses is known to 1 / sqrt(2 n) of itself,
        so that is what a point's deviation is measured by.
        """
        n, measured = np.asarray(presses, float), np.asarray(errors, float)
        if len(n) < LEAST_POINTS or not (measured > 0).all():
            return None
        weight = np.sqrt(2 * n) / measured
        tried = [(*_at_power(n, measured, weight, power), power) for power in POWERS]
        _, floor, gain, power = min(tried, key=lambda each: each[0])
        return cls(floor, gain, power)


def _at_power(
    n: Float[np.ndarray, ' n'], errors: Float[np.ndarray, ' n'], weight: Float[np.ndarray, ' n'], power: float
) -> tuple[float, float, float]:
    """What is left over of the points, floor and gain, for one power."""
    design = np.column_stack([np.ones_like(n), n**-power])
    (floor, gain), left = scipy.optimize.nnls(design * weight[:, None], errors * weight)
    return float(left), float(floor), float(gain)
