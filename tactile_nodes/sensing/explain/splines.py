"""Uniform cubic B-splines: smooth functions of three numbers from a table of coefficients."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactile_nodes.shapes import Float, Float32, Int

_CUBIC = np.array([[1, -3, 3, -1], [4, 0, -6, 3], [1, 3, 3, -3], [0, 0, 0, 1]]) / 6
"""Row i: the polynomial in t of the i-th of the four splines that are non-zero between two knots (de Boor, 1978)."""
_SLOPE = np.array([[-3, 6, -3, 0], [0, -12, 9, 0], [3, 6, -9, 0], [0, 0, 3, 0]]) / 6
_BOTH = np.stack([_CUBIC, _SLOPE])
_BEND = np.array([[6, -6, 0, 0], [-12, 18, 0, 0], [6, -18, 0, 0], [0, 6, 0, 0]]) / 6
_ALL = np.stack([*_BOTH, _BEND])
_VALUE_X_Y_S = np.array([[0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
"""Which axis (row) is differentiated, for the value and for the derivatives along x, y and s (columns)."""
_AXES = np.arange(3)[:, None]
_FOUR = np.arange(4)


@dataclass(frozen=True)
class SplineAxis:
    """`intervals` equal intervals from `low` to `high`; `intervals` + 3 splines. Values outside are clamped."""

    low: float
    high: float
    intervals: int

    def __post_init__(self) -> None:
        if not (-math.inf < self.low < self.high < math.inf and self.intervals >= 1):
            raise ValueError(f'an axis cannot go from {self.low} to {self.high} in {self.intervals} intervals')

    @property
    def count(self) -> int:
        return self.intervals + 3

    def place(self, value: float) -> tuple[int, float]:
        """Index of the first spline that is non-zero here, and the position within the interval, from 0 to 1."""
        along = (min(max(value, self.low), self.high) - self.low) * self.intervals / (self.high - self.low)
        first = min(int(along), self.intervals - 1)
        return first, along - first

    def weights(self, value: float) -> tuple[int, Float[np.ndarray, '2 4']]:
        """Index of the first of four splines, and their values and derivatives (per unit of the axis) here.

        In the middle between two knots the values are 1/48, 23/48, 23/48 and 1/48.
        """
        first, t = self.place(value)
        pair = _BOTH @ np.array([1.0, t, t * t, t * t * t])
        pair[1] *= self.intervals / (self.high - self.low)
        return first, pair

    def weights_of(
        self, values: Float[np.ndarray, '*shape']
    ) -> tuple[Int[np.ndarray, '*shape'], Float[np.ndarray, '2 *shape 4']]:
        """As `weights`, for many values."""
        first, powers = self._powers(values)
        both: np.ndarray = np.einsum('gij,...j->g...i', _BOTH, powers)
        both[1] *= self._per_unit
        return first, both

    def design(self, values: Float[np.ndarray, ' n']) -> Float[np.ndarray, 'n count']:
        """All splines' values at many places."""
        first, powers = self._powers(values)
        return self._rows(first, powers @ _CUBIC.T)

    def design_and_slope(
        self, values: Float[np.ndarray, ' n']
    ) -> tuple[Float[np.ndarray, 'n count'], Float[np.ndarray, 'n count']]:
        """All splines' values at many places, and their derivatives per unit of the axis."""
        first, powers = self._powers(values)
        return self._rows(first, powers @ _CUBIC.T), self._rows(first, powers @ (_SLOPE.T * self._per_unit))

    @property
    def _per_unit(self) -> float:
        return self.intervals / (self.high - self.low)

    def _powers(
        self, values: Float[np.ndarray, '*shape']
    ) -> tuple[Int[np.ndarray, '*shape'], Float[np.ndarray, '*shape 4']]:
        """Index of the first non-zero spline, and powers 0 to 3 of the position within the interval."""
        along = (np.clip(values, self.low, self.high) - self.low) * self._per_unit
        first = np.minimum(along.astype(np.intp), self.intervals - 1)
        t = along - first
        square = t * t
        return first, np.stack([np.ones_like(t), t, square, square * t], axis=-1)

    def _rows(self, first: Int[np.ndarray, ' n'], four: Float[np.ndarray, 'n 4']) -> Float[np.ndarray, 'n count']:
        rows = np.zeros((len(first), self.count))
        rows.reshape(-1)[(np.arange(len(first)) * self.count + first)[:, None] + _FOUR] = four
        return rows


def cubes(
    x: SplineAxis, y: SplineAxis, s: SplineAxis, places: Float[np.ndarray, 'n 3']
) -> Float[np.ndarray, 'n coefficients']:
    """Products of the three axes' splines at many places, x slowest: one row per place, for a fit or an evaluation."""
    parts = [axis.design(places[:, i]) for i, axis in enumerate((x, y, s))]
    products: np.ndarray = np.einsum('ni,nj,nk->nijk', *parts, optimize=True)
    return products.reshape(len(places), -1)


def value_and_slopes(
    axes: tuple[SplineAxis, SplineAxis, SplineAxis],
    coefficients: Float32[np.ndarray, 'nx ny ns outputs'],
    at: Sequence[float],
) -> Float[np.ndarray, '4 outputs']:
    """The function at one place, and its derivatives along x, y and s."""
    (i, t), (j, u), (k, v) = (axis.place(value) for axis, value in zip(axes, at, strict=True))
    both = _BOTH @ np.array([[1.0, 1.0, 1.0], [t, u, v], [t * t, u * u, v * v], [t * t * t, u * u * u, v * v * v]])
    both[1] *= [axis.intervals / (axis.high - axis.low) for axis in axes]
    x, y, s = both[_VALUE_X_Y_S, :, _AXES]
    block = coefficients[i : i + 4, j : j + 4, k : k + 4].reshape(64, -1)
    weights = (x[:, :, None, None] * (y[:, :, None] * s[:, None, :])[:, None]).reshape(4, 64)
    result: np.ndarray = weights.astype(np.float32) @ block
    return result


def laplacian(
    axes: tuple[SplineAxis, SplineAxis, SplineAxis],
    coefficients: Float32[np.ndarray, 'nx ny ns outputs'],
    at: Sequence[float],
) -> Float[np.ndarray, ' outputs']:
    """Sum of the function's second derivatives along x and y at one place."""
    weights = []
    for axis, value in zip(axes, at, strict=True):
        first, t = axis.place(value)
        weights.append((first, _ALL @ np.array([1.0, t, t * t, t * t * t])))
    (i, x), (j, y), (k, s) = weights
    along_x, along_y = ((axis.intervals / (axis.high - axis.low)) ** 2 for axis in axes[:2])
    across = along_x * np.outer(x[2], y[0]) + along_y * np.outer(x[0], y[2])
    block = coefficients[i : i + 4, j : j + 4, k : k + 4].reshape(64, -1)
    bent: np.ndarray = (across[:, :, None] * s[0]).reshape(64).astype(np.float32) @ block
    return bent
