"""Monotone cubic interpolation without overshoot (Fritsch and Butland, 1984).

Gives the same as SciPy's PchipInterpolator. Loading scipy.interpolate would take as long as the rest of a simulated
camera's start.
"""

from __future__ import annotations

import numpy as np

from tactile_nodes.shapes import Float


def monotone_cubic(x: Float[np.ndarray, ' samples'], y: np.ndarray, at: Float[np.ndarray, ' points']) -> np.ndarray:
    """Values of the cubics through three or more samples, at given points.

    Args:
        x: positions of the samples, increasing.
        y: the samples along the first axis; further axes are kept.
        at: the points; outside `x` the first or the last cubic is extrapolated.
    """
    across = (-1,) + (1,) * (y.ndim - 1)
    step = np.diff(x).reshape(across)
    rise = np.diff(y, axis=0) / step
    slope = _slopes(step, rise)
    number = np.clip(np.searchsorted(x, at, side='right') - 1, 0, len(x) - 2)
    width = step[number]
    part = (at - x[number]).reshape(across) / width
    rest = 1 - part
    values: np.ndarray = (
        (1 + 2 * part) * rest**2 * y[number]
        + (1 + 2 * rest) * part**2 * y[number + 1]
        + part * rest * width * (rest * slope[number] - part * slope[number + 1])
    )
    return values


def _slopes(step: np.ndarray, rise: np.ndarray) -> np.ndarray:
    """Slope at each inner sample: the weighted harmonic mean of the adjacent slopes, 0 at an extremum."""
    before, after = rise[:-1], rise[1:]
    weight, other = 2 * step[1:] + step[:-1], step[1:] + 2 * step[:-1]
    alike = before * after > 0
    with np.errstate(divide='ignore', invalid='ignore'):
        inner = np.where(alike, (weight + other) / (weight / before + other / after), 0.0)
    first = _end(step[:1], step[1:2], rise[:1], rise[1:2])
    last = _end(step[-1:], step[-2:-1], rise[-1:], rise[-2:-1])
    return np.concatenate([first, inner, last])


def _end(step: np.ndarray, next_step: np.ndarray, rise: np.ndarray, next_rise: np.ndarray) -> np.ndarray:
    """Slope at an end: from three points, limited so that the cubic stays monotone."""
    slope = ((2 * step + next_step) * rise - step * next_rise) / (step + next_step)
    steep = (np.sign(rise) != np.sign(next_rise)) & (np.abs(slope) > 3 * np.abs(rise))
    return np.where(np.sign(slope) != np.sign(rise), 0.0, np.where(steep, 3 * rise, slope))
