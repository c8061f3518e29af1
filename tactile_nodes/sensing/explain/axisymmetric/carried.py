"""What calibrations for other gels get wrong alike, so that a new one can be rid of it before anybody sees it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Carried:
    """A correction for calibrations by as many `presses`, which rise, as measured on several other gels.

    After few presses more is drawn towards what is expected of regions, so that what is wrong differs. `terms` are
    those of its polynomials.
    """

    presses: tuple[int, ...]
    terms: Float[np.ndarray, 'counts terms 3']

    def after(self, presses: int) -> Float[np.ndarray, 'terms 3']:
        """The terms for a calibration by so many presses: between those measured by the logarithm of their number.

        With terms after 10 and 40 presses, 20 presses take the mean of both; fewer than 10 those after 10.
        """
        place = np.interp(np.log(max(presses, 1)), np.log(self.presses), np.arange(len(self.presses)))
        below = min(int(place), max(len(self.presses) - 2, 0))
        above = min(below + 1, len(self.presses) - 1)
        share = place - below
        terms: np.ndarray = (1 - share) * self.terms[below] + share * self.terms[above]
        return terms
