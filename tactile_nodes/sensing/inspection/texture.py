"""Random patterns in a picture: width and number of their marks, and parts without marks."""

from __future__ import annotations

import math
from statistics import NormalDist

import cv2
import numpy as np

from tactile_nodes.sensing.flow.dot_pattern import Dots
from tactile_nodes.shapes import Bool, Float32, UInt8

SMOOTH_PX, AROUND_PX = 1.0, 6.0
"""Standard deviations of two blurs: one removes pixel noise, the other estimates the slowly varying light."""

NOISE = 5.0
"""Least contrast of a mark, as a multiple of the noise."""

DARK_SHARE = 0.25
"""Share of the usual light or texture below which a part is covered."""

LEAST_PART, NEAR_PX = 0.004, 12.0
"""Smallest covered part, as a share of the picture; pixels over which texture and light are averaged."""

BURNT = 250
"""Grey level from which a part shows a light instead of the gel."""


def marks(picture: UInt8[np.ndarray, 'h w'], *, dark: bool = False) -> Float32[np.ndarray, 'h w']:
    """Light relative to its surroundings, with most noise removed; inverted for dark marks."""
    light = picture.astype(np.float32)
    found = cv2.GaussianBlur(light, (0, 0), SMOOTH_PX) - cv2.GaussianBlur(light, (0, 0), AROUND_PX)
    return np.asarray(-found if dark else found, np.float32)


def noise_grey(picture: UInt8[np.ndarray, 'h w']) -> float:
    """Standard deviation of pixel noise, from second differences in the smoothest quarter of 8x8 blocks."""
    light = picture.astype(np.float32)
    height, width = (side // 8 * 8 for side in picture.shape)
    bent = cv2.filter2D(light, -1, np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32) / 6)[:height, :width]
    blocks = np.square(bent).reshape(height // 8, 8, width // 8, 8).mean(axis=(1, 3))
    return math.sqrt(float(np.percentile(blocks, 25)))


def mark_px(picture: UInt8[np.ndarray, 'h w'], seen: Bool[np.ndarray, 'h w']) -> float:
    """Width (standard deviation) of marks in the part `seen`, from the slope of a sum of Gaussians.

    For marks of width s the mean square is s² times that of the gradient. The blur of 1 px against noise is
    subtracted. Widths below 1.5 px are overestimated by a fifth, since slopes are differences of pixels.
    """
    shown = marks(picture)
    steep = sum(np.square(cv2.Sobel(shown, cv2.CV_32F, *order, scale=0.125)) for order in ((1, 0), (0, 1)))
    quiet = noise_grey(picture) ** 2 / (4 * math.pi)
    height = float(np.square(shown)[seen].mean()) - quiet
    slope = float(np.asarray(steep)[seen].mean()) - quiet / (2 * SMOOTH_PX**2)
    return math.sqrt(max(height / max(slope, 1e-6) - SMOOTH_PX**2, 0.0))


def peaks(picture: UInt8[np.ndarray, 'h w'], *, dark: bool = False) -> Bool[np.ndarray, 'h w']:
    """Peaks of single marks: the maximum within 2 px, and above noise."""
    shown = marks(picture, dark=dark)
    highest = cv2.dilate(shown, np.ones((5, 5), np.uint8))
    least = max(NOISE * noise_grey(picture) / math.sqrt(4 * math.pi) / SMOOTH_PX, 2.0)
    found: np.ndarray = (shown >= highest) & (shown > least)
    return found


def looks_covered(picture: UInt8[np.ndarray, 'h w'], dots: Dots | None) -> Bool[np.ndarray, 'h w']:
    """Parts that show no gel: overexposed, or dark between dots, or without the usual texture."""
    light = picture.astype(np.float32)
    if dots is None:
        near_px, shown = NEAR_PX, cv2.GaussianBlur(np.square(marks(picture)), (0, 0), NEAR_PX)
        least = DARK_SHARE**2
    else:
        over = np.ones((round(1.5 * dots.diameter_px) | 1,) * 2, np.uint8)  # wider than a dot
        kept = cv2.MORPH_CLOSE if dots.dark else cv2.MORPH_DILATE
        near_px, least = NEAR_PX / 2, DARK_SHARE
        shown = cv2.GaussianBlur(cv2.morphologyEx(light, kept, over), (0, 0), near_px)
    usual = float(np.percentile(shown, 75))
    dark = _wider(shown < least * usual, near_px * _normal(least))
    burnt = cv2.GaussianBlur((picture >= BURNT).astype(np.float32), (0, 0), NEAR_PX / 4) > 0.5
    return _large(dark | burnt)


def _normal(share: float) -> float:
    """Distance beyond a blurred edge, in standard deviations, at which it has fallen to a share: 0.67 for 0.25."""
    return -NormalDist().inv_cdf(share)


def _wider(on: Bool[np.ndarray, 'h w'], by_px: float) -> Bool[np.ndarray, 'h w']:
    """Widen covered parts by what the blur removed at their edges."""
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * round(by_px) + 1,) * 2)
    return cv2.dilate(on.astype(np.uint8), disc) > 0


def _large(on: Bool[np.ndarray, 'h w']) -> Bool[np.ndarray, 'h w']:
    """Connected parts without specks, with small holes filled."""
    least = LEAST_PART * on.size
    for value in (True, False):
        _, parts, boxes, _ = cv2.connectedComponentsWithStats((on == value).astype(np.uint8), connectivity=4)
        small = boxes[:, cv2.CC_STAT_AREA] < least
        small[0] = False
        on = np.where(small[parts], not value, on)
    return np.asarray(on, bool)
