"""A straight line fitted to points with outliers, its uncertainty, and a test for a bend."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tactile_nodes.shapes import Bool, Float64

TUKEY = 4.685
HONEST = 0.3  # a uniform error has a standard deviation of 0.6 half widths, and most of a mixture has less
MOST, USUAL = 0.75, 0.4  # mean square of errors over half widths: 1/3 if uniform, plus the share of wrong points
FARTHEST = 2.0  # in half widths: larger errors are clipped to this in that mean
ROUNDS = 3
SIGMAS = 4.0  # with three, 2 of 3000 simulated runs were accepted and off by more than required


@dataclass(frozen=True)
class RobustLine:
    """A line y = level + slope (x - centre), and the points that it was fitted to."""

    centre: float
    level: float
    slope: float
    inlier: Bool[np.ndarray, ' n']
    weight: Float64[np.ndarray, ' n']

    def residual(self, x: Float64[np.ndarray, ' n'], y: Float64[np.ndarray, ' n']) -> Float64[np.ndarray, ' n']:
        """How far the points lie above the line."""
        return y - self.level - self.slope * (x - self.centre)

    def bound(
        self, x: Float64[np.ndarray, ' n'], y: Float64[np.ndarray, ' n'], ends: Float64[np.ndarray, ' e'], finest: float
    ) -> float:
        """Four standard errors at the worst of `ends`: s sqrt(1 / W + (x - mean)^2 / S), with weighted sums."""
        k, weight, here = int(self.inlier.sum()), self.weight, x - self.centre
        total = float(weight.sum())
        mean = float(weight @ here) / total
        spread = float(weight @ (here - mean) ** 2)
        if k < 3 or spread <= 0:
            return math.inf
        variance = max(float(weight @ self.residual(x, y) ** 2) / (k - 2), finest**2 * total / k)
        reach = float(((ends - self.centre - mean) ** 2).max())
        return SIGMAS * math.sqrt(variance * (1 / total + reach / spread))


def robust_line(
    x: Float64[np.ndarray, ' n'],
    y: Float64[np.ndarray, ' n'],
    uncertainty: Float64[np.ndarray, ' n'] | None = None,
    finest: float = 1e-12,
) -> RobustLine:
    """The line that most points lie on, by Tukey's biweight.

    Points further off than 4.685 robust standard deviations have no weight. For 20 points on y = 2 x with one moved
    by 1, the line is y = 2 x and the moved point has no weight.

    Args:
        x, y: the points.
        uncertainty: half width of each point's error, if known. Its inverse square is the weight, and a point with a
            residual below 1.4 times of it always counts.
        finest: errors smaller than this are not distinguished.
    """
    if uncertainty is None:
        return _laid(x, y, np.ones_like(x), finest)
    known = np.maximum(uncertainty, finest)
    line = _laid(x, y, known, HONEST)
    for _ in range(ROUNDS):
        if (more := overlooked(line.residual(x, y), known)) == 0:
            break
        line = _laid(x, y, np.hypot(known, more), HONEST)
    return line


def overlooked(off: Float64[np.ndarray, ' n'], known: Float64[np.ndarray, ' n']) -> float:
    """Half width of an extra error of all points that explains residuals above the known errors; else 0.

    A camera whose images are stamped on arrival knows where in the exposure an edge was, but not the delay of the
    image. Errors of 3, -3, 3 and -3 with known half widths of 1 need an extra 4.6: (1 + 4.6²) 0.4 = 9.
    """
    low, high = 0.0, 2 * float(np.abs(off).max())
    if _share(off, known) <= MOST:
        return 0.0
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if _share(off, np.hypot(known, middle)) > USUAL else (low, middle)
    return high


def _share(off: Float64[np.ndarray, ' n'], known: Float64[np.ndarray, ' n']) -> float:
    return float(np.minimum((off / known) ** 2, FARTHEST**2).mean())


def _laid(
    x: Float64[np.ndarray, ' n'], y: Float64[np.ndarray, ' n'], known: Float64[np.ndarray, ' n'], least: float
) -> RobustLine:
    centre = float(x.mean())
    weight, line = known**-2, (0.0, 0.0)
    far = np.zeros_like(x)
    for turn in range(30):
        before, line = line, weighted_line(x - centre, y, weight)
        off = (y - line[0] - line[1] * (x - centre)) / known
        scale = max(1.4826 * float(np.median(np.abs(off))), least)
        far = np.clip(1 - (off / (TUKEY * scale)) ** 2, 0, None)
        weight = (far / known) ** 2
        if turn > 2 and abs(line[0] - before[0]) + abs(line[1] - before[1]) * float(np.ptp(x)) < 1e-9:
            break
    inlier = far > 0
    return RobustLine(centre, line[0], line[1], inlier, inlier / known**2)


def weighted_line(
    x: Float64[np.ndarray, ' n'], y: Float64[np.ndarray, ' n'], weight: Float64[np.ndarray, ' n']
) -> tuple[float, float]:
    """(y at 0, slope) by weighted least squares. The slope is 0 if all x are equal."""
    total = weight.sum()
    mean_x, mean_y = (weight @ x) / total, (weight @ y) / total
    spread = float(weight @ (x - mean_x) ** 2)
    slope = float(weight @ ((x - mean_x) * (y - mean_y))) / spread if spread > 0 else 0.0
    return float(mean_y - slope * mean_x), slope


def bend(x: Float64[np.ndarray, ' k'], residual: Float64[np.ndarray, ' k']) -> float:
    """Largest mean residual of any part of the run, minus what chance explains.

    Chance is estimated from the differences of neighbours, which a bend or a step hardly changes.
    """
    ordered = residual[np.argsort(x, kind='stable')]
    chance = 4 * float(np.std(np.diff(ordered))) / math.sqrt(2)
    parts = np.array_split(ordered, max(1, min(10, len(x) // 8)))
    return max(0.0, *(abs(float(part.mean())) - chance / math.sqrt(len(part)) for part in parts))
