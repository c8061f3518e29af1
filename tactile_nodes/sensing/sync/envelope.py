"""The line under a cloud of points whose errors are never negative: arrivals over a sender's clock."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64


def lower_line(x: Float64[np.ndarray, ' n'], y: Float64[np.ndarray, ' n'], steepest: float) -> tuple[float, float]:
    """The highest line that no point lies below: (its y at x = 0, its slope).

    "Highest" in the sum over the points, so it holds an edge of the lower convex hull: the edge over the mean of x.
    Of the points (0, 0), (1, 3), (2, 2) with mean 1 it is the line through the first and the last: (0.0, 1.0).

    Args:
        x: not decreasing.
        y: what is to lie above the line.
        steepest: a steeper slope, up or down, is taken as this one; the line then touches one point.
    """
    hull = _lower_hull(x, y)
    right = int(np.clip(np.searchsorted(x[hull], x.mean()), 1, max(1, len(hull) - 1)))
    if len(hull) < 2:
        return float(y[hull[0]]), 0.0
    left, right = hull[right - 1], hull[right]
    slope = float(np.clip((y[right] - y[left]) / max(x[right] - x[left], 1e-300), -steepest, steepest))
    return float((y - slope * x).min()), slope


def _lower_hull(x: Float64[np.ndarray, ' n'], y: Float64[np.ndarray, ' n']) -> list[int]:
    points = list(zip(x.tolist(), y.tolist(), strict=True))  # plain numbers: an array's elements are ten times slower
    hull: list[int] = []
    for i, point in enumerate(points):
        while len(hull) >= 2 and _turns_right(points[hull[-2]], points[hull[-1]], point):
            hull.pop()
        hull.append(i)
    return hull


def _turns_right(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    return (b[0] - a[0]) * (c[1] - a[1]) <= (b[1] - a[1]) * (c[0] - a[0])
