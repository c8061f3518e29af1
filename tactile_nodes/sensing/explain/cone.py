"""Least squares over forces that press and rub: normal force not below 0, shear not beyond friction (ADMM)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

STEPS = 30
RELAXED = 1.6
STIFF = 0.03
"""Of the mean of the diagonal: the weight of the constraint in each step."""


def in_cone(
    normal: Float[np.ndarray, ' n'], shear: Float[np.ndarray, '2 n'], friction: float
) -> tuple[Float[np.ndarray, ' n'], Float[np.ndarray, '2 n']]:
    """The nearest forces with |shear| <= friction * normal: with friction 1, (0, (2, 0)) becomes (1, (1, 0))."""
    size = np.hypot(*shear)
    inside, outside = size <= friction * normal, friction * size <= -normal
    edge = (normal + friction * size) / (1 + friction * friction)
    pressed = np.where(inside, normal, np.where(outside, 0.0, edge))
    share = np.where(inside, 1.0, friction * pressed / np.maximum(size, 1e-12))
    return pressed, shear * share


def least_squares(
    information: Float[np.ndarray, 'm m'],
    towards: Float[np.ndarray, ' m'],
    friction: float,
) -> Float[np.ndarray, ' m']:
    """The forces x (n normal ones, n along x, n along y) in the cone that make x H x / 2 - b x least."""
    count = len(towards) // 3
    stiff = STIFF * float(np.trace(information)) / len(towards)
    stepped = information.copy()
    stepped[np.diag_indices(len(towards))] += stiff
    solve = np.linalg.inv(stepped)
    held, off = np.zeros_like(towards), np.zeros_like(towards)
    for _ in range(STEPS):
        free = solve @ (towards + stiff * (held - off))
        wanted = RELAXED * free + (1 - RELAXED) * held + off
        pressed, shear = in_cone(wanted[:count], wanted[count:].reshape(2, count), friction)
        held = np.concatenate([pressed, shear.ravel()])
        off = wanted - held
    return held
