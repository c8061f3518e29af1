"""The line below points whose errors are never negative, such as arrival times over a sender's clock."""

from __future__ import annotations

import numpy as np

from tactile_nodes.shapes import Float64


def lower_line(x: Float64[np.ndarray, ' n'], y: Float64[np.ndarray, ' n'], steepest: float) -> tuple[float, float]:
    """The highest line with no point below it, as (y at x = 0, slope).

    "Highest" means the largest sum over the points. It contains the edge of the lower convex hull at the mean of x.
    For the points (0, 0), (1, 3), (2, 2) with mean 1 it is the line through the first and the last: (0.0, 1.0).

    Args:
        x: not decreasing.
        y: the values that lie above the line.
        steepest: limit of the slope's magnitude. A line with a limited slope touches only one point.
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
