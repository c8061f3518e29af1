"""Displacements of a layer under a load, as they are seen from all patches at once, or at places."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32

from tactile_nodes.sensing.elasticity.layer import ElasticLayer

FINER = 8
"""Steps of the layer's grid along a patch."""


def fields_of(
    layer: ElasticLayer, spectrum: np.ndarray, *, pressed_only: bool = False, slopes: bool = True
) -> Float32[np.ndarray, 'depths 3 loads sets y x']:
    """Displacement along each axis, and its slopes along x and y where asked for, at each depth under each load."""
    kernels = layer.kernels(spectrum, pressed_only=pressed_only)
    if not slopes:
        return kernels[:, :, :, None]
    (along_x, along_y), (*others, height, width) = layer.spacing_mm, kernels.shape
    fields = np.empty((*others, 3, height, width), np.float32)
    fields[..., 0, :, :] = kernels
    fields[..., 1, :, :] = np.gradient(kernels, along_x, axis=4)
    fields[..., 2, :, :] = np.gradient(kernels, along_y, axis=3)
    return fields


def combed(field: Float32[np.ndarray, '3 loads sets y x'], shape: tuple[int, int]) -> np.ndarray:
    """The nodes of a field that lie a patch apart, side by side, as (y in a patch, x in a patch, fields, y, x).

    As many as there are patches follow after the end: there the layer repeats.
    """
    height, width = field.shape[-2:]
    split = field.reshape(-1, height // FINER, FINER, width // FINER, FINER).transpose(2, 4, 0, 1, 3)
    around = [(0, 0)] * 3 + [(0, count + 1) for count in shape]
    return np.pad(split, around, mode='wrap')


def between(
    combs: np.ndarray, node: np.ndarray, part: np.ndarray, shape: tuple[int, int]
) -> Float32[np.ndarray, 'fields rows columns']:
    """Fields as a ray sees them from every patch: each between four nodes."""
    (rows, cols), (column, row), (right, down) = shape, node.tolist(), part.tolist()
    high, wide = combs.shape[3] - rows - 1, combs.shape[4] - cols - 1
    block = np.zeros((combs.shape[2], rows, cols), np.float32)
    for y, share_y in ((row, 1 - down), (row + 1, down)):
        for x, share_x in ((column, 1 - right), (column + 1, right)):
            top, left = y // FINER % high, x // FINER % wide
            comb = combs[y % FINER, x % FINER, :, top : top + rows, left : left + cols]
            block += np.float32(share_x * share_y) * comb
    # A patch further right sees the ray further left: nodes run backwards.
    return block[:, ::-1, ::-1]


def sampled_at(
    fields: Float32[np.ndarray, 'fields y x'], at: Float[np.ndarray, 'known rays 2']
) -> Float32[np.ndarray, 'fields known rays']:
    """Fields at places between the nodes of their grid (x, y in steps)."""
    low = np.floor(at).astype(int)
    right, down = np.moveaxis((at - low).astype(np.float32), -1, 0)
    height, width = fields.shape[-2:]
    x, y = low[..., 0] % width, low[..., 1] % height
    beside, row, below = (x + 1) % width, width * y, width * ((y + 1) % height)
    nodes = fields.reshape(len(fields), -1)
    corners = row + x, row + beside, below + x, below + beside
    here, along, across, opposite = (np.take(nodes, corner, axis=1) for corner in corners)
    upper, lower = here + right * (along - here), across + right * (opposite - across)
    sampled: np.ndarray = upper + down * (lower - upper)
    return sampled
