"""Uniform cubic splines in ONNX: `tactile_nodes.sensing.splines` at one place."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32

from tactile_nodes.learning.onnx_graph import Value
from tactile_nodes.sensing.splines import SplineAxis

_WHICH = [0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]
"""Value (0) or slope (1) of the splines along x, y and s: for the value, and for its slopes along x, y and s."""


def value_and_slopes(
    axes: tuple[SplineAxis, SplineAxis, SplineAxis], coefficients: Float32[np.ndarray, 'nx ny ns outputs'], at: Value
) -> Value:
    """(4, outputs): the function at one place (3,), and its slopes along x, y and s."""
    writer = at.writer
    first, splines = _splines(axes, at)
    table = writer.constant(coefficients)
    block = writer.op('Slice', table, first, first + 4, writer.constant(np.arange(3)))
    weights = _products(splines).reshape(4, 64).cast(np.float32)
    return weights @ block.reshape(64, coefficients.shape[-1])


def _splines(axes: tuple[SplineAxis, ...], at: Value) -> tuple[Value, Value]:
    """Number of the first of the four splines of each axis, and their values and slopes (3, 8)."""
    low, high = (np.array([getattr(axis, end) for axis in axes]) for end in ('low', 'high'))
    intervals = np.array([axis.intervals for axis in axes])
    along = (at.most(low).least(high) - low) * intervals / (high - low)
    first = along.cast(np.int64).least(intervals - 1)
    t = (along - first.cast(np.float64)).reshape(3, 1)
    square = t * t
    powers = at.writer.op('Concat', t * 0 + 1, t, square, square * t, axis=1)
    per_unit = np.repeat(np.stack([np.ones(3), intervals / (high - low)], axis=1), 4, axis=1)
    return first, powers @ _polynomials() * per_unit


def _polynomials() -> np.ndarray:
    """From 1, t, t² and t³ to the four splines and their four slopes (4, 8), as the splines themselves have them."""
    values = [SplineAxis(0.0, 1.0, 1).weights(t)[1].reshape(-1) for t in (0.0, 0.25, 0.5, 1.0)]
    return np.linalg.solve(np.vander([0.0, 0.25, 0.5, 1.0], increasing=True), np.array(values))


def _products(splines: Value) -> Value:
    """(4, 4, 4, 4): products of the splines along x, y and s, of which the slope is taken as `_WHICH` says."""
    flat, numbers = splines.reshape(-1), np.arange(4)
    x, y, s = (
        flat.take((8 * axis + 4 * np.array(_WHICH)[:, axis, None] + numbers).reshape(shape))
        for axis, shape in enumerate(((4, 4, 1, 1), (4, 1, 4, 1), (4, 1, 1, 4)))
    )
    return x * y * s
