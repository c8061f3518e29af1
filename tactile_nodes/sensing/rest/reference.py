"""The rest image: the mean of several frames of the untouched gel, and its id."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np

from tactile_nodes.errors import ImageError
from tactile_nodes.shapes import UInt8


def average(frames: Sequence[UInt8[np.ndarray, 'h w']]) -> UInt8[np.ndarray, 'h w']:
    """Mean of several frames at rest, rounded to 8 bit.

    The noise of a single rest frame biases every displacement measured against it. Averaging n frames lowers the
    noise by sqrt(n). Frames of 10 and 13 give 12 (11.5, halves up).

    Raises:
        ImageError: no frame, or frames of different sizes.
    """
    accumulator = RestAccumulator()
    for frame in frames:
        accumulator.add(frame)
    return accumulator.image()


class RestAccumulator:
    """Averages rest frames as they arrive."""

    def __init__(self) -> None:
        self._sum: np.ndarray | None = None
        self.count = 0

    def add(self, frame: UInt8[np.ndarray, 'h w']) -> None:
        """Take one more frame.

        Raises:
            ImageError: its size differs from the frames before.
        """
        if self._sum is None:
            self._sum = np.zeros(frame.shape, np.uint32)
        if frame.shape != self._sum.shape:
            raise ImageError(
                f'the frames for the rest image differ in size, {frame.shape[::-1]} after {self._sum.shape[::-1]}; '
                'do not change the camera settings while the rest image is captured'
            )
        self._sum += frame
        self.count += 1

    def image(self) -> UInt8[np.ndarray, 'h w']:
        """The mean so far.

        Raises:
            ImageError: there is no frame yet.
        """
        if self._sum is None:
            raise ImageError('there is no frame for a rest image; check that the camera delivers images')
        mean: np.ndarray = ((2 * self._sum + self.count) // (2 * self.count)).astype(np.uint8)
        return mean


def content_id(image: UInt8[np.ndarray, 'h w']) -> str:
    """The id of an image: 12 hexadecimal digits of the SHA-256 of its size and pixels."""
    digest = hashlib.sha256(repr(image.shape).encode())
    digest.update(np.ascontiguousarray(image).tobytes())
    return digest.hexdigest()[:12]
