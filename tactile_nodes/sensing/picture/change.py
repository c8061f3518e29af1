"""Compares the picture of an untouched gel with an earlier one: moved, turned, scaled, dimmed, or different.

Motion is measured by 10x10 patches at half size, the least noisy grid (0.003 px per patch at rest). It takes about a
millisecond of CPU time while the pictures are alike, and up to 80 ms if they differ.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from tactile_nodes.errors import ImageError
from tactile_nodes.sensing.flow.inverse_compositional import InverseCompositionalFlow, InverseCompositionalOptions
from tactile_nodes.sensing.flow.methods import FlowMethod
from tactile_nodes.sensing.picture.motion import MotionFit
from tactile_nodes.shapes import Bool, Float, Float32, UInt8

PATCHES = 10
FOUND = 0.4
"""Least confidence of a found patch: 0.99 at rest, 0.8 after a knock by 2 px, 0.00 on another gel."""

LEAST_FOUND = 0.3
"""Share of the patches that must be found for the other numbers to be valid."""

ROUNDS = 4
FAR_PX = 0.05
"""Patches further than this from the common motion, as in a touch, have less than a quarter of the weight."""

QUIET_PX, QUIET_SHARE = 0.025, 0.25
"""A picture is quiet if 19 of 20 patches follow the common motion to within this many pixels plus this share of it.

Noise leaves 0.006 px (0.02 px in a fifth of the light), a touch 0.3 mm deep 0.045 px. A camera that tilts moves the
rim by a seventh less than the middle, which the common motion does not model.
"""


ANOTHER_PX = 0.32
"""Apparent motion of 19 of 20 patches without real motion, per share of the pattern lost: 0.06 px with a tenth of the
markers gone (0.81 of the pattern is left), 0.10 with a fifth (0.66), 0.05 blurred by 1 px (0.78). A touch of 0.3 mm
leaves 0.99 and a dent of 0.04 px, one of 1 mm 0.99 and 0.25 px."""


@dataclass(frozen=True)
class PictureChange:
    """One picture compared with an earlier one.

    The common motion is shift + turn + growth about the middle of the picture: `shift_px` (right, down), `turn_deg`
    (clockwise as seen), `growth` (0.001: a thousandth larger). `size_px` is its root mean square over the patches,
    `middle_px` the length of the median motion. `left_px` is the largest residual motion of 19 of 20 patches, after
    the common motion and the bends of a tilted camera. `found` is the share of the patches found again, `alike` how
    much of its pattern the median patch still shows. `contrast` is the ratio of now to then. Numbers that a completely
    different picture cannot give are NaN.
    """

    found: float
    contrast: float
    shift_px: tuple[float, float] = (math.nan, math.nan)
    turn_deg: float = math.nan
    growth: float = math.nan
    size_px: float = math.nan
    middle_px: float = math.nan
    left_px: float = math.nan
    alike: float = math.nan

    @property
    def same(self) -> bool:
        """Whether the picture shows the same pattern."""
        return self.found >= LEAST_FOUND

    @property
    def quiet(self) -> bool:
        """Whether the whole picture moved uniformly, as without a touch."""
        return self.same and self.apart_px <= QUIET_PX

    @property
    def apart_px(self) -> float:
        """Independent motion of some patches: `left_px` minus the residual that any common motion leaves."""
        return max(0.0, self.left_px - QUIET_SHARE * self.size_px)

    @property
    def dented_px(self) -> float:
        """`apart_px` minus the apparent motion of patches whose pattern changed, as when markers are gone."""
        return max(0.0, self.apart_px - ANOTHER_PX * (1 - self.alike))


class PictureComparison:
    """Compares pictures with an earlier one.

    Raises:
        ImageError: the earlier picture has too little pattern, or is too small.
    """

    def __init__(self, earlier: UInt8[np.ndarray, 'h w']) -> None:
        self._flow: FlowMethod = InverseCompositionalFlow(
            InverseCompositionalOptions(rows=PATCHES, cols=PATCHES, finest_scale=1)
        )
        self._flow.set_reference(earlier)
        self._shape = earlier.shape
        itself = self._flow.displacement(earlier).confidence
        assert itself is not None
        self._known = itself >= FOUND
        if self._known.mean() < LEAST_FOUND:
            raise ImageError(f'only {self._known.mean():.0%} of the rest image shows a pattern; check light and focus')
        self._contrast = _contrast(earlier)
        self._places = _places(earlier.shape)[self._known]
        self._fit = MotionFit(earlier.shape, PATCHES, PATCHES)

    def of(self, picture: UInt8[np.ndarray, 'h w']) -> PictureChange:
        """The change from the earlier picture to this one.

        Raises:
            ImageError: the picture has another size.
        """
        if picture.shape != self._shape:
            raise ImageError(
                f'an image of {picture.shape[1]}x{picture.shape[0]} pixels cannot be compared with one of '
                f'{self._shape[1]}x{self._shape[0]}; set camera and crop as they were'
            )
        field = self._flow.displacement(picture)
        assert field.confidence is not None
        found = (field.confidence >= FOUND)[self._known]
        contrast = float(np.median((_contrast(picture) / np.maximum(self._contrast, 0.1))[self._known]))
        if found.mean() < LEAST_FOUND:
            return PictureChange(float(found.mean()), contrast)
        left_px = self._left_px(field.displacement_px, field.confidence)
        change = _change(field.displacement_px[self._known], self._places, found, contrast)
        alike = float(np.median(field.confidence[self._known]))
        return replace(change, left_px=left_px, alike=alike)

    def _left_px(
        self, motion: Float32[np.ndarray, 'rows cols 2'], confidence: Float32[np.ndarray, 'rows cols']
    ) -> float:
        """Largest residual motion of 19 of 20 patches after all camera motion, the bends of a tilt included."""
        found = (self._known & (confidence >= FOUND)).reshape(-1)
        moved = motion.reshape(-1, 2).astype(float)
        away = np.hypot(*(moved - self._fit.carried(self._fit.common(moved, found.astype(float)))).T)
        return float(np.percentile(away[found], 95))


def _change(
    motion: Float32[np.ndarray, 'n 2'],
    places: Float[np.ndarray, 'n 2'],
    found: Bool[np.ndarray, ' n'],
    contrast: float,
) -> PictureChange:
    moved, at = motion[found].astype(float), places[found]
    middle = np.median(moved, axis=0)
    common = common_motion(moved, at)
    carried = _carried(common, at)
    return PictureChange(
        found=float(found.mean()),
        contrast=contrast,
        shift_px=(float(common[0]), float(common[1])),
        turn_deg=math.degrees(common[3]),
        growth=float(common[2]),
        size_px=float(np.sqrt(np.square(carried).sum(axis=1).mean())),
        middle_px=float(np.hypot(*middle)),
    )


def common_motion(motion: Float[np.ndarray, 'n 2'], places: Float[np.ndarray, 'n 2']) -> Float[np.ndarray, ' 4']:
    """Shift right and down (px), growth and turn (rad) that most patches follow. Other patches have little weight.

    Iteratively reweighted least squares with weights 1 / (1 + (r / 0.05 px)²)², starting at the median motion.
    """
    x, y = places.T
    zero, one = np.zeros_like(x), np.ones_like(x)
    design = np.concatenate([np.column_stack([one, zero, x, -y]), np.column_stack([zero, one, y, x])])
    observed = np.concatenate([motion[:, 0], motion[:, 1]])
    common = np.array([*np.median(motion, axis=0), 0.0, 0.0])
    scale = max(FAR_PX, float(np.median(np.hypot(*(motion - common[:2]).T))))
    for _ in range(ROUNDS):
        away = np.square(observed - design @ common).reshape(2, -1).sum(axis=0)
        weight = np.tile(1 / (1 + away / scale**2), 2)  # the root of the weight
        common = np.linalg.lstsq(design * weight[:, None], observed * weight, rcond=None)[0]
        scale = max(FAR_PX, scale / 2)
    return common


def _carried(common: Float[np.ndarray, ' 4'], places: Float[np.ndarray, 'n 2']) -> Float[np.ndarray, 'n 2']:
    right, down, growth, turn = common
    x, y = places.T
    return np.column_stack([right + growth * x - turn * y, down + growth * y + turn * x])


def _places(shape: tuple[int, ...]) -> Float[np.ndarray, 'rows cols 2']:
    """Centre of each patch in px, relative to the middle of the picture."""
    down, right = ((np.arange(PATCHES) + 0.5) * side / PATCHES - side / 2 for side in shape)
    return np.stack(np.meshgrid(right, down), axis=-1)


def _contrast(picture: UInt8[np.ndarray, 'h w']) -> Float32[np.ndarray, 'rows cols']:
    """Standard deviation of each patch's grey, after smoothing of the pixel noise."""
    smooth = cv2.GaussianBlur(picture, (0, 0), 1.0).astype(np.float32)
    size = (PATCHES, PATCHES)
    mean = cv2.resize(smooth, size, interpolation=cv2.INTER_AREA)
    square = cv2.resize(smooth * smooth, size, interpolation=cv2.INTER_AREA)
    spread: np.ndarray = np.sqrt(np.maximum(square - mean * mean, 0))
    return spread
