"""Displacements of a layer under a load, for all patches at once or at given places."""

from __future__ import annotations

import numpy as np

from tactile_nodes.sensing.elasticity.layer import ElasticLayer
from tactile_nodes.shapes import Float, Float32

FINER = 8
"""Steps of the layer's grid along a patch."""


def fields_of(
    layer: ElasticLayer, spectrum: np.ndarray, *, pressed_only: bool = False, slopes: bool = True
) -> Float32[np.ndarray, 'depths 3 loads sets y x']:
    """Displacement along each axis, optionally with its derivatives along x and y, at each depth under each load."""
    kernels = layer.kernels(spectrum, pressed_only=pressed_only)
    if not slopes:
        return kernels[:, :, :, None]
    (along_x, along_y), (*others, height, width) = layer.spacing_mm, kernels.shape
    fields = np.empty((*others, 3, height, width), np.float32)
    fields[..., 0, :, :] = kernels
    _differences(kernels, along_x, fields[..., 1, :, :])
    _differences(kernels.swapaxes(3, 4), along_y, fields[..., 2, :, :].swapaxes(3, 4))
    return fields


def _differences(values: np.ndarray, step_mm: float, found: np.ndarray) -> None:
    """Central differences along the last axis, to one side at its ends: as `np.gradient`, but much faster."""
    np.subtract(values[..., 2:], values[..., :-2], out=found[..., 1:-1])
    found[..., 1:-1] /= 2 * step_mm
    found[..., 0] = (values[..., 1] - values[..., 0]) / step_mm
    found[..., -1] = (values[..., -1] - values[..., -2]) / step_mm


def combed(field: Float32[np.ndarray, '3 loads sets y x'], shape: tuple[int, int]) -> np.ndarray:
    """Group the nodes of a field that lie one patch apart, as (y in a patch, x in a patch, axis, y, x, fields).

    After the end one period of patches follows, since the layer repeats.
    """
    height, width = field.shape[-2:]
    split = field.reshape(3, -1, height // FINER, FINER, width // FINER, FINER).transpose(3, 5, 0, 2, 4, 1)
    around = [(0, 0)] * 3 + [(0, count + 1) for count in shape] + [(0, 0)]
    return np.pad(split, around, mode='wrap')


def seen_by_rays(
    combs: np.ndarray, node: np.ndarray, part: np.ndarray, levers: np.ndarray, shape: tuple[int, int]
) -> Float32[np.ndarray, '2 fields y x']:
    """Motion in the image for a load on every patch, summed over the rays of a window, each between four nodes.

    Args:
        combs: nodes of the displacements along three axes, for each field, from `combed`; with the fields last, long
            runs of memory are copied at once.
        node: the node of each ray as (x, y), relative to the last patch.
        part: fraction of a step from the node to the ray.
        levers: motion in the image per displacement along each axis, as (rays, 2, 3).
    """
    (rows, cols), right, down = shape, part[:, 0], part[:, 1]
    shares = np.stack([(1 - down) * (1 - right), (1 - down) * right, down * (1 - right), down * right], -1)
    x, y = node[:, :1] + np.array([0, 1, 0, 1]), node[:, 1:] + np.array([0, 0, 1, 1])
    windows = np.lib.stride_tricks.sliding_window_view(combs, shape, axis=(3, 4))
    from_each = windows.transpose(0, 1, 3, 4, 2, 6, 7, 5)
    high, wide = combs.shape[3] - rows - 1, combs.shape[4] - cols - 1
    found = from_each[y % FINER, x % FINER, y // FINER % high, x // FINER % wide]
    weights = np.einsum('rk,rdc->drkc', shares, levers).reshape(2, -1)
    seen: np.ndarray = weights.astype(np.float32) @ found.reshape(weights.shape[1], -1)
    # Relative to a patch further right the ray is further left: nodes run backwards.
    by_field: np.ndarray = seen.reshape(2, rows, cols, -1)[:, ::-1, ::-1].transpose(0, 3, 1, 2)
    return by_field


def sampled_at(
    fields: Float32[np.ndarray, 'fields y x'], at: Float[np.ndarray, 'known rays 2']
) -> Float32[np.ndarray, 'fields known rays']:
    """Interpolate fields between the nodes of their grid (x, y in steps)."""
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
