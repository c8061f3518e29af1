"""Motion of printed dots: each dot is tracked by its centre, and regions get the motion of the dots around them.

Between dots there is no texture that a patch could track; shading and dirt do not move with the gel. A dot's centre is
the centroid of its darkness, or brightness, relative to its surroundings. It is found by mean shift (Comaniciu and Meer
2002), starting from its place at rest, or from the motion of its neighbours. From there the dot is matched with its
image at rest (`dot_matching`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_nodes.errors import ImageError
from tactile_nodes.sensing.flow.dot_matching import DotImages
from tactile_nodes.sensing.flow.dot_pattern import Dots, contrast, find_dots
from tactile_nodes.sensing.flow.methods import (
    DisplacementField,
    recorded_options,
    require_covered,
    require_grey,
    require_like,
)
from tactile_nodes.shapes import Bool, Float, Float32, Int, UInt8

REACH = 0.75
"""Of a dot's diameter: radius within which its centre is looked for, all of the dot and nothing of the next one."""

ROUNDS, CLOSE_PX = 12, 0.1
"""Steps towards a centre, at most, and how short the last one is."""

LEAST_MASS = 0.4
"""Of what a dot shows at rest: with less it is not there, or covered."""

NEIGHBOURS, APART = 6, 0.35
"""Of the pitch: a dot that moved by so much more than its neighbours was taken for another one."""

ABOUT = 0.25
"""Of the pitch: standard deviation of the weights of the dots about a region."""

ALONE = float(np.exp(-(1.1**2) / (2 * ABOUT**2)))
"""Weight of a dot 1.1 pitches away. The confidence of regions with less weight around them is lower in proportion."""

NO_TEXTURE = 1e-3
"""Gradient (grey levels a pixel) at which a region of dots has half the weight; dots have a confidence of their own."""


@dataclass(frozen=True)
class DotsOptions:
    """Motion is given on `rows` x `cols` equal regions of the image; those `covered` get no confidence."""

    rows: int = 10
    cols: int = 10
    covered: tuple[int, ...] = ()


class DotsFlow:
    """Tracks printed dots one by one; the field has one displacement per region, with its confidence."""

    name = 'dots'

    def __init__(self, options: DotsOptions | None = None) -> None:
        self._options = options or DotsOptions()
        require_covered(self.name, self._options.covered, self._options.rows, self._options.cols)
        self._reference: np.ndarray | None = None
        self._rest: _Rest

    @property
    def options(self) -> dict[str, object]:
        return recorded_options(self._options)

    def set_reference(self, image: np.ndarray) -> None:
        require_grey(image)
        dots = find_dots(image)
        if dots is None:
            raise ImageError(
                'the rest image shows no printed dots in rows and columns; look at focus and light, or describe the '
                'pattern as spheres'
            )
        self._rest = _Rest.of(dots, image, self._options)
        self._reference = image.copy()

    def displacement(self, image: np.ndarray) -> DisplacementField:
        require_like(self._reference, image)
        field = self._rest.displacement(*self._rest.followed(image))
        if self._options.covered and field.confidence is not None:
            field.confidence.flat[list(self._options.covered)] = 0
        return field


@dataclass(frozen=True)
class _Rest:
    """The dots at rest, and what each region has of them."""

    dark: bool
    level: float
    reach_px: float
    pitch_px: float
    centres_px: Float[np.ndarray, 'dots 2']
    mass: Float[np.ndarray, ' dots']
    images: DotImages
    near: Int[np.ndarray, 'dots near']
    interpolation: _Interpolation
    dot_weights: Float[np.ndarray, 'regions dots']
    shape: tuple[int, int]

    @classmethod
    def of(cls, dots: Dots, image: UInt8[np.ndarray, 'h w'], options: DotsOptions) -> _Rest:
        height = contrast(image, dark=dots.dark)
        rows, cols = np.rint(dots.centres_px[:, ::-1]).astype(int).T
        level = float(np.median(height[rows, cols])) / 4
        reach_px = REACH * dots.diameter_px
        centres, mass = centred(height, dots.centres_px, reach_px, level)
        away = np.hypot(*(centres[:, None] - centres[None]).transpose(2, 0, 1))
        near = np.argsort(away, axis=1)[:, 1 : NEIGHBOURS + 1]
        shape = options.rows, options.cols
        interpolation = _Interpolation.of(centres, dots.pitch_px, image.shape, shape)
        images = DotImages.of(height, centres, dots.diameter_px)
        return cls(
            dots.dark, level, reach_px, dots.pitch_px, centres, mass, images, near, interpolation,
            interpolation.shares(np.ones(len(centres), bool)), shape,
        )  # fmt: skip

    def followed(
        self, image: UInt8[np.ndarray, 'h w']
    ) -> tuple[Float[np.ndarray, 'dots 2'], Bool[np.ndarray, ' dots'], Float[np.ndarray, ' dots']]:
        """Motion of each dot, whether it was found, and the standard deviation of its motion along an axis."""
        height = contrast(image, dark=self.dark)
        places, mass = centred(height, self.centres_px, self.reach_px, self.level)
        motion = places - self.centres_px
        around = self._around(motion)
        strayed = self._strayed(motion, around) | (mass < LEAST_MASS * self.mass)
        if strayed.any():
            again, seen = centred(height, (self.centres_px + around)[strayed], self.reach_px, self.level)
            motion[strayed], mass[strayed] = again - self.centres_px[strayed], seen
        places, noise_px = self.images.matched(height, self.centres_px + motion)
        motion = places - self.centres_px
        strayed = self._strayed(motion, self._around(motion))
        return motion, ~strayed & (mass >= LEAST_MASS * self.mass), noise_px

    def _around(self, motion: Float[np.ndarray, 'dots 2']) -> Float[np.ndarray, 'dots 2']:
        """Motion of the neighbours of each dot."""
        median: np.ndarray = np.median(motion[self.near], axis=1)
        return median

    def _strayed(
        self, motion: Float[np.ndarray, 'dots 2'], around: Float[np.ndarray, 'dots 2']
    ) -> Bool[np.ndarray, ' dots']:
        strayed: np.ndarray = np.hypot(*(motion - around).T) > APART * self.pitch_px
        return strayed

    def displacement(
        self,
        motion: Float[np.ndarray, 'dots 2'],
        found: Bool[np.ndarray, ' dots'],
        noise_px: Float[np.ndarray, ' dots'],
    ) -> DisplacementField:
        """The motion of each region, and the noise of the usual one."""
        dot_weights = self.dot_weights if found.all() else self.interpolation.shares(found)
        weights = self.interpolation.weights
        sure = (weights @ found) / np.maximum(weights.sum(axis=1), ALONE)
        return DisplacementField(
            (dot_weights @ motion).reshape(*self.shape, 2).astype(np.float32),
            sure.reshape(self.shape).astype(np.float32),
            float(np.median(noise_px) * np.sqrt(np.square(dot_weights).sum(axis=1).mean())),
        )


def weights_of_dots(
    centres_px: Float[np.ndarray, 'dots 2'], pitch_px: float, size_px: tuple[int, int], shape: tuple[int, int]
) -> Float[np.ndarray, 'regions dots']:
    """Weight of each dot's motion in each of rows x cols regions, where all dots are found.

    Args:
        centres_px: where they are at rest, in a picture of `size_px` (width, height).
        pitch_px: from one to the next.
        size_px: of the picture.
        shape: rows and columns of regions.
    """
    return _Interpolation.of(centres_px, pitch_px, size_px[::-1], shape).shares(np.ones(len(centres_px), bool))


def centred(
    height: Float32[np.ndarray, 'h w'], start: Float[np.ndarray, 'dots 2'], reach_px: float, level: float
) -> tuple[Float[np.ndarray, 'dots 2'], Float[np.ndarray, ' dots']]:
    """The centre of what is higher than a level about each place, and how much that is; what is twice as high counts
    no more, so that shading within a dot does not move it."""
    reach = int(reach_px) + 1
    steps = np.arange(-reach, reach + 1)
    down, right = (each.ravel() for each in np.meshgrid(steps, steps, indexing='ij'))
    padded = np.pad(height, 2 * reach)
    above, width = np.clip(padded - level, 0.0, level).ravel(), padded.shape[1]
    limit = np.array(height.shape[::-1]) - 1
    places, mass = np.clip(start, 0, limit), np.zeros(len(start))
    for _ in range(ROUNDS):
        pixel = np.rint(places).astype(int)
        index = (pixel[:, 1:] + 2 * reach + down) * width + pixel[:, :1] + 2 * reach + right
        offset = pixel - places
        away = np.square(offset[:, :1] + right) + np.square(offset[:, 1:] + down)
        counted = above[index] * (away <= reach_px**2)
        mass = counted.sum(axis=1)
        step = np.stack([counted @ right, counted @ down], 1) / np.maximum(mass, 1e-9)[:, None] + offset
        step[mass <= 0] = 0.0
        places = np.clip(places + step, 0, limit)
        if np.abs(step).max(initial=0.0) < CLOSE_PX:
            break
    return places, mass


@dataclass(frozen=True)
class _Interpolation:
    """Interpolates the motion of dots to regions: the weight of each dot in each region, by distance; and 1, x and y of
    dots and regions, in pitches."""

    weights: Float[np.ndarray, 'regions dots']
    dots: Float[np.ndarray, 'dots 3']
    regions: Float[np.ndarray, 'regions 3']

    @classmethod
    def of(
        cls, centres: Float[np.ndarray, 'dots 2'], pitch_px: float, size: tuple[int, ...], shape: tuple[int, int]
    ) -> _Interpolation:
        (height, width), (rows, cols) = size, shape
        x = (np.arange(cols) + 0.5) * width / cols - 0.5
        y = (np.arange(rows) + 0.5) * height / rows - 0.5
        middles = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
        dots, regions = (
            np.column_stack([np.ones(len(each)), (each - (width / 2, height / 2)) / pitch_px])
            for each in (centres, middles)
        )
        away = np.square(dots[None, :, 1:] - regions[:, None, 1:]).sum(axis=-1)
        return cls(np.exp(-away / (2 * ABOUT**2)), dots, regions)

    def shares(self, found: Bool[np.ndarray, ' dots']) -> Float[np.ndarray, 'regions dots']:
        """How much of each dot's motion is in that of each region.

        It is the mean of the dots about it. Since these do not lie in its middle, the motion of the picture as a whole
        between them and there is added: a plane through the motion of all dots.
        """
        weights = self.weights * found + 1e-12
        weights /= weights.sum(axis=1, keepdims=True)
        plane = np.linalg.pinv(self.dots * found[:, None])
        shares: np.ndarray = weights + (self.regions - weights @ self.dots) @ plane
        return shares
