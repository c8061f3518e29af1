"""Makes the description of a sensor from a picture of its untouched gel and a few answers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.sensing.elasticity.rays import dot_place_mm
from tactile_nodes.sensing.elasticity.view import View, camera_of
from tactile_nodes.sensing.flow.dot_pattern import Dots, find_dots
from tactile_nodes.sensing.inspection.markers import LENS_PX, markers_of
from tactile_nodes.sensing.inspection.texture import looks_covered, mark_px, marks, peaks
from tactile_nodes.sensors import (
    BinSettings,
    CameraDescription,
    GelDescription,
    ImageSettings,
    MaskSettings,
    PatternDescription,
    Sensor,
)
from tactile_nodes.sensors.covering import polygons_of
from tactile_nodes.shapes import Bool, Float, Int, UInt8

REGION_STEP = 40
"""The sides of the crop are multiples of this, so that regions of many sizes divide them."""

BEYOND = 1.05
"""Assumed ratio of the gel's width to the visible width: regions at the rim look a little beyond it."""

BIN_MM = 2.7
"""Width of a bin, similar to the simulated sensors."""

LEAST_RADIUS_PX = 0.5
SAME = 0.1
"""Allowed relative difference of two estimates of one length."""

LEAST_COVERED = 0.01

NEIGHBOUR = 0.4
"""Over the pitch: how far a neighbour may be from where the usual step leads, as a lens shortens those at the rim."""

LEAST_FORWARDS = 0.17
"""Rays farther than 80 degrees from the optical axis count as at 80."""


@dataclass(frozen=True)
class Answers:
    """The user's answers. 0 or empty: unknown.

    Attributes:
        name: name of the sensor.
        width_mm: width of the camera's whole picture at the surface of the gel, also if the gel ends within it.
        pitch_mm: pitch of printed dots, an alternative to the width.
        thickness_mm: thickness of the gel.
        modulus_mpa: shear modulus of the gel.
        modulus_off: relative standard deviation of the modulus.
        markers_mm: range of depths of the pattern.
        distance_mm: distance from the entrance pupil of the lens to the surface of the gel.
        camera: a calibrated camera, whose position is unknown.
        sides: what is at the sides of the gel.
    """

    name: str
    width_mm: float = 0.0
    pitch_mm: float = 0.0
    thickness_mm: float = 4.0
    modulus_mpa: float = 0.1
    modulus_off: float = GelDescription.moduli_off
    markers_mm: tuple[float, float] = (0.2, 0.5)
    distance_mm: float = 20.0
    camera: CameraDescription | None = None
    sides: str = 'ignored'


@dataclass(frozen=True)
class Understood:
    """A picture, cropped as the sensor's pictures will be, with its dots and covered parts."""

    picture: UInt8[np.ndarray, 'h w']
    dots: Dots | None
    covered: Bool[np.ndarray, 'h w'] = field(repr=False)

    @property
    def shows_rim(self) -> bool:
        """Whether the gel ends within the picture: two opposite sides of it are covered."""
        top, bottom, left, right = (each.all() for each in (*self.covered[[0, -1]], *self.covered[:, [0, -1]].T))
        return bool((top and bottom) or (left and right))

    @property
    def summary(self) -> str:
        """A summary as text."""
        share = f'{100 * self.covered.mean():.0f} % of the image look covered'
        if self.dots is None:
            return f'texture, no dots in rows and columns; {share}'
        tone = 'dark' if self.dots.dark else 'bright'
        return (
            f'{len(self.dots)} {tone} dots, {self.dots.diameter_px:.1f} px wide and {self.dots.pitch_px:.1f} px apart; '
            f'{share}'
        )


def understood(picture: UInt8[np.ndarray, 'h w'], pattern: str = 'auto') -> Understood:
    """Find the pattern and the covered parts of a picture.

    Raises:
        ConfigurationError: dots are required but not found, or everything looks covered.
    """
    dots = None if pattern == 'spheres' else find_dots(picture)
    if pattern == 'dots' and dots is None:
        raise ConfigurationError(
            'the image shows no dots in rows and columns; check light and focus, or do not give a pattern'
        )
    covered = looks_covered(picture, dots)
    if covered.mean() < LEAST_COVERED:
        covered = np.zeros_like(covered)
    if covered.all():
        raise ConfigurationError('the whole image looks covered; check light and focus, or give a mask')
    return Understood(picture, dots, covered)


def usual_crop(width: int, height: int) -> tuple[int, int]:
    """Largest crop with sides that many regions divide: all of 640x480 and 1920x1080, 400x280 of 410x308."""
    return max(REGION_STEP, width // REGION_STEP * REGION_STEP), max(REGION_STEP, height // REGION_STEP * REGION_STEP)


def describe(seen: Understood, answers: Answers, size_px: tuple[int, int]) -> Sensor:
    """The sensor description for such a cropped picture of a camera with images of `size_px` (width, height).

    Raises:
        ConfigurationError: answers contradict each other or the picture.
    """
    if seen.covered.all():
        raise ConfigurationError('the mask covers the whole image; black parts and polygons mark what to leave out')
    height, width = seen.picture.shape
    try:
        camera, away_mm = _placed(seen, answers, size_px)
        low, high = _seen_mm(seen, camera, size_px, [away_mm - each for each in answers.markers_mm])
        wide_mm, high_mm = (math.ceil(10 * side) / 10 for side in (high - low).tolist())
        x_mm, y_mm = (-np.round((low + high) / 2, 1) + 0.0).tolist()
        sensor = Sensor(
            answers.name,
            ImageSettings(*size_px, width, height),
            replace(camera, position_mm=(x_mm, y_mm, -away_mm)),
            GelDescription(
                wide_mm, high_mm, (answers.thickness_mm,), (answers.modulus_mpa,), (0.5,), answers.markers_mm,
                answers.modulus_off, sides=answers.sides,
            ),
            bins=BinSettings(*(min(64, max(2, round(side / BIN_MM))) for side in (high_mm, wide_mm))),
            mask=_mask(seen, size_px),
        )  # fmt: skip
        return replace(sensor, pattern=_pattern(seen, sensor))
    except ValueError as error:
        raise ConfigurationError(f'the answers contradict each other: {error}') from error


def _placed(seen: Understood, answers: Answers, size_px: tuple[int, int]) -> tuple[CameraDescription, float]:
    """The camera, and the distance (mm) of its pupil from the surface of the gel.

    A calibrated lens is as far away as the width or the pitch implies, or, without these, as given. Without a
    calibration they imply the focal length of a lens at the given distance.
    """
    if answers.pitch_mm and not seen.dots:
        raise ConfigurationError('a pitch was given, but the image shows no dots in rows and columns; leave it out')
    if not (answers.width_mm or answers.pitch_mm or (answers.camera and answers.distance_mm)):
        raise ConfigurationError('the size of the gel in the image is unknown; give the width that is seen')
    (width, height), middle_mm = size_px, sum(answers.markers_mm) / 2
    unknown = CameraDescription('pinhole', focal_px=2 * (float(width),), centre_px=((width - 1) / 2, (height - 1) / 2))
    camera = answers.camera or unknown
    # From the lens to the surface, and to the pattern below it, if its focal length is right.
    ends = np.array([[-0.5, camera.centre_px[1]], [width - 0.5, camera.centre_px[1]]])
    surface_mm = answers.width_mm / float(np.ptp(_slopes(camera, size_px, ends), axis=0)[0])
    pattern_mm = answers.pitch_mm / _pitch(seen, camera, size_px) if answers.pitch_mm else 0.0
    implied_mm = pattern_mm + middle_mm if pattern_mm else surface_mm
    known_mm = answers.distance_mm if answers.camera is None else implied_mm or answers.distance_mm
    by_width_mm = surface_mm * (1 - middle_mm / known_mm)
    focal_px = camera.focal_lengths_px[0]
    if by_width_mm and pattern_mm and abs(by_width_mm / pattern_mm - 1) > SAME:
        raise ConfigurationError(
            f'the given width of {answers.width_mm:g} mm means {focal_px / by_width_mm:.1f} px per mm, but the given '
            f'pitch of {answers.pitch_mm:g} mm means {focal_px / pattern_mm:.1f}; check both, or leave one out'
        )
    if answers.camera is None:
        focal_px *= (known_mm - middle_mm) / pattern_mm if pattern_mm else known_mm / surface_mm
        return replace(camera, focal_px=(focal_px, focal_px)), known_mm
    if answers.distance_mm and abs(answers.distance_mm / known_mm - 1) > 2 * SAME:
        raise ConfigurationError(
            f'from its calibration and the width that is seen, the lens is {known_mm:.1f} mm away, but '
            f'{answers.distance_mm:g} mm were given; check both, or leave one out'
        )
    return camera, known_mm


def _slopes(
    camera: CameraDescription, size_px: tuple[int, int], pixels: Float[np.ndarray, 'n 2']
) -> Float[np.ndarray, 'n 2']:
    """Where the rays of pixels of the camera's image are (x, y) at a distance of 1 along the optical axis."""
    rays = camera_of(camera, *size_px).unproject(pixels)
    return np.asarray(rays[:, :2] / np.maximum(rays[:, 2:], LEAST_FORWARDS))


def _pitch(seen: Understood, camera: CameraDescription, size_px: tuple[int, int]) -> float:
    """The pitch of the dots at a distance of 1, mean over all neighbours."""
    assert seen.dots is not None
    centres, steps = seen.dots.centres_px, []
    slopes = _slopes(camera, size_px, centres + _corner(seen, size_px))
    for step in (seen.dots.across_px, seen.dots.down_px):
        away = np.hypot(*(centres[:, None] + step - centres).transpose(2, 0, 1))
        near = away.min(axis=1) < NEIGHBOUR * seen.dots.pitch_px
        steps.append(slopes[away.argmin(axis=1)[near]] - slopes[near])
    return float(np.hypot(*np.concatenate(steps).T).mean())


def _corner(seen: Understood, size_px: tuple[int, int]) -> Int[np.ndarray, ' 2']:
    """Upper left corner of the cropped picture in the camera's full picture, of which it is the middle."""
    return np.asarray((np.array(size_px) - seen.picture.shape[::-1]) // 2)


def _seen_mm(
    seen: Understood, camera: CameraDescription, size_px: tuple[int, int], pattern_mm: Sequence[float]
) -> Float[np.ndarray, 'corners 2']:
    """Upper left and lower right corner (mm from the optical axis) of the gel, of whose rim the lower end is seen.

    `pattern_mm` are the ends' distances. At the rim of the picture the gel is assumed to extend a little further.
    """
    free, size = np.argwhere(~seen.covered)[:, ::-1], np.array(seen.picture.shape[::-1])
    corners = np.stack([free.min(axis=0), free.max(axis=0)])
    pixels = np.tile(camera.centre_px, (2, 2, 1))  # along x and y: both ends, on the optical axis otherwise
    pixels[(0, 1), :, (0, 1)] = (corners + _corner(seen, size_px)).T
    slopes = np.stack([_slopes(camera, size_px, each)[:, axis] for axis, each in enumerate(pixels)], axis=1)
    more = (BEYOND - 1) / 2 * size / camera.focal_lengths_px
    at_rim = corners == ((0, 0), size - 1)
    return np.asarray(np.where(at_rim, *pattern_mm) * (slopes + at_rim * np.stack([-more, more])))


def _pattern(seen: Understood, sensor: Sensor) -> PatternDescription:
    """The visible pattern, in millimetres, of a sensor that is described otherwise."""
    if seen.dots is not None:
        size_px = sensor.image.width, sensor.image.height
        below_mm = -sensor.camera.position_mm[2] - View(sensor).middle_mm
        pitch = _pitch(seen, sensor.camera, size_px) * below_mm
        wide = round(seen.dots.diameter_px / seen.dots.pitch_px * pitch, 3)
        pattern = PatternDescription('dots', 1, (wide, wide), round(pitch, 3), seen.dots.dark)
        at = dot_place_mm(View(replace(sensor, pattern=pattern)), seen.dots.centres_px)
        return replace(pattern, dot_mm=tuple(round(each, 2) + 0.0 for each in at))
    shown, free, px_per_mm = marks(seen.picture), ~seen.covered, View(sensor).px_per_mm
    dark = float(np.mean(shown[free] ** 3)) < 0
    variance = mark_px(seen.picture, free) ** 2 - 1 / 12 - LENS_PX**2
    wide = round(4 * math.sqrt(max(variance, LEAST_RADIUS_PX**2 / 4)) / px_per_mm, 3)
    per_mm2 = markers_of(float(peaks(seen.picture, dark=dark)[free].mean())) * px_per_mm**2
    count = max(1, round(per_mm2 * sensor.gel.width_mm * sensor.gel.height_mm))
    return PatternDescription('spheres', count, (wide, wide), 2.0, dark)


def _mask(seen: Understood, size_px: tuple[int, int]) -> MaskSettings:
    """The mask in the camera's full picture."""
    if not seen.covered.any():
        return MaskSettings()
    mask = np.zeros(size_px[::-1], bool)
    height, width = seen.covered.shape
    x, y = _corner(seen, size_px).tolist()
    mask[y : y + height, x : x + width] = seen.covered
    return MaskSettings(polygons_of(mask))
