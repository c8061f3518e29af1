"""Feature encodings: from a displacement field to features per image region, behind one protocol.

An encoding is chosen by name: ``make_encoding('polar_mean', {'rows': 40, 'cols': 40})``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Protocol, runtime_checkable

import cv2
import numpy as np

from tactile_nodes.errors import ConfigurationError, ImageError
from tactile_nodes.sensing.flow.methods import DisplacementField, checked_options
from tactile_nodes.shapes import Float32, UInt8

LEAST_SURE = 1e-6
"""Motion is zero below this confidence."""


@dataclass(frozen=True)
class Features:
    """Features of a frame: `values[row, col, channel]`, the confidence of each region (0 to 1), and the noise of the
    motion as the flow method found it, or 0."""

    encoding: str
    values: Float32[np.ndarray, 'rows cols channels']
    confidence: Float32[np.ndarray, 'rows cols']
    noise_px: float = 0.0


def fewer_means(
    values: Float32[np.ndarray, 'h w channels'], confidence: Float32[np.ndarray, 'h w'], rows: int, cols: int
) -> tuple[Float32[np.ndarray, 'rows cols channels'], Float32[np.ndarray, 'rows cols']]:
    """Confidence-weighted means over fewer regions, and their confidence."""
    sure = cv2.resize(confidence, (cols, rows), interpolation=cv2.INTER_AREA)
    weighted = cv2.resize(values * confidence[:, :, None], (cols, rows), interpolation=cv2.INTER_AREA)
    means: np.ndarray = weighted.reshape(rows, cols, -1) / np.maximum(sure, np.float32(LEAST_SURE))[:, :, None]
    return means, sure


@runtime_checkable
class FeatureEncoding(Protocol):
    """Turns a displacement field into features per region."""

    @property
    def name(self) -> str: ...

    @property
    def channels(self) -> tuple[str, ...]:
        """Name and unit of each channel, such as ('magnitude_px', 'angle_rad')."""
        ...

    @property
    def options(self) -> dict[str, object]: ...

    def set_reference(self, image: UInt8[np.ndarray, 'h w']) -> None:
        """Find in the rest image which regions show markers; before that every region has full confidence.

        Raises:
            ImageError: the regions do not divide the image.
        """
        ...

    def encode(self, field: DisplacementField) -> Features:
        """Features of a displacement field.

        Raises:
            ImageError: the regions do not divide the image.
        """
        ...


@dataclass(frozen=True)
class RegionOptions:
    """How many regions divide the image (the paper: 40x40 of 11x11 px each), and the texture of a marker.

    `texture_grey` is the root mean square gradient, in grey levels per pixel, at which a region counts half:
    on the simulated gel regions far from markers have 0.1 to 0.4 (noise), those with one marker 3 to 12, and those
    with five or more 9 to 22.
    """

    rows: int = 40
    cols: int = 40
    texture_grey: float = 4.0


class RegionMeans:
    """What the encodings by region share: the grid and the confidence of its regions."""

    def __init__(self, options: RegionOptions | None = None) -> None:
        self._options = options or RegionOptions()
        self._texture: np.ndarray | None = None

    @property
    def options(self) -> dict[str, object]:
        return asdict(self._options)

    def set_reference(self, image: UInt8[np.ndarray, 'h w']) -> None:
        self._texture = texture_confidence(image, self._options)

    def _confidence(self, field: DisplacementField) -> np.ndarray:
        rows, cols = self._options.rows, self._options.cols
        texture = self._texture if self._texture is not None else np.ones((rows, cols), np.float32)
        if field.confidence is None:
            return texture
        confidence: np.ndarray = texture * block_means(field.confidence, rows, cols)
        return confidence

    def _means(self, *maps: np.ndarray) -> np.ndarray:
        return np.stack([block_means(each, self._options.rows, self._options.cols) for each in maps], axis=-1)


class PolarMean(RegionMeans):
    """The paper's features: magnitude and angle of the flow at each pixel, averaged over each region.

    The angle is atan2(dy, dx) in [0, 2 pi) and averaged as a plain number, as published; so a region where half
    of the pixels point to 0.1 and half to 2 pi - 0.1 reads pi. A field of (3, 4) px everywhere gives 5 px and
    0.9273 rad in every region.
    """

    name = 'polar_mean'
    channels = ('magnitude_px', 'angle_rad')

    def encode(self, field: DisplacementField) -> Features:
        dx, dy = cv2.split(field.displacement_px)
        magnitude, angle = cv2.cartToPolar(dx, dy)
        return Features(self.name, self._means(magnitude, angle), self._confidence(field), field.noise_px)


class CartesianMean(RegionMeans):
    """Mean (dx, dy) of each region in pixels: no wrap, and zero where nothing moves."""

    name = 'cartesian_mean'
    channels = ('dx_px', 'dy_px')

    def encode(self, field: DisplacementField) -> Features:
        motion = field.displacement_px
        if motion.shape[:2] == (self._options.rows, self._options.cols):  # one patch a region: its mean is itself
            return Features(self.name, motion, self._confidence(field), field.noise_px)
        return Features(self.name, self._means(*cv2.split(motion)), self._confidence(field), field.noise_px)


def as_motion(
    encoding: str, values: Float32[np.ndarray, '*batch rows cols channels']
) -> Float32[np.ndarray, '*batch rows cols channels']:
    """Features as motion along x and y, which changes smoothly with a press; of other encodings they are that already.

    Mean magnitude and mean angle of (5, 0.9273) give (3, 4). An angle that is noise, as where nothing moves, is so no
    longer.
    """
    if encoding != PolarMean.name:
        return values
    values = np.asarray(values, np.float32)
    magnitude, angle = values[..., 0], values[..., 1]
    return np.stack([magnitude * np.cos(angle), magnitude * np.sin(angle)], axis=-1)


def block_means(values: Float32[np.ndarray, 'h w'], rows: int, cols: int) -> Float32[np.ndarray, 'rows cols']:
    """Mean of each of rows x cols equal blocks: [[1, 3], [5, 7]] as one block is [[4]].

    Raises:
        ImageError: the blocks do not divide the array.
    """
    height, width = values.shape
    if (height, width) == (rows, cols):
        return values
    if height % rows or width % cols:
        raise ImageError(
            f'{rows}x{cols} regions do not divide an image of {width}x{height} pixels; '
            'change the crop or the number of regions'
        )
    # Pixel-area interpolation by a whole factor is the mean of each block, and vectorised.
    means: np.ndarray = cv2.resize(values, (cols, rows), interpolation=cv2.INTER_AREA)
    return means


def texture_confidence(image: UInt8[np.ndarray, 'h w'], options: RegionOptions) -> Float32[np.ndarray, 'rows cols']:
    """How far flow can be believed in each region of a rest image: t² / (t² + t0²).

    t is the root mean square gradient in the region and t0 `options.texture_grey`; a region without any
    structure gets 0, one with t = t0 gets 0.5.
    """
    smooth = cv2.GaussianBlur(image, (0, 0), 1.0).astype(np.float32)
    dx, dy = (cv2.Sobel(smooth, cv2.CV_32F, *order, scale=0.125) for order in ((1, 0), (0, 1)))
    energy = block_means(dx * dx + dy * dy, options.rows, options.cols)
    confidence: np.ndarray = energy / (energy + np.float32(options.texture_grey**2))
    return confidence


ENCODINGS: dict[str, Callable[[RegionOptions], FeatureEncoding]] = {
    PolarMean.name: PolarMean,
    CartesianMean.name: CartesianMean,
}


def make_encoding(name: str, options: Mapping[str, object] | None = None) -> FeatureEncoding:
    """The encoding of that name.

    Raises:
        ConfigurationError: no such encoding, or no such option of it.
    """
    if name not in ENCODINGS:
        raise ConfigurationError(f'there is no feature encoding {name!r}; use one of: {", ".join(ENCODINGS)}')
    return ENCODINGS[name](RegionOptions(**checked_options(name, RegionOptions, options or {})))  # type: ignore[arg-type]
