"""A correction of contacts by place only: a table over the surface with linear interpolation."""

from __future__ import annotations

import numpy as np

from tactile_nodes.shapes import Float


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
