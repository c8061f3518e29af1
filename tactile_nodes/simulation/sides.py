"""Displacements of markers that the sides of a gel add under forces on its surface, by finite elements."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import lru_cache

import numpy as np

from tactile_nodes.sensing.elasticity.sides import BlockPair, seen
from tactile_nodes.sensing.elasticity.stack import Elastic
from tactile_nodes.shapes import Float, Float32
from tactile_nodes.simulation.gel import Gel

KEPT = 4

Forces = tuple[Float[np.ndarray, 'forces 2'], Float[np.ndarray, 'forces 3 loads']]
"""Places on the surface [mm], and forces there [N] along x, along y and out of the gel."""

FINER = 1.2
"""The elements are smaller by this than those that a calibration uses."""


class MovedBySides:
    """The markers of a gel with sides, and how much further they move by them."""

    def __init__(self, gel: Gel, points_mm: Float32[np.ndarray, 'points 3']) -> None:
        self._pair = _pair(
            Elastic(gel.layer_mm, gel.shear_modulus_mpa, gel.poisson_ratio), gel.sides_mm, gel.sides == 'held'
        )
        levers = np.broadcast_to(np.eye(3), (len(points_mm), 1, 3, 3))
        self._kept = dict[Hashable, np.ndarray]()
        self._at = seen(self._pair.lines_mm, points_mm[:, None].astype(float), levers)

    def moved_mm(self, under: Hashable, forces: Callable[[], Forces]) -> Float32[np.ndarray, 'points 3 loads']:
        """Further displacement of the points under loads; `under` names the forces, the last few are kept."""
        if under not in self._kept:
            while len(self._kept) >= KEPT:
                del self._kept[next(iter(self._kept))]
            loads_n = self._pair.loads_n(*forces())
            moved = (self._at @ self._pair.added_mm(loads_n)).astype(np.float32)
            self._kept[under] = moved.reshape(-1, 3, loads_n.shape[1])
        return self._kept[under]


@lru_cache(maxsize=2)
def _pair(layer: Elastic, size_mm: tuple[float, float], held: bool) -> BlockPair:
    return BlockPair((layer,), size_mm, held=held, finer=FINER)
