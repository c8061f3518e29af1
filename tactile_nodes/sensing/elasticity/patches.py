"""The surface patches on which forces are solved: four per bin, 1.78 mm wide on the paper's sensor.

Noise does not allow finer patches: with 5 mpx per region, forces on patches of 1.2 mm are known to 68 mN, on these to
12 mN.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.shapes import Float, Int

PER_BIN = 2


@dataclass(frozen=True)
class PatchGrid:
    """Equal patches over the surface, row by row; index k = row * cols + col as for bins."""

    bins: BinGrid

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns: (18, 18) over the paper's 9x9 bins."""
        return PER_BIN * self.bins.rows, PER_BIN * self.bins.cols

    @property
    def count(self) -> int:
        rows, cols = self.shape
        return rows * cols

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height of a patch: (1.778, 1.778)."""
        width, height = self.bins.bin_size_mm
        return width / PER_BIN, height / PER_BIN

    @cached_property
    def lines_mm(self) -> tuple[Float[np.ndarray, ' cols'], Float[np.ndarray, ' rows']]:
        """Centres along x and along y."""
        (rows, cols), (width, height), (x, y) = self.shape, self.size_mm, self.bins.centre_mm
        return x + (np.arange(cols) - (cols - 1) / 2) * width, y + (np.arange(rows) - (rows - 1) / 2) * height

    @cached_property
    def centres_mm(self) -> Float[np.ndarray, 'patches 2']:
        """Centre of each patch (x, y)."""
        x, y = np.meshgrid(*self.lines_mm)
        return np.stack([x.ravel(), y.ravel()], -1)

    @cached_property
    def bin_of(self) -> Int[np.ndarray, ' patches']:
        """Index of the bin that each patch lies in."""
        (rows, cols), bins = self.shape, self.bins
        number = (np.arange(rows) // PER_BIN)[:, None] * bins.cols + np.arange(cols) // PER_BIN
        return np.asarray(number.ravel())

    @cached_property
    def member(self) -> Float[np.ndarray, 'patches bins']:
        """1 where a patch lies in a bin."""
        return np.asarray(self.bin_of[:, None] == np.arange(self.bins.count), float)

    @cached_property
    def levers(self) -> Float[np.ndarray, '3 patches 6']:
        """Force x, y, z and torque x, y, z [N mm] about the frame's origin of 1 N into the gel, along x, or along y.

        A normal force f at (x, y, 0) is (0, 0, -f), whose moment is (-y f, x f, 0); shear turns about z.
        """
        x, y = self.centres_mm.T
        one, none = np.ones_like(x), np.zeros_like(x)
        rows = (none, none, -one, -y, x, none), (one, none, none, none, none, -y), (none, one, none, none, none, x)
        return np.ascontiguousarray(np.array(rows).transpose(0, 2, 1))

    def over_bins(self, values: Float[np.ndarray, '*shape patches']) -> Float[np.ndarray, '*shape rows cols']:
        """Sums over the patches of each bin."""
        rows, cols = self.bins.rows, self.bins.cols
        split = values.reshape(*values.shape[:-1], rows, PER_BIN, cols, PER_BIN)
        summed: np.ndarray = split.sum(axis=(-3, -1))
        return summed
