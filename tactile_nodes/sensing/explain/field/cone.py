"""Least squares over forces in the friction cone: normal force >= 0, shear within friction (ADMM)."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from tactile_nodes.shapes import Float

STEPS = 20
TINY = 1e-12
RELAXED = 1.6
STIFF = 0.03
"""Weight of the constraint in each step, over the mean of the diagonal."""

NOT_APART = 'the forces of this contact cannot be separated'


def in_cone(
    normal: Float[np.ndarray, ' n'], shear: Float[np.ndarray, '2 n'], friction: float
) -> tuple[Float[np.ndarray, ' n'], Float[np.ndarray, '2 n']]:
    """The nearest forces with |shear| <= friction * normal: with friction 1, (0, (2, 0)) becomes (1, (1, 0))."""
    size = np.hypot(shear[0], shear[1])
    # The nearest point on the cone has more normal force than a point outside, and less than one inside.
    pressed = np.maximum(np.maximum((normal + friction * size) / (1 + friction * friction), normal), 0.0)
    return pressed, shear * np.minimum(friction * pressed / np.maximum(size, TINY), 1.0)


@cache
def _of_triangles(dtype: np.dtype) -> tuple[Any, Any]:
    """LAPACK functions that factorise matrices of this type and invert the factor."""
    from scipy.linalg.lapack import get_lapack_funcs

    factorise, invert = get_lapack_funcs(('potrf', 'trtri'), dtype=dtype)
    return factorise, invert


def inverse_root(matrix: Float[np.ndarray, 'm m']) -> Float[np.ndarray, 'm m']:
    """R, lower triangular, with R'R the inverse of a symmetric positive matrix, of which the lower half is read."""
    factorise, invert = _of_triangles(matrix.dtype)
    factor, failed = factorise(matrix, lower=1, clean=1)
    if failed:
        raise np.linalg.LinAlgError(NOT_APART)
    root: np.ndarray = np.ascontiguousarray(invert(factor, lower=1, overwrite_c=1)[0])
    return root


def least_squares(
    information: Float[np.ndarray, 'm m'], towards: Float[np.ndarray, ' m'], friction: float, steps: int = STEPS
) -> Float[np.ndarray, ' m']:
    """The forces x (n normal ones, n along x, n along y) in the cone that minimise x H x / 2 - b x.

    Only the lower half of the information H is read.
    """
    stiff = STIFF * float(np.trace(information)) / len(towards)
    stepped = information.copy(order='F')
    stepped[np.diag_indices(len(towards))] += stiff
    root = inverse_root(stepped)
    return _least_squares(root, (root @ towards) @ root, stiff, friction, steps)


def _least_squares(
    root: Float[np.ndarray, 'm m'], begin: Float[np.ndarray, ' m'], stiff: float, friction: float, steps: int
) -> Float[np.ndarray, ' m']:
    """The iteration, from the optimum without the cone.

    With P the inverse times `stiff`, r = `RELAXED`, and x the projection of u on the cone, a step replaces u by
    u + r (b + P (2 x - u) - x), with one matrix product.
    """
    size, count = len(begin), len(begin) // 3
    inverse = root.T @ (root * (RELAXED * stiff))
    step, both = np.concatenate([-inverse, 2 * inverse], axis=1), np.zeros(2 * size, begin.dtype)
    own = np.arange(size)
    step[own, own] += 1
    step[own, own + size] -= RELAXED
    off, held, begin = both[:size], both[size:], RELAXED * begin
    normal, shear = off[:count], off[count:].reshape(2, count)
    for _ in range(steps):
        off[:] = step @ both + begin
        pressed, rubbed = in_cone(normal, shear, friction)
        held[:count], held[count:] = pressed, rubbed.reshape(-1)
    return held
