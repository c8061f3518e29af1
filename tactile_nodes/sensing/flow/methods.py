"""Flow methods: from rest image and image to the displacement of every pixel or patch, behind one protocol.

A method is chosen by name and options: see `tactile_nodes.sensing.flow.choice`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Protocol, get_args, get_origin, get_type_hints, runtime_checkable

import cv2
import numpy as np

from tactile_nodes.errors import ConfigurationError, ImageError
from tactile_nodes.shapes import Float32, UInt8


@dataclass(frozen=True)
class DisplacementField:
    """Displacement of the content of the rest image: [..., 0] = x to the right, [..., 1] = y down, in pixels.

    A dense method gives one displacement per pixel. A method by patches gives one per patch, evenly spaced over the
    image; then h x w are the rows and columns of the patches. `confidence` is between 0 (no information) and 1, or None
    if the method does not state it. `noise_px` is the standard deviation of the displacement along an axis as the
    method finds it in the image, or 0.
    """

    displacement_px: Float32[np.ndarray, 'h w 2']
    confidence: Float32[np.ndarray, 'h w'] | None = None
    noise_px: float = 0.0


@runtime_checkable
class FlowMethod(Protocol):
    """Measures displacement against a rest image.

    The result depends only on the two images and the options, never on earlier images.
    """

    @property
    def name(self) -> str: ...

    @property
    def options(self) -> dict[str, object]:
        """All options with their values, as recorded in a model's card."""
        ...

    def set_reference(self, image: UInt8[np.ndarray, 'h w']) -> None:
        """Set the rest image.

        Raises:
            ImageError: it is not an 8-bit grey image, or too small.
        """
        ...

    def displacement(self, image: UInt8[np.ndarray, 'h w']) -> DisplacementField:
        """Displacement of `image` against the rest image.

        Raises:
            ImageError: size or type differ from the rest image, or there is no rest image yet.
        """
        ...


@dataclass(frozen=True)
class DisOptions:
    """Options of the dense inverse search; None uses the value of the preset.

    `threads` is the number of OpenCV threads, which all calls of a process share.
    """

    preset: str = 'ultrafast'
    finest_scale: int | None = 1
    patch_size: int | None = None
    patch_stride: int | None = None
    gradient_descent_iterations: int | None = None
    variational_refinement_iterations: int | None = None
    threads: int = 1


class DisFlow:
    """Dense inverse search (Kroeger et al., ECCV 2016) in OpenCV's implementation: the paper's method.

    The paper names neither preset nor scale. OpenCV's presets `fast` and `ultrafast` stop at a quarter of the
    resolution (finest scale 2), where they lose a quarter of the motion or more. So the default is `ultrafast` with one
    scale more; `docs/method.md` has the comparison.
    """

    name = 'dis'

    def __init__(self, options: DisOptions | None = None) -> None:
        self._options = options or DisOptions()
        self._reference: np.ndarray | None = None
        self._search = _dis(self._options)

    @property
    def options(self) -> dict[str, object]:
        return asdict(self._options)

    def set_reference(self, image: np.ndarray) -> None:
        require_grey(image)
        self._reference = np.ascontiguousarray(image).copy()
        self._levels = np.maximum(_block_levels(image), 1.0)

    def displacement(self, image: np.ndarray) -> DisplacementField:
        reference = require_like(self._reference, image)
        if cv2.getNumThreads() != self._options.threads:
            cv2.setNumThreads(self._options.threads)
        flow = self._search.calc(reference, self._in_its_light(image), None)  # type: ignore[call-overload]
        return DisplacementField(flow)

    def _in_its_light(self, image: UInt8[np.ndarray, 'h w']) -> UInt8[np.ndarray, 'h w']:
        """Scale the image to the rest image's brightness, since the search mistakes brightness for motion.

        If the brightness is nearly equal, the image is returned unchanged.
        """
        shares = _block_levels(image) / self._levels
        share = float(np.median(shares))
        alike = np.abs(shares - share) < ALIKE_SHARE * share
        if abs(share - 1) <= SAME_LIGHT or alike.mean() < ALIKE_SHARE:
            return np.ascontiguousarray(image)
        return cv2.convertScaleAbs(image, alpha=1 / share)


SAME_LIGHT = 0.01
"""Difference in brightness from which on an image is scaled to the rest image; presses reach 0.002."""

ALIKE_SHARE = 0.25
"""A quarter of the blocks must be within a quarter of the median one; a half-covered image has no common brightness."""

LIGHT_BLOCKS = (8, 8)
"""The median of these blocks gives the brightness, unaffected by a hot spot or dirt in some of them."""


def _block_levels(image: UInt8[np.ndarray, 'h w']) -> Float32[np.ndarray, '8 8']:
    """Mean grey level of each block, of every other pixel of every other row."""
    sample = np.ascontiguousarray(image[::2, ::2], np.float32)  # means of integers would be integers
    levels: np.ndarray = cv2.resize(sample, LIGHT_BLOCKS, interpolation=cv2.INTER_AREA)
    return levels


def _dis(options: DisOptions) -> cv2.DISOpticalFlow:
    presets = {
        'ultrafast': cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST,
        'fast': cv2.DISOPTICAL_FLOW_PRESET_FAST,
        'medium': cv2.DISOPTICAL_FLOW_PRESET_MEDIUM,
    }
    if options.preset not in presets:
        raise ConfigurationError(f"the flow method 'dis' has no preset {options.preset!r}; use {', '.join(presets)}")
    search = cv2.DISOpticalFlow.create(presets[options.preset])
    setters: dict[str, Callable[[int], None]] = {
        'finest_scale': search.setFinestScale,
        'patch_size': search.setPatchSize,
        'patch_stride': search.setPatchStride,
        'gradient_descent_iterations': search.setGradientDescentIterations,
        'variational_refinement_iterations': search.setVariationalRefinementIterations,
    }
    for name, apply in setters.items():
        if (value := getattr(options, name)) is not None:
            apply(value)
    return search


SMALLEST_IMAGE = 32
"""Side in pixels below which DIS has no patches on its coarser scales."""


def require_grey(image: np.ndarray) -> None:
    if image.ndim != 2 or image.dtype != np.uint8:
        raise ImageError(
            f'optical flow needs 8 bit grey images, got {image.dtype} with shape {image.shape}; '
            'convert with tactile_nodes.sensing.geometry.grey'
        )
    if min(image.shape) < SMALLEST_IMAGE:
        raise ImageError(
            f'optical flow needs images of at least {SMALLEST_IMAGE}x{SMALLEST_IMAGE} pixels, '
            f'got {image.shape[1]}x{image.shape[0]}; use a larger crop'
        )


def require_like(reference: np.ndarray | None, image: np.ndarray) -> np.ndarray:
    if reference is not None and image.shape == reference.shape and image.dtype == reference.dtype:
        return reference
    require_grey(image)
    if reference is None:
        raise ImageError('optical flow has no rest image to compare with; capture one with nothing touching the gel')
    if image.shape != reference.shape:
        raise ImageError(
            f'the image has {image.shape[1]}x{image.shape[0]} pixels but the rest image '
            f'{reference.shape[1]}x{reference.shape[0]}; capture the rest image again with the present camera settings'
        )
    return reference


def checked_options(method: str, options_type: type, options: Mapping[str, object]) -> dict[str, object]:
    """The options, after checking that the method's dataclass has all of them with the declared types.

    Raises:
        ConfigurationError: an unknown option, or a value of the wrong type.
    """
    hints = get_type_hints(options_type)
    for name, value in options.items():
        if name not in hints:
            raise ConfigurationError(f'{method!r} has no option {name!r}; it has: {", ".join(hints)}')
        listed = get_origin(hints[name]) is tuple
        wanted = (hints[name],) if listed else get_args(hints[name]) or (hints[name],)
        if not any(_fits(value, each) for each in wanted):
            names = ' or '.join(each.__name__ for each in wanted)
            raise ConfigurationError(f'option {name!r} of {method!r} must be of type {names}, got {value!r}')
    return {name: tuple(value) if isinstance(value, list) else value for name, value in options.items()}


def recorded_options(options: Any) -> dict[str, object]:
    """A method's options as recorded in a model's card; empty lists are left out, as in older cards."""
    return {name: value for name, value in asdict(options).items() if value != ()}


def require_covered(method: str, covered: tuple[int, ...], rows: int, cols: int) -> None:
    """Raise ConfigurationError if a covered region is not one of rows x cols."""
    if beyond := [each for each in covered if not 0 <= each < rows * cols]:
        raise ConfigurationError(
            f"option 'covered' of {method!r} names region {beyond[0]}, but there are only {rows}x{cols}"
        )


def _fits(value: object, wanted: type) -> bool:
    if get_origin(wanted) is tuple:
        return isinstance(value, (list, tuple)) and all(isinstance(each, get_args(wanted)[0]) for each in value)
    if isinstance(value, bool):
        return wanted is bool
    return isinstance(value, (int, float)) if wanted is float else isinstance(value, wanted)
