"""The prior of calibration errors: what calibrations for other gels get wrong in the same way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_nodes.shapes import Float


@dataclass(frozen=True)
class ErrorPrior:
    """Corrections for calibrations with `presses` presses (increasing), measured on several other gels.

    After few presses regions stay closer to their prior, so the errors depend on the number of presses. `terms` are the
    terms of the correction polynomials.
    """

    presses: tuple[int, ...]
    terms: Float[np.ndarray, 'counts terms 3']

    def after(self, presses: int) -> Float[np.ndarray, 'terms 3']:
        """The terms for a number of presses, interpolated over its logarithm.

        With terms after 10 and 40 presses, 20 presses get the mean of both, and fewer than 10 the terms after 10.
        """
        place = np.interp(np.log(max(presses, 1)), np.log(self.presses), np.arange(len(self.presses)))
        below = min(int(place), max(len(self.presses) - 2, 0))
        above = min(below + 1, len(self.presses) - 1)
        share = place - below
        terms: np.ndarray = (1 - share) * self.terms[below] + share * self.terms[above]
        return terms
