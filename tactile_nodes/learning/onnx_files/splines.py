"""Uniform cubic splines in ONNX: `tactile_nodes.sensing.explain.splines` at one place."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactile_nodes.learning.onnx_files.graph import Value
from tactile_nodes.sensing.explain.splines import SplineAxis
from tactile_nodes.shapes import Float32

_VALUE_AND_SLOPES = [0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]
"""Value (0) or slope (1) of the splines along x, y and s: for the value, and for its slopes along x, y and s."""
_BENDS = [2, 0, 0], [0, 2, 0]
"""Second derivative (2) along x, and along y."""


def value_and_slopes(
    axes: tuple[SplineAxis, SplineAxis, SplineAxis], coefficients: Float32[np.ndarray, 'nx ny ns outputs'], at: Value
) -> Value:
    """(4, outputs): the function at one place (3,), and its slopes along x, y and s."""
    return _derivatives(axes, coefficients, at, _VALUE_AND_SLOPES)


def laplacian(
    axes: tuple[SplineAxis, SplineAxis, SplineAxis], coefficients: Float32[np.ndarray, 'nx ny ns outputs'], at: Value
) -> Value:
    """(outputs,): the sum of the second derivatives along x and y at one place (3,)."""
    return np.ones(2, np.float32) @ _derivatives(axes, coefficients, at, _BENDS)


def _derivatives(
    axes: tuple[SplineAxis, ...], coefficients: Float32[np.ndarray, 'nx ny ns outputs'], at: Value,
    which: Sequence[Sequence[int]],
) -> Value:  # fmt: skip
    writer = at.writer
    first, splines = _splines(axes, at)
    table = writer.constant(coefficients)
    block = writer.op('Slice', table, first, first + 4, writer.constant(np.arange(3)))
    weights = _products(splines, np.array(which)).reshape(len(which), 64).cast(np.float32)
    return weights @ block.reshape(64, coefficients.shape[-1])


def _splines(axes: tuple[SplineAxis, ...], at: Value) -> tuple[Value, Value]:
    """Number of the first of the four splines of each axis, and their values, slopes and second derivatives (3, 12)."""
    low, high = (np.array([getattr(axis, end) for axis in axes]) for end in ('low', 'high'))
    intervals = np.array([axis.intervals for axis in axes])
    along = (at.most(low).least(high) - low) * intervals / (high - low)
    first = along.cast(np.int64).least(intervals - 1)
    t = (along - first.cast(np.float64)).reshape(3, 1)
    square = t * t
    powers = at.writer.op('Concat', t * 0 + 1, t, square, square * t, axis=1)
    per_unit = np.repeat((intervals / (high - low))[:, None] ** np.arange(3), 4, axis=1)
    return first, powers @ _polynomials() * per_unit


def _polynomials() -> np.ndarray:
    """Matrix from 1, t, t² and t³ to the four splines, their slopes and second derivatives (4, 12)."""
    values = [SplineAxis(0.0, 1.0, 1).weights(t)[1].reshape(-1) for t in (0.0, 0.25, 0.5, 1.0)]
    both = np.linalg.solve(np.vander([0.0, 0.25, 0.5, 1.0], increasing=True), np.array(values))
    return np.hstack([both, np.diag([1.0, 2.0, 3.0], k=1) @ both[:, 4:]])


def _products(splines: Value, which: np.ndarray) -> Value:
    """(n, 4, 4, 4): products of the splines along x, y and s. `which` gives the order of the derivatives."""
    flat, numbers = splines.reshape(-1), np.arange(4)
    x, y, s = (
        flat.take((12 * axis + 4 * which[:, axis, None] + numbers).reshape(-1, *shape))
        for axis, shape in enumerate(((4, 1, 1), (1, 4, 1), (1, 1, 4)))
    )
    return x * y * s
