"""The learning curve a + b / n^c of a calibration: its error against the number of presses n."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.optimize

from tactile_nodes.shapes import Float

POWERS = tuple(0.25 * step for step in range(1, 9))
"""Exponents that are tried: 0.5 is that of averaged noise, 2 that of a curve that flattens early."""
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
        """The error expected with this number of presses."""
        return float(self.floor + self.gain / presses**self.power)

    def falls(self, presses: float) -> float:
        """The relative decrease of the expected error if the number of presses is doubled."""
        now = self.at(presses)
        return 1 - self.at(2 * presses) / now if now > 0 else 0.0

    @classmethod
    def fit(cls, presses: Sequence[float], errors: Sequence[float]) -> Curve | None:
        """The curve that fits measured errors best; None with fewer than three points.

        Neither the floor nor the gain is negative. Points are weighted by their relative standard error: an error
        measured on n presses is known to 1 / sqrt(2 n).
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
    """Residual norm, floor and gain for one power."""
    design = np.column_stack([np.ones_like(n), n**-power])
    (floor, gain), left = scipy.optimize.nnls(design * weight[:, None], errors * weight)
    return float(left), float(floor), float(gain)
