"""Present places of the forces of a field: shear moves the surface, and the forces with it.

The response is that of the gel at rest. If the surface has moved 1 mm sideways, a force on it appears 0.6 mm sideways:
the markers lie below the surface and moved less. So each force is shifted further by a share of the surface's motion
under all shear, computed with the linear layer.
"""

from __future__ import annotations

import cv2
import numpy as np

from tactile_nodes.sensing.elasticity.patches import PatchGrid
from tactile_nodes.shapes import Float, Float32, Int

HIDDEN = 0.45
"""Additional shift of a force, over the motion of the surface in the linear layer."""


def moved_along(
    forces_n: Float[np.ndarray, '3 patches'], surface: Float32[np.ndarray, '2 near near'], patches: PatchGrid
) -> Float[np.ndarray, '3 patches']:
    """Move forces on patches (into the gel, along x, along y) to their present places; sums are kept.

    `surface` is the motion of the surface [mm] along x under 1 N along x on a patch, at the patch and those around it;
    likewise along y. If 1 N of shear moves a patch of 1.78 mm by 0.4 mm, 0.45 * 0.4 / 1.78 = 10 % of its force moves to
    the next patch.
    """
    acting = np.flatnonzero(forces_n[0])
    steps = [
        HIDDEN / size * cv2.filter2D(shear.reshape(patches.shape), -1, near, borderType=cv2.BORDER_CONSTANT)
        for size, shear, near in zip(patches.size_mm, forces_n[1:], surface, strict=True)
    ]
    right, down = (each.ravel()[acting] for each in steps)
    rows, cols = patches.shape
    row, col = np.divmod(acting, cols)
    moved, force = np.zeros((patches.count, 3)), forces_n[:, acting].T
    for y, share_y in _between(row + down, rows):
        for x, share_x in _between(col + right, cols):
            np.add.at(moved, y * cols + x, (share_y * share_x)[:, None] * force)
    forces: np.ndarray = moved.T
    return forces


def _between(
    place: Float[np.ndarray, ' n'], count: int
) -> tuple[tuple[Int[np.ndarray, ' n'], Float[np.ndarray, ' n']], ...]:
    """The two of `count` lines around each place, and the weight of each; places are clamped to the last line."""
    place = np.clip(place, 0, count - 1)
    low = np.minimum(place.astype(int), count - 2)
    return (low, 1 - (place - low)), (low + 1, place - low)
