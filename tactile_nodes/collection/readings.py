"""The last seconds of force samples and images, shared between receiving threads and the pressing thread."""

from __future__ import annotations

import itertools
import math
import threading
from collections import deque
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from tactile_nodes.clock import NS_PER_S
from tactile_nodes.drivers.force_torque.contract import Sample
from tactile_nodes.errors import ImageError

Picture = npt.NDArray[np.uint8]
BLOCK_PX = 16
KEPT_S, KEPT_FRAMES = 20, 90
KEPT_NS = KEPT_S * NS_PER_S


class Frame:
    """An image and its capture stamp; `look` returns the image, and is called once, on demand."""

    def __init__(self, stamp_ns: int, look: Callable[[], Picture]) -> None:
        self.stamp_ns = stamp_ns
        self._look = look

    @cached_property
    def image(self) -> Picture:
        return self._look()

    @cached_property
    def blocks(self) -> npt.NDArray[np.float32]:
        """Mean grey level of each block of 16x16 pixels; incomplete blocks at the right and bottom are left out.

        Raises:
            ImageError: the image is smaller than a block.
        """
        return _block_means(self.image)


def frame_of(stamp_ns: int, image: Picture) -> Frame:
    """A frame with an image that is already available, with its blocks.

    Raises:
        ImageError: it is smaller than a block.
    """
    frame = Frame(stamp_ns, lambda: image)
    _ = frame.blocks
    return frame


def change(a: Frame, b: Frame) -> float:
    """The largest change of a block's mean in grey levels: a press changes few pixels, but those by much.

    Raises:
        ImageError: they differ in size.
    """
    if a.blocks.shape != b.blocks.shape:
        raise ImageError('the image size has changed; do not change camera settings during a run')
    return float(np.abs(a.blocks - b.blocks).max())


def _block_means(image: npt.NDArray[np.unsignedinteger]) -> npt.NDArray[np.float32]:
    rows, columns = image.shape[0] // BLOCK_PX, image.shape[1] // BLOCK_PX
    if not rows or not columns:
        raise ImageError(f'received an image of {image.shape[1]}x{image.shape[0]} pixels, which is too small')
    cut = image[: rows * BLOCK_PX, : columns * BLOCK_PX]
    sums = np.add.reduceat(cut, np.arange(0, cut.shape[1], BLOCK_PX), axis=1, dtype=np.uint32)
    sums = np.add.reduceat(sums, np.arange(0, cut.shape[0], BLOCK_PX), axis=0)
    return (sums / BLOCK_PX**2).astype(np.float32)


def pattern_change(a: Frame, b: Frame) -> float:
    """The largest root mean square, over a block, of the change of its pixels: markers that move in a block count.

    Noise of 3 grey levels in both gives a little more than 4.2; a tip 0.8 mm deep in the paper's gel gives 16.

    Raises:
        ImageError: they differ in size.
    """
    if a.image.shape != b.image.shape:
        raise ImageError('the image size has changed; do not change camera settings during a run')
    square = np.square(a.image.astype(np.int32) - b.image).astype(np.uint32)
    return math.sqrt(float(_block_means(square).max()))


class Readings:
    """Stores the last samples and images. Thread-safe."""

    def __init__(self) -> None:
        self._samples: deque[Sample] = deque()
        self._frames: deque[Frame] = deque(maxlen=KEPT_FRAMES)
        self._lock = threading.Lock()

    def put_sample(self, sample: Sample) -> None:
        with self._lock:
            self._samples.append(sample)
            while self._samples[0].stamp_ns < sample.stamp_ns - KEPT_NS:
                self._samples.popleft()

    def put_frame(self, frame: Frame) -> None:
        with self._lock:
            self._frames.append(frame)

    def samples(self, start_ns: int) -> list[Sample]:
        """Those measured from `start_ns` on."""
        with self._lock:
            return _since(self._samples, start_ns)

    def frames(self, start_ns: int) -> list[Frame]:
        """Those taken from `start_ns` on."""
        with self._lock:
            return _since(self._frames, start_ns)


def _since(kept: deque[Any], start_ns: int) -> list[Any]:
    return [*itertools.takewhile(lambda item: item.stamp_ns >= start_ns, reversed(kept))][::-1]
