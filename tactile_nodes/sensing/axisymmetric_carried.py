"""What calibrations for other gels get wrong alike, so that a new one can be rid of it before anybody sees it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Carried:
    """A correction for calibrations by as many `presses`, which rise, as measured on several other gels.

    After few presses more is drawn towards what is expected of regions, so that what is wrong differs. `terms` are
    those of its polynomials, `local` its table over the surface; files of before have none.
    """

    presses: tuple[int, ...]
    terms: Float[np.ndarray, 'counts terms 3']
    local: Float[np.ndarray, 'counts rows cols 3'] | None = None

    def after(self, presses: int) -> Float[np.ndarray, 'terms 3']:
        """The terms for a calibration by so many presses: between those measured by the logarithm of their number.

        With terms after 10 and 40 presses, 20 presses take the mean of both; fewer than 10 those after 10.
        """
        return self._between(self.terms, presses)

    def local_after(self, presses: int) -> Float[np.ndarray, 'rows cols 3'] | None:
        """The table, likewise."""
        return None if self.local is None else self._between(self.local, presses)

    def _between(self, measured: Float[np.ndarray, 'counts *values 3'], presses: int) -> Float[np.ndarray, '*values 3']:
        place = np.interp(np.log(max(presses, 1)), np.log(self.presses), np.arange(len(self.presses)))
        below = min(int(place), max(len(self.presses) - 2, 0))
        above = min(below + 1, len(self.presses) - 1)
        share = place - below
        values: np.ndarray = (1 - share) * measured[below] + share * measured[above]
        return values
