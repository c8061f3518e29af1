"""Where the forces of a field act now: what rubs on the gel takes its surface along, and the force with it.

The response is that of the gel at rest. A force on a surface that has gone 1 mm aside shows 0.6 mm aside: markers lie
under the surface and have gone less far. So each force is told further along by a share of how far the surface has gone
under all shear, as the linear layer says.
"""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int

from tactile_nodes.sensing.elasticity.patches import PatchGrid

HIDDEN = 0.45
"""Share of the surface's motion, as the linear layer has it, that a force is further along than it shows."""


def moved_along(
    forces_n: Float[np.ndarray, '3 patches'], surface: Float32[np.ndarray, '2 near near'], patches: PatchGrid
) -> Float[np.ndarray, '3 patches']:
    """Forces on patches (into the gel, along x, along y) where they act now; sums stay as they are.

    `surface` is how far (mm) the surface goes along x under 1 N along x on a patch, there and at the patches around it,
    and along y likewise. Under 1 N of shear that takes a patch of 1.78 mm along by 0.4 mm, 0.45 * 0.4 / 1.78 = 10 % of
    what shows on that patch is told on the next one.
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
    told: np.ndarray = moved.T
    return told


def _between(
    place: Float[np.ndarray, ' n'], count: int
) -> tuple[tuple[Int[np.ndarray, ' n'], Float[np.ndarray, ' n']], ...]:
    """The two of so many lines that each place lies between, and its share in each; none lies beyond the last one."""
    place = np.clip(place, 0, count - 1)
    low = np.minimum(place.astype(int), count - 2)
    return (low, 1 - (place - low)), (low + 1, place - low)
