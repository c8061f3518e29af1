"""A gel of bright dots, drawn where a motion carried them: pictures whose motion is known to the last digit."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

SIDE = 440
RNG = np.random.default_rng(3)
DOTS = RNG.uniform(-10, SIDE + 10, (6000, 2))
NOISE = RNG.normal(0, 1.2, (8, SIDE, SIDE))
RADIUS_PX, REACH, BESIDE = 1.1, 4, 40

Motion = Callable[[np.ndarray], np.ndarray]


def picture(*motions: Motion, number: int = 0, light: float = 1.0, gone: float = 0.0) -> np.ndarray:
    """The dots after some motions, one after another (places in px, motion in px), under noise `number`.

    `gone`: that share of them is not there.
    """
    seen = _lit(motions, light, gone) + NOISE[number % len(NOISE)]
    np.rint(seen, out=seen)
    return np.clip(seen, 0, 255, out=seen).astype(np.uint8)


@lru_cache(maxsize=16)
def _lit(motions: tuple[Motion, ...], light: float, gone: float) -> np.ndarray:
    """Without noise: a stream shows the same ones frame by frame."""
    return light * (14 + 80 * _drawn(motions, gone))


def _drawn(motions: tuple[Motion, ...], gone: float) -> np.ndarray:
    """The dots alone."""
    at = DOTS[round(gone * len(DOTS)) :]
    for each in motions:
        at = at + each(at)
    whole = np.rint(at).astype(int)
    near = np.arange(-REACH, REACH + 1)
    x, y = whole[:, 0, None] + near, whole[:, 1, None] + near
    along_x = np.exp(-0.5 * np.square((x - at[:, 0, None]) / RADIUS_PX))
    along_y = np.exp(-0.5 * np.square((y - at[:, 1, None]) / RADIUS_PX))
    spots, side = along_y[:, :, None] * along_x[:, None, :], SIDE + 2 * BESIDE
    nodes = side * (y[:, :, None] + BESIDE) + x[:, None, :] + BESIDE
    wide = np.bincount(nodes.ravel(), spots.ravel(), side * side).reshape(side, side)
    return wide[BESIDE:-BESIDE, BESIDE:-BESIDE]


def shift(right_px: float, down_px: float) -> Motion:
    return lambda at: np.broadcast_to([right_px, down_px], at.shape)


def turn(degrees: float) -> Motion:
    """Clockwise as seen, about the middle."""
    angle = np.deg2rad(degrees)
    spin = np.array([[np.cos(angle) - 1, -np.sin(angle)], [np.sin(angle), np.cos(angle) - 1]])
    return lambda at: (at - SIDE / 2) @ spin.T


def grow(share: float) -> Motion:
    """About the middle; 0.001: a thousandth larger."""
    return lambda at: share * (at - SIDE / 2)


def press(x_px: float, y_px: float, most_px: float) -> Motion:
    """Outwards from a place, most at 26 px from it, nothing far away."""

    def away(at: np.ndarray) -> np.ndarray:
        apart = at - [x_px, y_px]
        return most_px * apart / 26 * np.exp(0.5 - 0.5 * np.square(apart / 26).sum(axis=1, keepdims=True))

    return away
