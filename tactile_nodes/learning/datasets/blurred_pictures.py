"""Pictures as a lens out of focus would have shown them, made of those that were taken.

A blur takes a picture's noise away with its detail, and a lens does not: so noise is added as the camera has it, as
told by pictures of the same scene. Without, motion beside a rest image would be read further than it is live.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

LEAST_FRAMES = 2
REACH = 4
"""Half the width of the blur's kernel, in its standard deviations."""


@dataclass(frozen=True)
class PictureNoise:
    """Variance of one picture's pixels: `read` + `shot` times their grey."""

    read: float = 0.0
    shot: float = 0.0

    @classmethod
    def of(cls, frames: Sequence[UInt8[np.ndarray, 'h w']]) -> PictureNoise:
        """From pictures of one scene; none of fewer than two. Dark and bright pixels count as their scatter allows."""
        if len(frames) < LEAST_FRAMES:
            return cls()
        stack = np.stack(frames).astype(np.float32)
        grey, variance = stack.mean(axis=0).ravel(), stack.var(axis=0, ddof=1).ravel()
        design = np.column_stack([np.ones_like(grey), grey]).astype(float)
        weight = np.ones_like(grey)
        for _ in range(2):  # a variance scatters in proportion to itself
            read, shot = np.linalg.lstsq(design * weight[:, None], variance * weight, rcond=None)[0].tolist()
            weight = 1 / np.maximum(read + shot * grey, 0.1)
        return cls(max(read, 0.0), max(shot, 0.0))


class SoftwareBlur:
    """Blurs pictures by a Gaussian of `sigma_px`, and gives them their noise back.

    The same pictures in the same order with the same `seed` become the same.
    """

    def __init__(self, sigma_px: float, noise: PictureNoise, seed: int = 0) -> None:
        along = cv2.getGaussianKernel(2 * int(np.ceil(REACH * sigma_px)) + 1, sigma_px)
        self._kernel = along.astype(np.float32)
        self._lost = 1 - float(np.square(along).sum()) ** 2
        self._noise, self._random = noise, np.random.default_rng(seed)

    def __call__(self, image: UInt8[np.ndarray, 'h w']) -> UInt8[np.ndarray, 'h w']:
        """The picture out of focus."""
        soft: Float32[np.ndarray, 'h w'] = cv2.sepFilter2D(
            image.astype(np.float32), -1, self._kernel, self._kernel, borderType=cv2.BORDER_REFLECT_101
        )
        lost = np.float32(self._lost) * (np.float32(self._noise.read) + np.float32(self._noise.shot) * soft)
        soft = soft + np.sqrt(lost) * self._random.standard_normal(soft.shape, dtype=np.float32)
        made: np.ndarray = np.clip(np.rint(soft), 0, 255).astype(np.uint8)
        return made
