"""Least squares over forces that press and rub: normal force not below 0, shear not beyond friction (ADMM)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

STEPS = 30
TINY = 1e-12
RELAXED = 1.6
STIFF = 0.03
"""Of the mean of the diagonal: the weight of the constraint in each step."""


def in_cone(
    normal: Float[np.ndarray, ' n'], shear: Float[np.ndarray, '2 n'], friction: float
) -> tuple[Float[np.ndarray, ' n'], Float[np.ndarray, '2 n']]:
    """The nearest forces with |shear| <= friction * normal: with friction 1, (0, (2, 0)) becomes (1, (1, 0))."""
    size = np.sqrt(shear[0] * shear[0] + shear[1] * shear[1])
    edge = np.maximum(normal + friction * size, 0.0) / (1 + friction * friction)
    # Outside the polar cone, where friction * size <= -normal, the edge is 0; inside the cone nothing changes.
    limit = friction * edge
    inside = size <= friction * normal
    share = np.where(inside, 1.0, limit / np.maximum(size, TINY))
    return np.where(inside, normal, edge), shear * share


def inverse(matrix: Float[np.ndarray, 'm m']) -> Float[np.ndarray, 'm m']:
    """Of a symmetric positive matrix, by Cholesky's factor: a third of the work of any matrix."""
    from scipy.linalg.lapack import get_lapack_funcs

    factorise, invert = get_lapack_funcs(('potrf', 'potri'), (matrix,))
    factor, failed = factorise(matrix, lower=1)
    if failed:
        raise np.linalg.LinAlgError('the forces of this contact cannot be told apart')
    lower: np.ndarray = np.tril(invert(factor, lower=1)[0])
    whole: np.ndarray = lower + np.tril(lower, -1).T
    return whole


def least_squares(
    information: Float[np.ndarray, 'm m'],
    towards: Float[np.ndarray, ' m'],
    friction: float,
    steps: int = STEPS,
) -> Float[np.ndarray, ' m']:
    """The forces x (n normal ones, n along x, n along y) in the cone that make x H x / 2 - b x least."""
    count = len(towards) // 3
    stiff = STIFF * float(np.trace(information)) / len(towards)
    stepped = information.copy()
    stepped[np.diag_indices(len(towards))] += stiff
    solve = inverse(stepped)
    begin, held, off = solve @ towards, np.zeros_like(towards), np.zeros_like(towards)
    solve *= stiff
    for _ in range(steps):
        wanted = RELAXED * (begin + solve @ (held - off)) + (1 - RELAXED) * held + off
        pressed, shear = in_cone(wanted[:count], wanted[count:].reshape(2, count), friction)
        held[:count], held[count:] = pressed, shear.reshape(-1)
        off = wanted - held
    return held
