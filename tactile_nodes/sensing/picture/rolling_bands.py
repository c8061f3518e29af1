"""Removes rolling bands, as from a pulsed light with a rolling shutter.

Bands are equal in all columns. No other change of a gel's picture is: a press, a knock, a hot spot and lost markers
change each part of a row differently. Patches separate even light from motion, but not bands as narrow as a patch.
"""

from __future__ import annotations

import cv2
import numpy as np

from tactile_nodes.shapes import Float32, UInt8

COLUMNS, ROWS_PX = 8, 8
"""The check compares the means of so many parts of each row, over so many rows."""

LEAST_GREY = 2.5
"""Least root mean square of the common change of rows in bands. Presses cause 0.6, bands of 3 grey levels 1.7."""

COMMON = 1.0
"""Least ratio of the bands to the residual of the parts without them. Chance causes 0.4."""

LEAST_LIGHT = 0.5
"""Least light, relative to the rest image. In a darker picture bands are hard to see."""

SMOOTHED_ROWS = 2.0
"""Standard deviation (rows) of the smoothing of row brightness, as markers also make rows differ."""


class RollingBands:
    """Finds bands relative to one rest image and removes them."""

    def __init__(self, image: UInt8[np.ndarray, 'h w']) -> None:
        self._rest = image
        self._level = max(float(image.mean()), 1.0)
        self._rows = cv2.reduce(image, 1, cv2.REDUCE_AVG, dtype=cv2.CV_32F)
        parts = parted(image.astype(np.float32))
        self._parts = parts - parts.mean()

    def without(self, image: UInt8[np.ndarray, 'h w']) -> UInt8[np.ndarray, 'h w']:
        """The image without bands, or the image itself if there are none."""
        change = cv2.subtract(image, self._rest, dtype=cv2.CV_32F)
        parts = parted(change)
        # A change of light changes bright parts more, in rows and in columns.
        brighter = float((parts * self._parts).sum() / max(float(np.square(self._parts).sum()), 1e-6))
        dark = parts.mean() < (LEAST_LIGHT - 1) * self._level
        if dark or not banded(parts - np.float32(brighter) * self._parts):
            return image
        rows = cv2.reduce(change, 1, cv2.REDUCE_AVG) - np.float32(brighter) * (self._rows - self._rows.mean())
        rows = cv2.GaussianBlur(rows, (1, 0), sigmaX=1.0, sigmaY=SMOOTHED_ROWS, borderType=cv2.BORDER_REPLICATE)
        mended: np.ndarray = np.clip(np.rint(image - rows.reshape(-1, 1)), 0, 255).astype(np.uint8)
        return mended


def parted(picture: Float32[np.ndarray, 'h w']) -> Float32[np.ndarray, 'some parts']:
    """Means over parts of several rows."""
    parts: np.ndarray = cv2.resize(picture, (COLUMNS, max(1, len(picture) // ROWS_PX)), interpolation=cv2.INTER_AREA)
    return parts


def banded(parts: Float32[np.ndarray, 'some parts']) -> bool:
    """Whether the change of a picture is bands, equal in all parts of a row."""
    common = np.median(parts, axis=1)
    left = parts - common[:, None]
    common -= common.mean()
    left -= left.mean(axis=0)
    size, beside = (float(np.sqrt(np.square(each).mean())) for each in (common, left))
    return size >= LEAST_GREY and size >= COMMON * beside
