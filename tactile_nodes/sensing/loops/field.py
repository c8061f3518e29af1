"""Steps towards the forces of a field, compiled: see `explain.cone.least_squares`."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,untyped-decorator"
from __future__ import annotations

import math

import numpy as np

from tactile_nodes.sensing.explain.field.cone import RELAXED, TINY
from tactile_nodes.sensing.loops.common import compiled


@compiled()
def _times_inverse(root, vector, between, product):
    """`product` becomes R'R times a vector, R lower triangular."""
    n = vector.shape[0]
    for i in range(n):
        total = np.float32(0.0)
        row = root[i]
        for j in range(i + 1):
            total += row[j] * vector[j]
        between[i] = total
        product[i] = np.float32(0.0)
    for i in range(n):
        row, share = root[i], between[i]
        for j in range(i + 1):
            product[j] += row[j] * share


@compiled('void(float32[:,::1],float32[::1],float64,float64,int64,float64[::1])')
def least_squares(root, begin, stiff, friction, steps, held):
    """As `explain.cone._least_squares`: fills in `held`, which begins with none."""
    n = begin.shape[0]
    count = n // 3
    off, vector = np.zeros(n), np.empty(n, np.float32)
    between, product = np.empty(n, np.float32), np.empty(n, np.float32)
    for _ in range(steps):
        for i in range(n):
            vector[i] = held[i] - off[i]
        _times_inverse(root, vector, between, product)
        for i in range(n):
            off[i] += RELAXED * (begin[i] + stiff * product[i]) + (1 - RELAXED) * held[i]
        for i in range(count):
            normal, along_x, along_y = off[i], off[count + i], off[2 * count + i]
            size = math.sqrt(along_x * along_x + along_y * along_y)
            pressed = max((normal + friction * size) / (1 + friction * friction), normal, 0.0)
            share = min(friction * pressed / max(size, TINY), 1.0)
            held[i], held[count + i], held[2 * count + i] = pressed, share * along_x, share * along_y
        for i in range(n):
            off[i] -= held[i]
