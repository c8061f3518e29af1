"""The smooth error over the surface that remains of an axisymmetric readout, as a polynomial and a table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_nodes.shapes import Float


@dataclass(frozen=True)
class Correction:
    """Polynomials in a contact's place and force that are added to it: x, y [mm], and a share of the force.

    They have degree four in x and y, and degree two in products with the force. `reach_mm` and `hardest_n` are the
    units, in distances and forces of the gel that they were measured on. Places outside are clamped. `local` is added
    afterwards, by place only: a table of x, y and share from minus to plus the reach.
    """

    terms: Float[np.ndarray, 'terms 3']
    reach_mm: float
    hardest_n: float
    local: Float[np.ndarray, 'rows cols 3'] | None = None

    @classmethod
    def none(cls, reach_mm: float, hardest_n: float) -> Correction:
        """A correction that adds nothing."""
        return cls(np.zeros((cls.powers(np.zeros((1, 3)), 1.0, 1.0).shape[1], 3)), reach_mm, hardest_n)

    @staticmethod
    def powers(contacts: Float[np.ndarray, 'n 3'], reach_mm: float, hardest_n: float) -> Float[np.ndarray, 'n terms']:
        """The monomials of the terms."""
        x, y = np.clip(contacts[:, :2] / reach_mm, -1.0, 1.0).T
        height = contacts[:, 2] / hardest_n - 0.5
        low = [np.ones_like(x), x, y, x * x, x * y, y * y]
        high = [x**3, x * x * y, x * y * y, y**3, x**4, x * x * y * y, y**4]
        return np.stack([*low, *high, *(each * height for each in low)], axis=1)

    def __call__(self, contacts: Float[np.ndarray, 'n 3']) -> Float[np.ndarray, 'n 3']:
        added = self.powers(contacts, self.reach_mm, self.hardest_n) @ self.terms
        added[:, 2] *= contacts[:, 2]
        corrected: np.ndarray = contacts + added
        if self.local is not None:
            further = between(self.local, corrected[:, :2] / self.reach_mm)
            further[:, 2] *= corrected[:, 2]
            corrected += further
        return corrected


def between(
    table: Float[np.ndarray, 'rows cols values'], places: Float[np.ndarray, 'n 2']
) -> Float[np.ndarray, 'n values']:
    """The values at places, x and y from -1 (first column and row) to 1 (last ones). Places outside are clamped."""
    rows, cols = table.shape[:2]
    x, y = ((np.clip(places, -1.0, 1.0) + 1) / 2 * np.array([cols - 1, rows - 1])).T
    col, row = (np.minimum(each.astype(int), count - 2) for each, count in ((x, cols), (y, rows)))
    right, down = (x - col)[:, None], (y - row)[:, None]
    above = (1 - right) * table[row, col] + right * table[row, col + 1]
    below = (1 - right) * table[row + 1, col] + right * table[row + 1, col + 1]
    values: np.ndarray = (1 - down) * above + down * below
    return values
