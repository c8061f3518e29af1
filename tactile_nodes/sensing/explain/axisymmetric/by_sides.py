"""Motion that the sides of a gel add to its response to a tip: it depends on the place, unlike the response itself."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tactile_nodes.sensing.compiling import compiled_loops
from tactile_nodes.sensing.elasticity.patches import PatchGrid
from tactile_nodes.shapes import Float, Float32, Int


@dataclass(frozen=True)
class BySides:
    """Motion [px] of the regions that sides add per newton of a tip in the middle of each patch, linear between them.

    Beyond the outermost middles it is that at these. See `tactile_nodes.sensing.elasticity.sides`.
    """

    patches: PatchGrid
    per_n: Float32[np.ndarray, 'patches regions 2']

    def of_regions(self, chosen: Int[np.ndarray, ' chosen']) -> BySides:
        """The same of some regions."""
        return replace(self, per_n=self.per_n[:, chosen])

    def motion_and_slopes(
        self, contacts: Float[np.ndarray, 'n 3']
    ) -> tuple[Float[np.ndarray, 'n regions 2'], Float[np.ndarray, '3 n regions 2']]:
        """Motion under contacts (x, y in mm and force in N), and its derivatives by them."""
        corner, right, down = self._cells(contacts)
        cols = self.patches.shape[1]
        force, (width, height) = contacts[:, 2, None, None], self.patches.size_mm
        here, beside, below, across = (self.per_n[corner + step] for step in (0, 1, cols, cols + 1))
        upper, lower = here + right * (beside - here), below + right * (across - below)
        per_n = upper + down * (lower - upper)
        along_x = (beside - here + down * (across - below - beside + here)) / width
        along_y = (lower - upper) / height
        return force * per_n, np.stack([force * along_x, force * along_y, per_n])

    def add_by_loops(
        self,
        contacts: Float[np.ndarray, 'n 3'],
        motion: Float[np.ndarray, 'n regions 2'],
        slopes: Float[np.ndarray, '3 n regions 2'],
    ) -> None:
        """Add both in place, compiled."""
        compiled_loops().add_by_sides(
            np.ascontiguousarray(contacts, float), np.ascontiguousarray(self.per_n), self._grid, motion, slopes
        )

    @cached_property
    def _grid(self) -> Float[np.ndarray, '2 3']:
        """The first middle of a patch, the size of a patch and the number of patches, along x and along y."""
        lines, sizes = self.patches.lines_mm, self.patches.size_mm
        return np.array([[line[0], size, len(line)] for line, size in zip(lines, sizes, strict=True)])

    def _cells(self, contacts: Float[np.ndarray, 'n 3']) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The patch at the upper left of each contact, and the shares of the way to the next ones."""
        found = []
        for axis, (line, size) in enumerate(zip(self.patches.lines_mm, self.patches.size_mm, strict=True)):
            steps = np.clip((contacts[:, axis] - line[0]) / size, 0.0, len(line) - 1.0)
            low = np.minimum(steps.astype(int), len(line) - 2)
            found.append((low, (steps - low)[:, None, None]))
        (x, right), (y, down) = found
        return y * self.patches.shape[1] + x, right, down
