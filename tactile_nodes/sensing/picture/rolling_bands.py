"""Bands that roll over the picture, as of a light that is pulsed while rows are read one after another: taken out.

They are common to all columns, and nothing else that comes between two pictures of a gel is: a press, a knock, a hot
spot and markers that are gone change each part of a row otherwise. Patches know light apart that is even within them,
but not bands as narrow as they are.
"""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

COLUMNS, ROWS_PX = 8, 8
"""A look compares means of so many parts of each row, over so many rows."""

LEAST_GREY = 2.5
"""Root mean square of what is common to a row from which it is a band: presses make 0.6, bands of 3 grey levels 1.7."""

COMMON = 1.0
"""Bands are at least so many times as much as what is left of the parts without them; chance makes 0.4 of it."""

LEAST_LIGHT = 0.5
"""Of the rest image's, on average: in a darker picture there is little to see bands by."""

SMOOTHED_ROWS = 2.0
"""Standard deviation (rows) of what a row's brightness is averaged over: rows differ by their markers, too."""


class RollingBands:
    """Finds bands beside one rest image and takes them out."""

    def __init__(self, image: UInt8[np.ndarray, 'h w']) -> None:
        self._rest = image
        self._level = max(float(image.mean()), 1.0)
        self._rows = cv2.reduce(image, 1, cv2.REDUCE_AVG, dtype=cv2.CV_32F)
        parts = parted(image.astype(np.float32))
        self._parts = parts - parts.mean()

    def without(self, image: UInt8[np.ndarray, 'h w']) -> UInt8[np.ndarray, 'h w']:
        """The image as it is between bands; the image itself where there are none."""
        change = cv2.subtract(image, self._rest, dtype=cv2.CV_32F)
        parts = parted(change)
        # Another light changes bright parts by more, of rows and of columns.
        brighter = float((parts * self._parts).sum() / max(float(np.square(self._parts).sum()), 1e-6))
        dark = parts.mean() < (LEAST_LIGHT - 1) * self._level
        if dark or not banded(parts - np.float32(brighter) * self._parts):
            return image
        rows = cv2.reduce(change, 1, cv2.REDUCE_AVG) - np.float32(brighter) * (self._rows - self._rows.mean())
        rows = cv2.GaussianBlur(rows, (1, 0), sigmaX=1.0, sigmaY=SMOOTHED_ROWS, borderType=cv2.BORDER_REPLICATE)
        mended: np.ndarray = np.clip(np.rint(image - rows.reshape(-1, 1)), 0, 255).astype(np.uint8)
        return mended


def parted(picture: Float32[np.ndarray, 'h w']) -> Float32[np.ndarray, 'some parts']:
    """Means of parts of rows, over several rows."""
    parts: np.ndarray = cv2.resize(picture, (COLUMNS, max(1, len(picture) // ROWS_PX)), interpolation=cv2.INTER_AREA)
    return parts


def banded(parts: Float32[np.ndarray, 'some parts']) -> bool:
    """Whether what changed in a picture is bands: alike in all parts of a row."""
    common = np.median(parts, axis=1)
    left = parts - common[:, None]
    common -= common.mean()
    left -= left.mean(axis=0)
    size, beside = (float(np.sqrt(np.square(each).mean())) for each in (common, left))
    return size >= LEAST_GREY and size >= COMMON * beside
