"""Decides from one frame whether anything touches the gel, at a fraction of the cost of measuring motion.

The image at half size is divided into blocks. In each, the difference from the rest image is split into four known
parts (brightness, contrast, and motion along x and y: the first step of inverse compositional Lucas-Kanade) and a
residual. With noise alone each part is as large as one pixel's noise, which the residual estimates. A touch moves
markers away from it or towards it, all around. So the check computes how much motion points away from each of many
places, and how much is alike in neighbouring blocks, as after a knock of the camera. A frame is still if neither
exceeds noise, and if light, sharpness and all parts of the picture are unchanged. The result depends only on the two
images and the options.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.sensing.compiling import compiled_loops
from tactile_nodes.sensing.flow.methods import require_grey, require_like
from tactile_nodes.sensing.flow.patches import SLOPE_STEP_PX, moved_image, rounded, shrunk
from tactile_nodes.sensing.geometry import camera_motions
from tactile_nodes.sensing.picture.touch_places import TouchPlaces
from tactile_nodes.shapes import Float32, UInt8

LARGEST_LIGHT_SHARE = 0.03
"""If a block's brightness or contrast changed by more than this, the light changed."""

LARGEST_UNEVENNESS = 2.0
"""Largest residual variance of a block, over that of the median block."""

TOUCH_UNEVENNESS = 1.3, 64.0
"""A touch with a motion of m times the noise leaves an unevenness of 1.3 + (m / 64)²: 4 at 74 mN, 95 at 0.4 N."""

UNEXPLAINED = 4.0
"""Multiple of a touch's unevenness from which a part of the picture changed: dirt leaves 500, a hot spot 13 to 2500."""

PLAIN_UNEVENNESS = 2.4
"""Unevenness of the whole change, motion and light included, beyond which no closer check is needed."""

SPREAD_BLOCKS = 1.0
"""Standard deviation of the Gaussian that averages motion over neighbouring blocks."""

FREEDOM = 1.15
"""Noise makes motion in any direction larger by this than motion away from a place, as it varies in two numbers."""

SMALLEST_BLOCK_PX = 6
"""Smallest side of a block at half size. Smaller blocks leave too little residual to estimate the noise."""


@dataclass(frozen=True)
class StillnessOptions:
    """When a frame counts as still.

    Motion is in units of its noise. `limit` is the largest at any place (noise exceeds 3.8 in one frame of five).
    `most_noise_grey` is the largest pixel noise (standard deviation, grey levels) of a still frame. Of the still
    frames, one in `full_every` is measured all the same, so that monitors of slow changes still get some motion; 1
    measures all. `blocks` x `blocks` cover the image.
    """

    limit: float = 3.8
    most_noise_grey: float = 3.0
    full_every: int = 32
    blocks: int = 10


@dataclass(frozen=True)
class Stillness:
    """How still one frame is: motion in units of its noise, and other changes.

    `noise_grey` is the pixel noise of the image, `light_share` the largest change of light of any block, and
    `unevenness` the largest residual variance of any block over that of the median block.
    """

    motion: float
    noise_grey: float
    light_share: float
    unevenness: float

    def within(self, options: StillnessOptions) -> bool:
        """Whether nothing touches and nothing has changed. False for NaN."""
        return (
            self.motion <= options.limit
            and self.noise_grey <= options.most_noise_grey
            and self.light_share <= LARGEST_LIGHT_SHARE
            and self.unevenness <= LARGEST_UNEVENNESS
        )

    @property
    def unexplained(self) -> bool:
        """Whether a part of the picture changed in a way that no touch causes."""
        least, scale = TOUCH_UNEVENNESS
        return not self.unevenness <= UNEXPLAINED * (least + (self.motion / scale) ** 2)


STEADY_MOTION, STEADY_LIGHT_SHARE = 8.0, 0.08
"""Largest motion, in units of its noise, and change of light between frames of a rest image. 5 mN cause a motion of
8.5; noise of single frames causes 4.7, and changes the light of the darkest block by 0.04."""


PRESSED = 1.7
"""Least ratio of motion away from a place to motion towards any, under a wide press. It is 2.1 and more for ninety
contacts of ten families (0.06 to 3 N), 0.5 and less for their release, and 1.4 and less for a knocked, turned or
slightly nearer camera."""


REMAINS = 0.25
"""Share of the motion alike in neighbouring blocks that remains after camera motion is removed: at most 0.16 for camera
motion, 0.36 and more for contacts. Motion too large for this check ends up in the residual."""


def steady(stillness: Stillness) -> bool:
    """Whether a frame shows the same as a mean of many, as required of frames that differ only in dead pixels."""
    return stillness.motion <= STEADY_MOTION and stillness.light_share <= STEADY_LIGHT_SHARE


class StillnessCheck:
    """Compares images with one rest image, `reference`, for which everything is precomputed."""

    def __init__(self, options: StillnessOptions | None = None, *, compiled: bool = False) -> None:
        self.options, self._compiled = options or StillnessOptions(), compiled
        _require_possible(self.options)
        self.reference: np.ndarray | None = None
        self._able = False
        self._parts: np.ndarray
        self._rest: np.ndarray
        self._light: np.ndarray
        self._contrast: np.ndarray
        self._rounded: tuple[np.ndarray, np.ndarray]
        self._places: TouchPlaces
        self._camera: np.ndarray
        self._average = _averaging(self.options.blocks)

    def set_reference(self, image: UInt8[np.ndarray, 'h w']) -> None:
        """Take `image` as the rest image. Images that are too small for the blocks never count as still.

        Raises:
            ImageError: the image is not 8 bit grey, or too small for any motion.
        """
        require_grey(image)
        self.reference = image.copy()
        self._able = min(image.shape) // 2 // self.options.blocks >= SMALLEST_BLOCK_PX
        if not self._able:
            return
        model = self._model(image.astype(np.float32))
        basis, triangle = np.linalg.qr(model)
        size = np.einsum('bkk->bk', triangle)
        # The sign of an axis is arbitrary, but neighbours are compared, so it must be the same everywhere.
        basis *= np.where(size < 0, -1.0, 1.0)[:, None]
        self._places = TouchPlaces(self.options.blocks, np.abs(size[:, 2:]))
        blocks, (height, width) = self.options.blocks, image.shape
        motions = camera_motions(blocks, blocks, width / height) * np.abs(size[:, 2:, None])
        self._camera = np.linalg.qr(motions.reshape(-1, motions.shape[-1]))[0]
        self._parts = np.ascontiguousarray(basis.transpose(0, 2, 1), np.float32)
        self._rounded = rounded(np.ascontiguousarray(basis.transpose(0, 2, 1)))
        self._rest = shrunk(image)
        self._light = np.maximum(np.square(self._blocks(self._rest).astype(np.float32)).sum(axis=1), 1.0)
        self._contrast = np.maximum(np.abs(size[:, 1]), 1e-6).astype(np.float32)

    def __call__(self, image: UInt8[np.ndarray, 'h w']) -> bool:
        """Whether a frame is still and need not be measured.

        Raises:
            ImageError: size or type differ from the rest image, or there is no rest image yet.
        """
        return self.judged(image)[0]

    def judged(self, image: UInt8[np.ndarray, 'h w']) -> tuple[bool, Stillness | None]:
        """As a call, and how still the frame is, or None if no closer check was needed.

        Raises:
            ImageError: as above.
        """
        require_like(self.reference, image)
        if not self._able:
            return False, None
        small = shrunk(image, compiled=self._compiled)
        stillness = self._measured(small, closely=False)
        if stillness is None or not stillness.within(self.options):
            return False, stillness
        # Noise makes the sum of the pixels a random number, and a replay gives the same one.
        return int(cv2.sumElems(small)[0]) % self.options.full_every > 0, stillness

    @property
    def able(self) -> bool:
        """Whether the rest image is large enough for the blocks."""
        return self._able

    def look(self, image: UInt8[np.ndarray, 'h w']) -> Stillness:
        """How still a frame is. The rest image must not be too small.

        Raises:
            ImageError: as above.
        """
        require_like(self.reference, image)
        assert self._able
        stillness = self._measured(shrunk(image), closely=True)
        assert stillness is not None
        return stillness

    def same(self, image: UInt8[np.ndarray, 'h w']) -> bool:
        """Whether a frame shows the same as the reference, also a single frame, except for the noise of both.

        Part of the reference's contrast c is its own noise: n s² / c for n pixels with a noise of s. In a block without
        markers that exceeds any change of light. Without that part the two noises leave s² (2 - n s² / c²) in a pixel.
        `pattern` is the share of the contrast that is not noise. Images too small for the blocks all count as the same.

        Raises:
            ImageError: as above.
        """
        require_like(self.reference, image)
        if not self._able:
            return True
        part, left = self._split(image)
        pattern = np.sqrt(np.maximum(1 - self._parts.shape[2] * left / np.square(self._contrast), 0.0))
        part[:, 1] = pattern * (part[:, 1] + self._contrast * (1 - pattern))
        lit = np.square(part[:, :2]).sum(axis=1)
        if (lit > np.maximum(STEADY_LIGHT_SHARE**2 * self._light, STEADY_MOTION**2 * left)).any():
            return False
        return self._largest(part[:, 2:]) <= STEADY_MOTION * math.sqrt(_middle(left))

    def pressed(self, image: UInt8[np.ndarray, 'h w']) -> bool:
        """Whether something presses that did not in the reference: more motion points away from it than towards it.

        Motion explained by the camera does not count, nor does the end of a touch. Around a small body motion away from
        it exceeds the motion alike in neighbouring blocks. Around a wide one, motion away exceeds motion towards.

        Raises:
            ImageError: as above.
        """
        require_like(self.reference, image)
        if not self._able:
            return False
        part, left = self._split(image)
        seen, noise = part[:, 2:], math.sqrt(_middle(left))
        motion = self._without_camera(seen)
        away = self._places.away(motion)
        least, towards = max(STEADY_MOTION * noise, REMAINS * self._alike(seen)), float(-away.min())
        return float(away.max()) > max(least, towards, min(self._alike(motion), PRESSED * towards))

    def _without_camera(self, motion: Float32[np.ndarray, 'blocks 2']) -> Float32[np.ndarray, 'blocks 2']:
        """Motion minus the least-squares fit of a camera that moves right, down, rolls and comes nearer."""
        seen = motion.reshape(-1)
        own: np.ndarray = (seen - self._camera @ (self._camera.T @ seen)).reshape(motion.shape).astype(np.float32)
        return own

    def _split(self, image: UInt8[np.ndarray, 'h w']) -> tuple[np.ndarray, np.ndarray]:
        """The four parts of each block's change, and the residual variance."""
        change = self._blocks(cv2.subtract(shrunk(image), self._rest, dtype=cv2.CV_32F))
        part = np.matmul(self._parts, change[:, :, None])[:, :, 0].astype(np.float32)
        left = np.maximum(np.square(change).sum(axis=1) - np.square(part).sum(axis=1), 1e-6)
        return part, (left / (change.shape[1] - part.shape[1])).astype(np.float32)

    def _measured(self, small: UInt8[np.ndarray, 'h w'], *, closely: bool) -> Stillness | None:
        """How still a frame is, or None if blocks changed so much, as under most presses, that no check is needed.

        No split into parts could make such blocks even. `closely`: check all the same.
        """
        plain = (math.inf, 0.0) if closely else (PLAIN_UNEVENNESS, LARGEST_LIGHT_SHARE**2)
        if self._compiled:
            motion = np.empty((len(self._light), 2), np.float32)
            worth, *numbers = compiled_loops().looked(small, self._rest, self._rounded, self._light, plain, motion)
            return self._stillness(motion, *numbers) if worth else None
        change = self._blocks(cv2.subtract(small, self._rest, dtype=cv2.CV_32F))
        energy = np.einsum('bn,bn->b', change, change)
        if (energy > plain[0] * _middle(energy) + plain[1] * self._light).any():
            return None
        part = np.matmul(self._parts, change[:, :, None])[:, :, 0]
        squared = np.square(part)
        left = np.maximum(energy - squared.sum(axis=1), 1e-6)
        left /= change.shape[1] - part.shape[1]
        share = float((squared[:, :2].sum(axis=1) / self._light).max())
        return self._stillness(part[:, 2:], middle := _middle(left), share, float(left.max()) / middle)

    def _stillness(
        self, motion: Float32[np.ndarray, 'blocks 2'], variance: float, light: float, unevenness: float
    ) -> Stillness:
        """The result in units of noise. A pixel at half size is the mean of four."""
        noise = math.sqrt(variance)
        return Stillness(self._largest(motion) / noise, 2 * noise, math.sqrt(light), unevenness)

    def _largest(self, motion: Float32[np.ndarray, 'blocks 2']) -> float:
        """The largest motion away from a place or alike in neighbours. Noise of 1 gives 1 per axis."""
        return max(self._places.most(motion, compiled=self._compiled), self._alike(motion))

    def _alike(self, motion: Float32[np.ndarray, 'blocks 2']) -> float:
        """The largest motion that is alike in neighbours, on the same scale."""
        return math.sqrt(np.square(self._average @ motion).sum(axis=1).max()) / FREEDOM

    def _model(self, full: Float32[np.ndarray, 'h w']) -> np.ndarray:
        """Brightness, contrast and motion along x and y: (blocks, pixels, 4), the third and fourth per pixel moved."""

        def moved(right_px: float, down_px: float) -> np.ndarray:
            return shrunk(moved_image(full, 2 * right_px, 2 * down_px)).astype(np.float64)

        step = SLOPE_STEP_PX
        still = moved(0.0, 0.0)
        along_x = (moved(step, 0.0) - moved(-step, 0.0)) / (2 * step)
        along_y = (moved(0.0, step) - moved(0.0, -step)) / (2 * step)
        return np.stack([self._blocks(each) for each in (np.ones_like(still), still, along_x, along_y)], axis=-1)

    def _blocks(self, small: np.ndarray) -> np.ndarray:
        """The pixels of each block. Leftover pixels at the right and lower rim, fewer than blocks, are ignored."""
        count = self.options.blocks
        height, width = (side // count for side in small.shape)
        cut = small[: height * count, : width * count].reshape(count, height, count, width)
        blocks: np.ndarray = cut.swapaxes(1, 2).reshape(count * count, height * width)
        return blocks


def _middle(values: Float32[np.ndarray, ' blocks']) -> float:
    return float(np.partition(values, len(values) // 2)[len(values) // 2])


def _averaging(count: int) -> Float32[np.ndarray, 'blocks blocks']:
    """Averages over neighbours, scaled such that independent noise of 1 gives 1."""
    apart = np.arange(count) - np.arange(count)[:, None]
    along = np.exp(-0.5 * np.square(apart / SPREAD_BLOCKS))
    along /= np.sqrt(np.square(along).sum(axis=1, keepdims=True))
    return np.kron(along, along).astype(np.float32)


def _require_possible(options: StillnessOptions) -> None:
    if options.blocks < 1 or options.full_every < 1 or not options.limit > 0 or not options.most_noise_grey > 0:
        raise ConfigurationError(
            f'the stillness check needs at least one block, full_every of at least 1, and limits above 0, got {options}'
        )
