"""Finds printed dots in a picture: centres, diameter, and pitch along rows and columns."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from tactile_nodes.shapes import Bool, Float, Float32, UInt8

LEAST_DOTS = 8
LEAST_CONTRAST = 8.0
"""Least difference of a dot from its surroundings, in grey levels."""

COARSE = 4
"""The grey of the surroundings is computed at a quarter of the resolution."""

DIMMEST = 0.2
"""Share of the median grey below which the contrast is no longer divided by the darker surroundings."""

OF_CONTRAST = 0.5
"""Share of the strongest difference at which a dot ends."""

LEAST_PX = 3.0
"""Diameter of the smallest dot. Smaller spots are texture."""

ROUND = 0.55
"""Least share of its bounding box that a dot fills (a disc: pi/4), and least ratio of the box's short to long side."""

ALIKE = 2.0
"""Largest ratio of a dot's area to the median area, or of the median to it."""

IN_ROW, REGULAR = 0.2, 0.6
"""Largest distance of a dot from its place in the grid, over the pitch, and the share of the dots that must keep it."""

STEEP, ONE_SIDE = 0.75, 0.05
"""How far aside the next dot in a row or column may lie, over the distance along it. Of two that are equally near, as
in staggered rows, it is the left or upper one: the other counts as farther by a share of how far aside it lies."""


@dataclass(frozen=True)
class Dots:
    """Dots of a picture, without those at its rim.

    `across_px` and `down_px` are the vectors (x, y) from a dot to the next one right of it and below it. `edge_px` is
    the standard deviation of the blur of the dots' edges.
    """

    centres_px: Float[np.ndarray, 'dots 2']
    diameter_px: float
    dark: bool
    across_px: Float[np.ndarray, ' 2']
    down_px: Float[np.ndarray, ' 2']
    edge_px: float

    @property
    def pitch_px(self) -> float:
        """Distance of neighbouring dots, mean of both directions."""
        return float((np.hypot(*self.across_px) + np.hypot(*self.down_px)) / 2)

    @property
    def turn_deg(self) -> float:
        """Angle of the rows, positive if they go down from left to right."""
        return math.degrees(math.atan2(self.across_px[1], self.across_px[0]))

    def __len__(self) -> int:
        return len(self.centres_px)


def find_dots(picture: UInt8[np.ndarray, 'h w']) -> Dots | None:
    """The dark or bright dots of a picture, whichever are more. None without dots in rows and columns."""
    above = contrast(picture) * np.float32(max(np.median(picture), 1))
    found = [each for each in (_found(-above, dark=True), _found(above, dark=False)) if each is not None]
    return max(found, key=len, default=None)


def contrast(picture: UInt8[np.ndarray, 'h w'], *, dark: bool = False) -> Float32[np.ndarray, 'h w']:
    """How much brighter, or darker, each pixel is than its surroundings, relative to them."""
    height, width = picture.shape
    small = cv2.resize(picture, (width // COARSE, height // COARSE), interpolation=cv2.INTER_AREA)
    usual = cv2.medianBlur(small, min(small.shape) // 4 | 1)
    around = cv2.resize(usual, (width, height)).astype(np.float32)
    share = (picture - around) / np.maximum(around, DIMMEST * max(float(np.median(usual)), 1.0))
    return np.asarray(-share if dark else share, np.float32)


def _found(above: Float32[np.ndarray, 'h w'], *, dark: bool) -> Dots | None:
    """Dots with a positive contrast."""
    contrast = float(np.percentile(above, 99.5))
    if contrast < LEAST_CONTRAST:
        return None
    centres, areas = _discs(above > OF_CONTRAST * contrast)
    if len(centres) < LEAST_DOTS:
        return None
    across, down = _next(centres, axis=0), _next(centres, axis=1)
    if across is None or down is None:
        return None
    edge_px = _edge_px(above, centres, math.sqrt(float(np.median(areas)) * 4 / math.pi))
    return Dots(centres, math.sqrt(float(np.median(areas)) * 4 / math.pi), dark, across, down, edge_px)


def _discs(on: Bool[np.ndarray, 'h w']) -> tuple[Float[np.ndarray, 'n 2'], Float[np.ndarray, ' n']]:
    """Centres and areas of round spots of one size, away from the rim."""
    height, width = on.shape
    _, _, boxes, centres = cv2.connectedComponentsWithStats(on.astype(np.uint8), connectivity=4)
    left, top, wide, high, area = boxes[1:].T.astype(float)
    inside = (left > 0) & (top > 0) & (left + wide < width) & (top + high < height)
    even = np.minimum(wide, high) >= ROUND * np.maximum(wide, high)
    good = inside & even & (area >= ROUND * wide * high) & (area >= LEAST_PX**2 * math.pi / 4)
    if not good.any():
        return np.zeros((0, 2)), np.zeros(0)
    usual = float(np.median(area[good]))
    good &= (area < ALIKE * usual) & (area > usual / ALIKE)
    return centres[1:][good], area[good]


def _next(centres: Float[np.ndarray, 'n 2'], axis: int) -> Float[np.ndarray, ' 2'] | None:
    """Median vector from a dot to the next along x (0) or y (1). None if the dots are not regular."""
    ways = centres[None] - centres[:, None]
    along, beside = ways[..., axis], ways[..., 1 - axis]
    near = (along > 0) & (np.abs(beside) < STEEP * along)
    away = np.where(near, np.hypot(along, beside) + ONE_SIDE * beside, np.inf)
    nearest = away.argmin(axis=1)
    has = np.isfinite(away[np.arange(len(centres)), nearest])
    if has.sum() < LEAST_DOTS / 2:
        return None
    chosen = ways[np.flatnonzero(has), nearest[has]]
    usual: np.ndarray = np.median(chosen, axis=0)
    off = np.hypot(*(chosen - usual).T)
    return usual if (off < IN_ROW * np.hypot(*usual)).mean() >= REGULAR else None


def _edge_px(above: Float32[np.ndarray, 'h w'], centres: Float[np.ndarray, 'n 2'], diameter_px: float) -> float:
    """Blur of the edges. A step of height a, blurred by s, has a maximum slope of a / (s sqrt(2 pi))."""
    smooth = cv2.GaussianBlur(above, (0, 0), 1.0)
    steep = np.hypot(*(cv2.Sobel(smooth, cv2.CV_32F, *order, scale=0.125) for order in ((1, 0), (0, 1))))
    reach = round(0.9 * diameter_px)
    cols, rows = (
        np.clip(np.rint(along).astype(int)[:, None] + np.arange(-reach, reach + 1), 0, side - 1)
        for along, side in zip(centres.T, above.shape[::-1], strict=True)
    )
    about = rows[:, :, None], cols[:, None, :]
    high, low = np.percentile(smooth[about], (95, 5), axis=(1, 2))
    slope = np.maximum(np.percentile(steep[about], 98, axis=(1, 2)), 1e-3)
    blur = float(np.median((high - low) / (math.sqrt(2 * math.pi) * slope)))
    return math.sqrt(max(blur**2 - 1, 0.0))
