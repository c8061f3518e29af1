"""Patches of one rest image, with everything precomputed before the first frame.

Each patch is matched by inverse compositional Lucas-Kanade (Baker and Matthews, IJCV 2004) with offset and gain of the
light as further unknowns: image = offset + gain * (T + Tu u + Tv v). The least-squares solution is a sum and three dot
products of the image's patch with constants. The error of the linear model is calibrated: the rest image is moved by
known sub-pixel shifts, and a polynomial from the linear estimates to the true motion is fitted for each patch. So no
frame is interpolated: a patch is read at the nearest whole pixel, and the sub-pixel part follows from the dot products.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from tactile_nodes.sensing.compiling import compiled_loops
from tactile_nodes.shapes import Float, Float32, Int, Int16, Int32

SAMPLES_PX = np.linspace(-0.8, 0.8, 5)
"""Shifts of the rest image, on each axis, to which the polynomials are fitted."""

LARGEST_ANSWER_PX = 1.25
"""Linear estimates are clipped to this before the polynomial, which was fitted up to about 0.8."""

SLOPE_STEP_PX = 0.25
LEAST_GAIN = 0.1
"""Least gain of the light: smaller gains, far below those of any real light, would turn noise into motion."""

MARKER_FREE_GREY = 0.05
"""Root mean square gradient (grey levels per pixel) below which a patch counts as if it had this one."""

SINC_REACH_PX = 8

Moved = Callable[[float, float], Float32[np.ndarray, 'h w']]


@dataclass(frozen=True)
class Match:
    """Motion of each patch in pixels, x first, and the share of its contrast that the moved rest image explains."""

    motion_px: Float32[np.ndarray, '2 patches']
    explained: Float32[np.ndarray, ' patches']

    def improve(self, other: Match, numbers: Int[np.ndarray, ' some'] | None = None, *, least: float = 0.0) -> None:
        """Copy patches (all, or those numbered) from another match that explains them better by at least `least`."""
        mine = self.explained if numbers is None else self.explained[numbers]
        better = np.flatnonzero(other.explained > mine + least)
        mended = better if numbers is None else numbers[better]
        self.motion_px[:, mended] = other.motion_px[:, better]
        self.explained[mended] = other.explained[better]


class PatchGrid:
    """Layout of patches: rows x cols centres evenly spaced over an image, each with a square window inside it."""

    def __init__(self, shape: tuple[int, int], rows: int, cols: int, window_px: int) -> None:
        self.shape, self.rows, self.cols = shape, rows, cols
        self.window_px = min(window_px, *shape)
        self.furthest = np.array([[shape[1]], [shape[0]]], np.int32) - self.window_px
        x, y = ((np.arange(count) + 0.5) * side / count for count, side in ((cols, shape[1]), (rows, shape[0])))
        centre = np.stack(np.meshgrid(x, y)).reshape(2, -1)
        corner = np.round(centre - self.window_px / 2).astype(np.int32)
        self.corner: Int32[np.ndarray, '2 patches'] = np.clip(corner, 0, self.furthest)

    def windows(self, image: np.ndarray, corner: Int32[np.ndarray, '2 some']) -> Float32[np.ndarray, 'some pixels']:
        """The pixels of windows of an image without gaps, by their upper left corners, which must lie in it."""
        side, (height, width) = self.window_px, image.shape
        places = (height - side + 1, width - side + 1, side, side)
        every: np.ndarray = np.ndarray(places, image.dtype, image, strides=image.strides * 2)
        found: np.ndarray = every[corner[1], corner[0]].reshape(corner.shape[1], -1).astype(np.float32)
        return found


class Templates:
    """The patches of a rest image, prepared for matching in other images.

    `texture_grey` is the root mean square gradient of each patch in its weaker direction, in grey levels per pixel,
    without what a change of light could explain.
    """

    def __init__(self, grid: PatchGrid, moved: Moved, *, compiled: bool = False) -> None:
        """`moved` gives the rest image, at the grid's resolution, moved right and down by parts of its pixels."""
        self.grid, self._compiled = grid, compiled
        basis, triangle = np.linalg.qr(self._model(moved))
        self._rounded, self._unit = rounded(np.ascontiguousarray(basis.transpose(0, 2, 1)))
        self._basis = self._rounded * self._unit[:, :, None]
        scale = np.abs(np.einsum('pkk->pk', triangle))
        self.texture_grey: Float32[np.ndarray, ' patches'] = (scale[:, 1:].min(axis=1) / grid.window_px).astype(
            np.float32
        )
        self._unmix = _inverse(triangle, MARKER_FREE_GREY * grid.window_px)
        self._mend = self._calibrated(moved)
        self._numbers = np.arange(len(self._basis))

    def _model(self, moved: Moved) -> np.ndarray:
        """T, dT/du and dT/dv of each patch, (patches, pixels, 3), each without its mean."""
        step = SLOPE_STEP_PX
        still, right, left, down, up = (
            self.grid.windows(moved(*each), self.grid.corner).astype(np.float64)
            for each in ((0.0, 0.0), (step, 0.0), (-step, 0.0), (0.0, step), (0.0, -step))
        )
        model = np.stack([still, (right - left) / (2 * step), (down - up) / (2 * step)], axis=-1)
        centred: np.ndarray = model - model.mean(axis=1, keepdims=True)
        return centred

    def _calibrated(self, moved: Moved) -> Float32[np.ndarray, '2 terms patches']:
        """Coefficients of what to add to the linear answers, so that the rest image's own motions come out true."""
        true = np.stack(np.meshgrid(SAMPLES_PX, SAMPLES_PX)).reshape(2, -1)
        windows = (self.grid.windows(moved(*each), self.grid.corner) for each in true.T.tolist())
        answer = np.stack([self._linear(each, slice(None))[0] for each in windows], axis=-1)
        terms = _terms(*answer).astype(np.float64)
        # Small motions count most: what is further than half a pixel away is read again from the next pixel.
        weight = np.exp(-2 * np.square(true).sum(axis=0))
        normal = np.einsum('kpj,lpj,j->pkl', terms, terms, weight) + 1e-3 * np.eye(len(terms))
        miss = np.einsum('kpj,cpj,j->pkc', terms, true[:, None] - answer, weight)
        return np.ascontiguousarray(np.linalg.solve(normal, miss).transpose(2, 1, 0), np.float32)

    def _linear(
        self, pixels: Float32[np.ndarray, 'some pixels'], which: np.ndarray | slice
    ) -> tuple[Float32[np.ndarray, '2 some'], Float32[np.ndarray, ' some']]:
        """The linear estimate, and the share of each patch's contrast that it explains."""
        part = np.matmul(self._basis[which], pixels[:, :, None])[:, :, 0].T.copy()
        total = np.einsum('pn->p', pixels)
        contrast = np.einsum('pn,pn->p', pixels, pixels) - total * total / np.float32(pixels.shape[1])
        explained = np.einsum('kp,kp->p', part, part) / np.maximum(contrast, 1)
        unmixed = np.einsum('jkp,kp->jp', self._unmix[:, :, which], part)
        answer = unmixed[1:] / np.maximum(unmixed[0], LEAST_GAIN)
        return np.clip(answer, -LARGEST_ANSWER_PX, LARGEST_ANSWER_PX, out=answer), explained

    def find(
        self,
        image: np.ndarray,
        start_px: Float32[np.ndarray, '2 some'] | None = None,
        numbers: Int[np.ndarray, ' some'] | None = None,
    ) -> Match:
        """Find patches (all, or those numbered) in an image: at their places at rest, or at `start_px`."""
        which = slice(None) if numbers is None else numbers
        home = self.grid.corner[:, which]
        corner = home if start_px is None else home + np.rint(start_px).astype(np.int32)
        corner = corner if start_px is None else np.clip(corner, 0, self.grid.furthest)
        if self._compiled and image.dtype == np.uint8:
            motion, explained = self._matched(image, corner, self._numbers if numbers is None else numbers)
        else:
            motion, explained = self._linear(self.grid.windows(image, corner), which)
            motion += np.einsum('ckp,kp->cp', self._mend[:, :, which], _terms(*motion))
        if start_px is not None:
            motion += corner - home
        return Match(motion, explained)

    def _matched(
        self, image: np.ndarray, corner: np.ndarray, numbers: np.ndarray
    ) -> tuple[Float32[np.ndarray, '2 some'], Float32[np.ndarray, ' some']]:
        """The same, compiled."""
        motion, explained = np.empty((2, len(numbers)), np.float32), np.empty(len(numbers), np.float32)
        corner, limits = np.ascontiguousarray(corner), (LEAST_GAIN, LARGEST_ANSWER_PX, 0.0, 0.0)
        compiled_loops().match(image, corner, numbers, self.grid.window_px, self.for_loops, limits, motion, explained)
        return motion, explained

    @property
    def for_loops(self) -> tuple[np.ndarray, ...]:
        """Templates as whole numbers, what one of them is, and how motion follows: see `loops.patches`."""
        return self._rounded, self._unit, self._unmix, self._mend


def rounded(basis: np.ndarray) -> tuple[Int16[np.ndarray, 'patches some pixels'], Float32[np.ndarray, 'patches some']]:
    """Templates as whole numbers and what one of them is: half the memory to read for each frame.

    What a number loses by it the next one gains, so that sums over a part of a template stay what they were: motion is
    off by no more than 1e-5 px for it, a thousandth of what noise makes.
    """
    unit = np.maximum(np.abs(basis).max(axis=2), 1e-30) / (np.iinfo(np.int16).max - 1)
    summed = np.rint(np.cumsum(basis / unit[:, :, None], axis=2))
    return np.ascontiguousarray(np.diff(summed, axis=2, prepend=0.0), np.int16), unit.astype(np.float32)


def _inverse(triangle: np.ndarray, least: float) -> Float32[np.ndarray, '3 3 patches']:
    """Upper triangles inverted, with diagonals of at least `least`."""
    safe = triangle.copy()
    diagonal = np.einsum('pkk->pk', safe)
    diagonal[:] = np.where(np.abs(diagonal) < least, least, diagonal)
    return np.ascontiguousarray(np.linalg.inv(safe).transpose(1, 2, 0), np.float32)


def _terms(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Products of two numbers up to the third degree, but no constant: what does not move needs no mending."""
    terms = np.empty((9, *x.shape), x.dtype)
    terms[0], terms[1] = x, y
    np.multiply(terms[:2], x, out=terms[2:4])
    np.multiply(y, y, out=terms[4])
    np.multiply(terms[2:5], x, out=terms[5:8])
    np.multiply(terms[4], y, out=terms[8])
    return terms


def moved_image(image: Float32[np.ndarray, 'h w'], dx_px: float, dy_px: float) -> Float32[np.ndarray, 'h w']:
    """The image with its content moved right and down by any part of a pixel: a sinc under a Kaiser window."""
    kernels = _known_sinc(dx_px), _known_sinc(dy_px)
    moved: np.ndarray = cv2.sepFilter2D(image, cv2.CV_32F, *kernels, borderType=cv2.BORDER_REFLECT_101)
    return moved


@lru_cache(maxsize=64)  # each rest image is moved by the same parts of a pixel
def _known_sinc(shift_px: float) -> Float[np.ndarray, ' taps']:
    kernel: np.ndarray = windowed_sinc(shift_px)
    kernel.flags.writeable = False
    return kernel


def windowed_sinc(shift_px: float, beta: float = 8.0) -> Float[np.ndarray, ' taps']:
    """Weights of pixels to either side that move a row right by any part of a pixel; `beta` is Kaiser's."""
    reach = SINC_REACH_PX + round(abs(shift_px))
    at = np.arange(-reach, reach + 1) + shift_px
    inside = np.maximum(0, 1 - np.square(at / SINC_REACH_PX))
    kernel = np.sinc(at) * np.where(inside > 0, np.i0(beta * np.sqrt(inside)), 0)
    normal: np.ndarray = kernel / kernel.sum()
    return normal


def shrunk(image: np.ndarray, times: int = 1, *, compiled: bool = False) -> np.ndarray:
    """The image at half its size, `times` times over: each pixel the mean of four; an odd last line is left out."""
    for _ in range(times):
        height, width = image.shape[0] // 2, image.shape[1] // 2
        if compiled and image.dtype == np.uint8 and image.flags.c_contiguous:
            small = np.empty((height, width), np.uint8)
            compiled_loops().halved(image, small)
            image = small
            continue
        image = cv2.resize(image[: 2 * height, : 2 * width], (width, height), interpolation=cv2.INTER_AREA)
    return image
