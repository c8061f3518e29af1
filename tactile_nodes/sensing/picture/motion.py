"""Motion of a whole picture, as after a knock of the camera: eight numbers, estimated from the motion of patches.

Shift, growth and turn about the middle are not enough. A tilt of the camera moves the rim by another amount than the
middle, depending on the lens: in a picture at focal length f (px) the point at r moves by

    s + (s . r) r / f²                     if the lens keeps straight lines straight,
    s - (r² s - (s . r) r) / (3 f²)        if it keeps angles (to the second order),

and likewise if the camera is pushed aside. So each kind of bend has its own number along x and along y.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import cv2
import numpy as np

from tactile_nodes.sensing.compiling import compiled_loops
from tactile_nodes.sensing.flow.patches import windowed_sinc
from tactile_nodes.sensing.picture.quietness import median
from tactile_nodes.shapes import Bool, Float, Float32, UInt8

TERMS, FIRST_BEND = 8, 4
ROUNDS = 5
FAR_PX = 0.05
"""Patches further than this from the common motion, as in a touch, have less than a quarter of the weight."""


@dataclass(frozen=True)
class PictureMotion:
    """Motion of a picture's content, as numbers in px at a distance of half the longer side from the middle.

    In order: shift right, shift down, growth, turn (clockwise as seen); bend with angles kept, right and down; bend
    with lines kept, right and down.
    """

    terms: tuple[float, ...] = (0.0,) * TERMS

    @classmethod
    def of(cls, terms: Float[np.ndarray, ' terms']) -> PictureMotion:
        return cls(tuple(float(each) for each in terms))

    def __add__(self, other: PictureMotion) -> PictureMotion:
        return PictureMotion(tuple(a + b for a, b in zip(self.terms, other.terms, strict=True)))

    def __sub__(self, other: PictureMotion) -> PictureMotion:
        return PictureMotion(tuple(a - b for a, b in zip(self.terms, other.terms, strict=True)))

    def scaled(self, share: float) -> PictureMotion:
        """The motion times `share`."""
        return PictureMotion(tuple(share * each for each in self.terms))

    @property
    def shift_px(self) -> tuple[float, float]:
        """Shift of the middle of the picture, right and down."""
        return self.terms[0], self.terms[1]

    def turn_rad(self, shape: tuple[int, ...]) -> float:
        """Turn of a picture of `shape`, clockwise as seen."""
        return self.terms[3] / _half(shape)

    def growth(self, shape: tuple[int, ...]) -> float:
        """Growth of a picture of `shape`. 0.001: a thousandth larger."""
        return self.terms[2] / _half(shape)

    def field_px(self, shape: tuple[int, ...], rows: int, cols: int) -> Float32[np.ndarray, 'rows cols 2']:
        """The motion at the middles of rows x cols patches of a picture of `shape`."""
        right, down, growth, turn, kept_right, kept_down, straight_right, straight_down = self.terms
        x, y = places(shape, rows, cols)
        field = np.empty((rows, cols, 2), np.float32)
        across = (straight_down - kept_down) * x * y[:, None]
        field[:, :, 0] = (right - turn * y + kept_right * y * y)[:, None] + (growth * x + straight_right * x * x)
        field[:, :, 0] += across
        across = (straight_right - kept_right) * x * y[:, None]
        field[:, :, 1] = (down + growth * y + straight_down * y * y)[:, None] + (turn * x + kept_down * x * x)
        field[:, :, 1] += across
        return field


LANCZOS = 4
"""Pixels to either side in the kernel of `Straightening`."""

PARTS = 32
"""Resolution of the interpolation, in parts of a pixel."""

_WAVES = np.linspace(0, 0.9 * np.pi, 128)
_SEEN = np.cos(_WAVES / 2) ** 2
"""Spatial frequencies in rad/px, and their weights. Pictures of markers contain less of the higher ones."""


def _passed() -> Float[np.ndarray, 'parts waves']:
    """Gain of Lanczos' kernel for each spatial frequency and each part of a pixel.

    A kernel w for a shift by f has the gain Re(sum w_n exp(i k (n - f))) at k rad/px.
    """
    away = np.arange(-LANCZOS, LANCZOS + 1) - (np.arange(PARTS) / PARTS - 0.5)[:, None]
    weights = np.where(np.abs(away) < LANCZOS, np.sinc(away) * np.sinc(away / LANCZOS), 0.0)
    weights /= weights.sum(axis=1, keepdims=True)
    passed: np.ndarray = (weights[:, :, None] * np.cos(away[:, :, None] * _WAVES)).sum(axis=1)
    return passed


_PASSED = _passed()
_SIDES = np.linalg.pinv(_SEEN[:, None] * (2 * np.cos(_WAVES[:, None] * np.arange(1, LANCZOS + 1)) - 2))
"""Least-squares solution for the side weights of a filter whose weights add up to one."""


def sharpening(moved_px: Float32[np.ndarray, ' pixels']) -> Float32[np.ndarray, ' taps']:
    """Nine weights that undo the mean blur of Lanczos' kernel for pixels moved by `moved_px`."""
    parts = np.rint((moved_px + 0.5) * PARTS).astype(int) % PARTS
    passed = np.bincount(parts, minlength=PARTS) @ _PASSED / len(parts)
    side = _SIDES @ (_SEEN * (1 / passed - 1))
    taps: np.ndarray = np.concatenate([side[::-1], [1 - 2 * side.sum()], side]).astype(np.float32)
    return taps


@dataclass(frozen=True)
class Straightening:
    """Undoes a motion of the whole picture in images of one shape."""

    motion: PictureMotion
    shape: tuple[int, ...]

    @cached_property
    def _undoing(self) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
        """The sharpening kernels along x and y, and the maps of the source of each pixel."""
        field = self.motion.field_px(self.shape, *self.shape)
        sharp = sharpening(field[::8, ::8, 0].ravel()), sharpening(field[::8, ::8, 1].ravel())
        field[:, :, 0] += np.arange(self.shape[1], dtype=np.float32)
        field[:, :, 1] += np.arange(self.shape[0], dtype=np.float32)[:, None]
        whole, part = cv2.convertMaps(field, None, cv2.CV_16SC2)  # type: ignore[call-overload]
        return sharp, (whole, part)

    def __call__(self, image: UInt8[np.ndarray, 'h w'], beyond: UInt8[np.ndarray, 'h w']) -> UInt8[np.ndarray, 'h w']:
        """The image with its content moved back. Parts that the camera no longer sees come from `beyond`.

        It uses Lanczos' kernel of 8x8 pixels. Bicubic interpolation takes a third of the time, but its blur makes
        full-size models underestimate the force. The image is sharpened first by the mean blur of the kernel.
        """
        sharpen, (whole, part) = self._undoing
        sharp = cv2.sepFilter2D(image, -1, *sharpen, borderType=cv2.BORDER_REPLICATE)
        straight: np.ndarray = cv2.remap(
            sharp, whole, part, cv2.INTER_LANCZOS4, dst=beyond.copy(), borderMode=cv2.BORDER_TRANSPARENT
        )
        return straight


@dataclass(frozen=True)
class Shift:
    """Undoes a shift: whole pixels by copying, the rest by a Kaiser-windowed sinc along rows and columns.

    Copying causes no blur and takes almost no time. The kernel takes a fraction of the time of `Straightening`.
    """

    right_px: float
    down_px: float

    @cached_property
    def motion(self) -> PictureMotion:
        """The motion that it undoes."""
        return PictureMotion((self.right_px, self.down_px, *((0.0,) * (TERMS - 2))))

    @cached_property
    def _kernels(self) -> tuple[Float32[np.ndarray, ' right'], Float32[np.ndarray, ' down']]:
        return _sinc(self.right_px - round(self.right_px)), _sinc(self.down_px - round(self.down_px))

    def __call__(self, image: UInt8[np.ndarray, 'h w'], beyond: UInt8[np.ndarray, 'h w']) -> UInt8[np.ndarray, 'h w']:
        """As `Straightening`."""
        straight: np.ndarray = beyond.copy()
        along_x, along_y = self._kernels
        if along_x.size + along_y.size > 2:
            image = cv2.sepFilter2D(image, -1, along_x, along_y, borderType=cv2.BORDER_REPLICATE)
        whole = round(self.down_px), round(self.right_px)
        to = tuple(slice(max(-by, 0), -by if by > 0 else None) for by in whole)
        straight[to] = image[tuple(slice(max(by, 0), by if by < 0 else None) for by in whole)]
        return straight


KAISER_BETA = 4.0
"""Window of a shift's kernel, sharper than that for templates: blur makes models underestimate."""


def _sinc(part: float) -> Float32[np.ndarray, ' taps']:
    """Weights of the pixels to either side for a shift by `part` of a pixel; a single 1 without shift."""
    if abs(part) < 1e-9:
        return np.ones(1, np.float32)
    taps: np.ndarray = windowed_sinc(-part, KAISER_BETA).astype(np.float32)
    return taps


class MotionFit:
    """Estimates the common motion of rows x cols patches over a picture of `shape`."""

    def __init__(self, shape: tuple[int, ...], rows: int, cols: int, *, compiled: bool = False) -> None:
        self.compiled = compiled
        x, y = (each.reshape(-1) for each in np.meshgrid(*places(shape, rows, cols)))
        zero, one = np.zeros_like(x), np.ones_like(x)
        self._along_x = np.stack([one, zero, x, -y, y * y, -x * y, x * x, x * y], axis=-1)
        self._along_y = np.stack([zero, one, y, x, -x * y, x * x, x * y, y * y], axis=-1)
        self._along = np.stack([self._along_x, self._along_y], axis=1).reshape(-1, TERMS)
        squares = [np.einsum('ni,nj->nij', each, each) for each in (self._along_x, self._along_y)]
        self._products = sum(squares).reshape(rows * cols, -1)
        self._mean_product = self._products.mean(axis=0).reshape(TERMS, TERMS)

    def carried(self, terms: Float[np.ndarray, ' terms']) -> Float[np.ndarray, 'patches 2']:
        """Motion of each patch by these terms (px)."""
        carried: np.ndarray = (self._along @ terms).reshape(-1, 2)
        return carried

    def size_px(self, terms: Float[np.ndarray, ' terms']) -> float:
        """Root mean square motion over the patches (px)."""
        return math.sqrt(float(terms @ (self._mean_product @ terms)))

    def bent(self, terms: Float[np.ndarray, ' terms']) -> float:
        """Motion by the bends alone over that by all terms (root mean square)."""
        bends = np.where(np.arange(TERMS) < FIRST_BEND, 0.0, terms)
        return self.size_px(bends) / max(self.size_px(terms), 1e-9)

    def common(
        self,
        motion: Float[np.ndarray, 'patches 2'],
        weight: Float[np.ndarray, ' patches'],
        *,
        rounds: int = ROUNDS,
        about_none: bool = False,
    ) -> Float[np.ndarray, ' terms']:
        """The terms of the motion that most patches follow. Other patches have little weight.

        Iteratively reweighted least squares with weights `weight` / (1 + (r / 0.05 px)²)², starting at the median
        motion, or at zero if `about_none`.
        """
        terms, scale = np.zeros(TERMS), FAR_PX**2
        if not about_none:
            along_x, along_y = motion[weight > 0].T
            terms[:2] = median(along_x), median(along_y)
            scale = max(scale, median(self._away(motion, terms)[weight > 0]))
        if self.compiled:
            compiled_loops().common(motion, weight, self._along_x, self._along_y, rounds, FAR_PX**2, scale, terms)
            return terms
        away = np.square(motion).sum(axis=1) if about_none else self._away(motion, terms)
        for number in range(rounds):
            terms = self._weighted(motion, weight / np.square(1 + away / scale))
            if number < rounds - 1:
                away = self._away(motion, terms)
                scale = max(FAR_PX**2, scale / 4)
        return terms

    def common_of_regions(
        self, motion: Float[np.ndarray, 'rows cols 2'], found: Bool[np.ndarray, 'rows cols']
    ) -> Float[np.ndarray, ' terms']:
        """The same of the regions that were found."""
        known = np.where(found[:, :, None], motion, 0).reshape(-1, 2).astype(float)
        return self.common(known, found.ravel().astype(float))

    def _away(self, motion: Float[np.ndarray, 'patches 2'], terms: Float[np.ndarray, ' terms']) -> np.ndarray:
        """Squared distance of each patch's motion from that of the terms."""
        away: np.ndarray = np.square(motion[:, 0] - self._along_x @ terms)
        away += np.square(motion[:, 1] - self._along_y @ terms)
        return away

    def _weighted(
        self, motion: Float[np.ndarray, 'patches 2'], weight: Float[np.ndarray, ' patches']
    ) -> Float[np.ndarray, ' terms']:
        normal = (weight @ self._products).reshape(TERMS, TERMS)
        normal.flat[:: TERMS + 1] += 1e-6 * normal[0, 0] + 1e-30  # if the remaining patches do not determine all
        seen = (weight * motion[:, 0]) @ self._along_x + (weight * motion[:, 1]) @ self._along_y
        terms: np.ndarray = np.linalg.solve(normal, seen)
        return terms


@lru_cache(maxsize=8)
def motion_fit(shape: tuple[int, ...], rows: int, cols: int, *, compiled: bool = False) -> MotionFit:
    """A fit that is made once for all pictures of a shape."""
    return MotionFit(shape, rows, cols, compiled=compiled)


def places(shape: tuple[int, ...], rows: int, cols: int) -> tuple[np.ndarray, np.ndarray]:
    """Centres of the columns and of the rows, relative to the picture's middle, in units of half the longer side."""
    height, width = shape
    half = _half(shape)
    right = ((np.arange(cols) + 0.5) * width / cols - width / 2) / half
    down = ((np.arange(rows) + 0.5) * height / rows - height / 2) / half
    return right, down


def _half(shape: tuple[int, ...]) -> float:
    return max(shape) / 2
