"""Motion away from places, as a touch causes it: how much of the motion around each place points away from it."""

from __future__ import annotations

import numpy as np

from tactile_nodes.sensing.compiling import compiled_loops
from tactile_nodes.shapes import Float, Float32

TOUCH_BLOCKS = 0.85
"""Distance at which the markers around a light touch move most, in blocks: 2.9 mm on the paper's gel."""

PLACES_A_BLOCK = 2
"""Candidate places of touches per block along each axis."""


class TouchPlaces:
    """Places all over `count` x `count` blocks, two per block along each axis.

    `texture` is how much each block's picture changes per pixel of motion along each axis. Blocks with more texture
    have more weight. Results are scaled such that independent noise of 1 gives 1. The weight of a block falls off
    separably along both axes, so sums over blocks are sums over columns of sums over rows.
    """

    def __init__(self, count: int, texture: Float[np.ndarray, 'blocks 2']) -> None:
        places = np.arange(-PLACES_A_BLOCK // 2, (count - 1) * PLACES_A_BLOCK + PLACES_A_BLOCK // 2 + 1)
        apart = np.arange(count) - places[:, None] / PLACES_A_BLOCK
        near = np.exp(-0.5 * np.square(apart / TOUCH_BLOCKS))
        self._shape = (count, count, 2)
        weight = (texture / max(float(texture.mean()), 1e-9)).reshape(self._shape)
        # Columns decide whether motion along x points away, rows for motion along y; the other axis adds only distance.
        rows, columns = np.stack([near, apart * near]), np.stack([apart * near, near])
        squares = np.einsum('kpr,rck,kqc->pq', rows**2, weight**2, columns**2)
        self._weight, self._rows = weight.astype(np.float32), rows.astype(np.float32)
        self._columns = np.ascontiguousarray(columns.transpose(0, 2, 1), np.float32)
        self._scale = np.ascontiguousarray(1 / np.maximum(np.sqrt(squares), 1e-9), np.float32)

    def away(self, motion: Float32[np.ndarray, 'blocks 2']) -> Float32[np.ndarray, 'places places']:
        """How much of the blocks' motion points away from each place (negative: towards it), by rows of places."""
        weighted = (motion.reshape(self._shape) * self._weight).transpose(2, 0, 1)
        along_x, along_y = self._rows @ weighted @ self._columns
        away: np.ndarray = (along_x + along_y) * self._scale
        return away

    def most(self, motion: Float32[np.ndarray, 'blocks 2'], *, compiled: bool = False) -> float:
        """The largest motion away from, or towards, any place."""
        if compiled:
            motion = np.ascontiguousarray(motion, np.float32)
            return float(compiled_loops().most_away(motion, self._weight, self._rows, self._columns, self._scale))
        away = self.away(motion)
        return float(max(away.max(), -away.min()))
