"""The mask of a camera's image, where it shows no gel: polygons as in SVG, or an image that is black there."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactile_nodes.decoding import read_picture
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.params import parameter
from tactile_nodes.shapes import Bool, Float, Int

MOST_POLYGONS = 100
SMOOTH_PX = 1.0
"""How far polygons may differ from the image that they were made from."""

_FINE = 16
"""Sub-pixel steps in which corners are drawn."""


@dataclass(frozen=True)
class MaskSettings:
    """The covered part: all points inside an odd number of polygons, so that a polygon inside another is a hole."""

    polygons_px: tuple[str, ...] = parameter(
        (), "masked parts of the camera's full image, one text per polygon: corners 'x,y x,y x,y' [px]"
    )

    def __post_init__(self) -> None:
        for number, text in enumerate(self.polygons_px, 1):
            try:
                corners_of(text)
            except ValueError as error:
                raise ValueError(
                    f'polygon {number} of mask.polygons_px is {text[:60]!r}, but must have three corners or more, '
                    "as '0,0 640,0 640,20 0,20'"
                ) from error

    def require_within(self, width: int, height: int) -> None:
        """Refuse polygons outside images of such a size. Raises ValueError."""
        for number, text in enumerate(self.polygons_px, 1):
            corners = corners_of(text)
            (left, top), (right, bottom) = corners.min(axis=0), corners.max(axis=0)
            if right < 0 or bottom < 0 or left > width - 1 or top > height - 1:
                raise ValueError(
                    f'polygon {number} of mask.polygons_px lies outside the image of {width}x{height} pixels'
                )

    def covers(self, width: int, height: int) -> Bool[np.ndarray, 'h w']:
        """Which pixels of an image are covered; the middle of the first pixel is at (0, 0)."""
        import cv2

        drawn = np.zeros((height, width), np.uint8)
        if self.polygons_px:
            corners = [np.rint(corners_of(each) * _FINE).astype(np.int32) for each in self.polygons_px]
            cv2.fillPoly(drawn, corners, 1, shift=_FINE.bit_length() - 1)
        return drawn > 0


def corners_of(text: str) -> Float[np.ndarray, 'corners 2']:
    """The corners (x, y) of a polygon from its text: '0,0 9,0 9,9' has three. Raises ValueError."""
    found = np.array([[float(number) for number in pair.split(',')] for pair in text.split()])
    if found.ndim != 2 or found.shape[1] != 2 or len(found) < 3 or not (np.abs(found) < 1e5).all():
        raise ValueError(text)
    return found


def polygons_of(covered: Bool[np.ndarray, 'h w']) -> tuple[str, ...]:
    """Polygons that cover the same pixels as a mask image, nearly to the pixel."""
    import cv2

    found, _ = cv2.findContours(covered.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    smooth = [cv2.approxPolyDP(each, SMOOTH_PX, closed=True) for each in found]
    chosen = [each if len(each) > 2 else whole for each, whole in zip(smooth, found, strict=True)]
    return tuple(_text(each.reshape(-1, 2)) for each in chosen)


def _text(found: Int[np.ndarray, 'corners 2']) -> str:
    """At least three corners, the last one repeated."""
    corners: list[list[int]] = found.tolist()
    return ' '.join(f'{x},{y}' for x, y in [*corners, *[corners[-1]] * (3 - len(corners))])


def mask_of(path: Path, width: int, height: int) -> MaskSettings:
    """The mask in an image file of the size of the camera's image, black where it covers.

    Raises:
        ConfigurationError: it cannot be read, has another size, or has too many separate parts.
    """
    try:
        picture = read_picture(path, grey=True)
    except OSError as error:
        raise ConfigurationError(f'cannot read the mask {path}: {error.strerror}; name a PNG file') from error
    if picture.shape != (height, width):
        raise ConfigurationError(
            f'the mask {path} has {picture.shape[1]}x{picture.shape[0]} pixels, but image says {width}x{height}; '
            "draw it over the camera's full image"
        )
    polygons = polygons_of(picture < 128)
    if len(polygons) > MOST_POLYGONS:
        raise ConfigurationError(
            f'the mask {path} has {len(polygons)} separate parts, at most {MOST_POLYGONS} are allowed; paint the '
            'covered parts black and all else white, without grain'
        )
    return MaskSettings(polygons)
