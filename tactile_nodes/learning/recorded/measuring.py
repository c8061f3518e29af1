"""Features of recorded images, each measured once.

Results are stored by their input: rest image, image, method and options. It therefore makes no difference which bag an
image came from, and an interrupted run continues where it stopped.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence

import cv2
import numpy as np

from tactile_nodes import paths
from tactile_nodes.errors import ImageError
from tactile_nodes.learning.config import Choice
from tactile_nodes.learning.recorded.feature_cache import FeatureCache, Measured
from tactile_nodes.sensing.features import Features, make_encoding
from tactile_nodes.sensing.flow.choice import MEASURING, code_id, make_flow
from tactile_nodes.sensing.flow.dots import DotsFlow
from tactile_nodes.sensing.geometry import centre_crop, largest_side
from tactile_nodes.sensing.picture import moved_dots
from tactile_nodes.sensing.picture.quality import require_picture
from tactile_nodes.sensing.picture.registration import NEGLIGIBLE_PX
from tactile_nodes.sensing.rest.moved_camera import MovedCamera, common_motion
from tactile_nodes.sensing.rest.prepared import Measuring, PreparedRest
from tactile_nodes.sensing.rest.reference import average, content_id
from tactile_nodes.shapes import UInt8

RECIPE = 1
"""Increased when the code below gives other features for the same images and options."""
CODE = (*MEASURING, 'picture/*.py', 'rest/*.py')
"""The code that measures motion, and that which removes the camera's."""


class Measurer:
    """Measures features of images against the last rest image that was set.

    Args:
        flow, encoding: the methods, by name and options.
        crop: side of the square cut from the middle of each image, px (smaller images are cut to what fits), or width
            and height of a rectangle.

    Raises:
        ConfigurationError: no such method or option, or the folder of the cache cannot be created.
    """

    def __init__(self, flow: Choice, encoding: Choice, crop: int | tuple[int, int] = 440) -> None:
        self.flow, self.encoding = make_flow(flow.name, flow.options), make_encoding(encoding.name, encoding.options)
        self.size = 0, 0
        self.reference_id = ''
        self.computed = self.found = 0
        self._rest: PreparedRest | None = None
        self._crop = (crop, crop) if isinstance(crop, int) else crop
        self._reference = b''
        self._shape = 0, 0, 0
        self._camera: MovedCamera | None = None
        self._least_px = moved_dots.KNOCK_PX if isinstance(self.flow, DotsFlow) else NEGLIGIBLE_PX
        self._cache = FeatureCache(paths.cache_directory('features') / f'{self.recipe_id}.sqlite')

    @property
    def recipe_id(self) -> str:
        """Sixteen hexadecimal digits of a hash over everything except the images that features depend on."""
        chosen = {
            'recipe': [RECIPE, code_id(measuring=CODE)],
            'opencv': cv2.__version__,
            'flow': [self.flow.name, self.flow.options],
            'encoding': [self.encoding.name, self.encoding.options],
        }
        return hashlib.sha256(json.dumps(chosen, sort_keys=True).encode()).hexdigest()[:16]

    def use_reference(self, image: UInt8[np.ndarray, 'h w']) -> None:
        """Measure against this rest image from now on.

        Raises:
            ImageError: it cannot be used as reference, or has another size than those before.
        """
        cut = self.cut(image)
        if (name := content_id(cut)) == self.reference_id:
            return
        registers = not isinstance(self.flow, DotsFlow)
        self._rest = Measuring(self.flow, self.encoding, registers=registers).beside(cut)
        self._camera = MovedCamera(self._rest)
        self.reference_id, self._reference = name, cut.tobytes()
        self._shape = (*self._rest.still_features.confidence.shape, len(self.encoding.channels))

    @property
    def rest_image(self) -> UInt8[np.ndarray, 'h w']:
        """The current rest image, as cropped; it has no rows before the first is set."""
        return np.zeros((0, 0), np.uint8) if self._rest is None else self._rest.image

    def look_before(self, untouched: Sequence[UInt8[np.ndarray, 'h w']]) -> None:
        """Take images of the untouched gel. If the camera has moved since the rest image, that motion is removed from
        now on, as live sensing does.

        Raises:
            ImageError: they do not show the pattern of the rest image, or as `measure`.
        """
        if self._rest is None:
            return
        self._camera = MovedCamera(self._rest)
        if not untouched:
            return
        found = self.measure(untouched)
        _, size_px = common_motion(self._rest, Features(self.encoding.name, found.values, found.confidence))
        if size_px >= self._least_px:
            self._camera = MovedCamera(self._rest, self._mean(untouched))

    def measure(self, images: Sequence[UInt8[np.ndarray, 'h w']], *, pressed: bool = False) -> Measured:
        """Features of the mean of some images (of one image: of that image).

        Of a gel that is `pressed`, motion of the whole picture is removed if live sensing takes it for a knock.

        Raises:
            ImageError: an image is black, overexposed or of another size than the rest image.
        """
        for image in images:
            require_picture(image)
        cut = self._mean(images)
        moved = self._camera.untouched if self._camera else None
        before = b'' if moved is None else moved.tobytes()
        content = repr(cut.shape).encode() + self._reference + cut.tobytes() + before + b'pressed' * pressed
        key = hashlib.sha256(content).digest()
        if kept := self._cache.get(key, self._shape):
            self.found += 1
            return kept
        if self._camera is None:
            raise ImageError('there is no rest image yet; leave the gel untouched while one is captured')
        features = self._camera.features(cut, pressed=pressed)
        measured = Measured(features.values.astype(np.float16), features.confidence)
        self._cache.put(key, measured)
        self.computed += 1
        return measured

    def _mean(self, images: Sequence[UInt8[np.ndarray, 'h w']]) -> UInt8[np.ndarray, 'ch cw']:
        return self.cut(average(images) if len(images) > 1 else images[0])

    def close(self) -> None:
        """Close the cache."""
        self._cache.close()

    def __enter__(self) -> Measurer:
        return self

    def __exit__(self, *args: object) -> None:
        self.close()

    def cut(self, image: UInt8[np.ndarray, 'h w']) -> UInt8[np.ndarray, 'ch cw']:
        """The part of an image that is measured. Raises ImageError: it has another size than those before."""
        size = self._size(image)
        if self.size not in ((0, 0), size):
            came, gave = (f'{width}x{height}' for width, height in (image.shape[::-1], self.size))
            raise ImageError(f'the image has {came} pixels, earlier ones had {gave}')
        self.size = size
        return np.ascontiguousarray(centre_crop(image, *size))

    def _size(self, image: UInt8[np.ndarray, 'h w']) -> tuple[int, int]:
        if self._crop[0] != self._crop[1]:
            return self._crop
        height, width = image.shape
        rows, cols = (int(str(self.encoding.options[name])) for name in ('rows', 'cols'))
        side = largest_side(width, height, self._crop[0], math.lcm(rows, cols))
        return side, side
