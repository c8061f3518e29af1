"""Makes the description of a sensor from a picture of its untouched gel and a few answers."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.sensing.elasticity.rays import dot_place_mm
from tactile_nodes.sensing.elasticity.view import View
from tactile_nodes.sensing.flow.dot_pattern import Dots, find_dots
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
from tactile_nodes.shapes import Bool, Float, UInt8

REGION_STEP = 40
"""The sides of the crop are multiples of this, so that regions of many sizes divide them."""

BEYOND = 1.05
"""Assumed ratio of the gel's width to the visible width: regions at the rim look a little beyond it."""

BIN_MM = 2.7
"""Width of a bin, similar to the simulated sensors."""

LENS_PX = 0.6
LEAST_RADIUS_PX = 0.5
SAME = 0.1
"""Allowed relative difference of two estimates of one length."""

LEAST_COVERED = 0.01


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
        raise ConfigurationError('the mask covers the whole image; black parts mark what to leave out')
    px_per_mm = _scale(seen, answers, size_px[0])
    middle_mm = sum(answers.markers_mm) / 2
    (height, width), camera = seen.picture.shape, answers.camera
    away_mm = _distance(answers, px_per_mm, middle_mm, size_px[0])
    if camera is None:
        focal = px_per_mm * (away_mm - middle_mm)
        camera = CameraDescription('pinhole', focal_px=(focal, focal), centre_px=tuple((n - 1) / 2 for n in size_px))
    low, high = _seen_mm(seen, camera, size_px, px_per_mm, away_mm - middle_mm)
    # Rays diverge: the visible area is smaller at the middle of the pattern than at its top.
    top = (away_mm - answers.markers_mm[0]) / (away_mm - middle_mm)
    wide_mm, high_mm = (math.ceil(10 * top * side) / 10 for side in (high - low).tolist())
    x_mm, y_mm = (-np.round(top * (low + high) / 2, 1) + 0.0).tolist()
    try:
        sensor = Sensor(
            answers.name,
            ImageSettings(*size_px, width, height),
            replace(camera, position_mm=(x_mm, y_mm, -away_mm)),
            GelDescription(
                wide_mm, high_mm, (answers.thickness_mm,), (answers.modulus_mpa,), (0.5,), answers.markers_mm,
                answers.modulus_off, sides=answers.sides,
            ),
            _pattern(seen, px_per_mm, wide_mm * high_mm),
            BinSettings(*(min(64, max(2, round(side / BIN_MM))) for side in (high_mm, wide_mm))),
            _mask(seen, size_px),
        )  # fmt: skip
    except ValueError as error:
        raise ConfigurationError(f'the answers contradict each other: {error}') from error
    if seen.dots is None:
        return sensor
    at = dot_place_mm(View(sensor), seen.dots.centres_px)
    return replace(sensor, pattern=replace(sensor.pattern, dot_mm=tuple(round(each, 2) + 0.0 for each in at)))


def _scale(seen: Understood, answers: Answers, width_px: int) -> float:
    """Pixels per millimetre at the pattern; `width_px` is the width of the camera's whole picture."""
    by_width = width_px / answers.width_mm if answers.width_mm else 0.0
    by_pitch = seen.dots.pitch_px / answers.pitch_mm if seen.dots and answers.pitch_mm else 0.0
    if answers.pitch_mm and not by_pitch:
        raise ConfigurationError('a pitch was given, but the image shows no dots in rows and columns; leave it out')
    if not (by_width or by_pitch):
        raise ConfigurationError('the size of the gel in the image is unknown; give the width that is seen')
    if by_width and by_pitch and abs(by_width / by_pitch - 1) > SAME:
        raise ConfigurationError(
            f'the given width of {answers.width_mm:g} mm means {by_width:.1f} px per mm, but the given pitch of '
            f'{answers.pitch_mm:g} mm means {by_pitch:.1f}; check both, or leave one out'
        )
    return by_pitch or by_width


def _seen_mm(
    seen: Understood, camera: CameraDescription, size_px: tuple[int, int], px_per_mm: float, away_mm: float
) -> tuple[Float[np.ndarray, ' 2'], Float[np.ndarray, ' 2']]:
    """Upper left and lower right corner (mm from the optical axis) of the uncovered part, `away_mm` from the pupil.

    At the rim of the picture the gel is assumed to extend a little further.
    """
    height, width = seen.covered.shape
    free = np.argwhere(~seen.covered)[:, ::-1]
    low, high, size = free.min(axis=0), free.max(axis=0), np.array([width, height])
    more = (BEYOND - 1) / 2 * size
    corners = np.where(low == 0, -more, low), np.where(high == size - 1, size - 1 + more, high)
    middle = np.array(camera.centre_px) - (np.array(size_px) - size) // 2
    if camera.model == 'pinhole':
        left, right = ((each - middle) / px_per_mm for each in corners)
    else:
        steep = 1 / np.array(camera.focal_lengths_px)
        left, right = (away_mm * np.tan(np.clip((each - middle) * steep, -1.4, 1.4)) for each in corners)
    return left, right


def _distance(answers: Answers, px_per_mm: float, middle_mm: float, width_px: int) -> float:
    """Distance from the pupil to the surface (mm), from the camera calibration or else from the answers."""
    if answers.camera is None:
        return answers.distance_mm
    focal_px = answers.camera.focal_lengths_px[0]
    if answers.camera.model == 'fisheye':
        half = width_px / 2
        focal_px = half / math.tan(min(half / focal_px, 1.5))
    found = focal_px / px_per_mm + middle_mm
    if answers.distance_mm and abs(answers.distance_mm / found - 1) > 2 * SAME:
        raise ConfigurationError(
            f'from its calibration and the width that is seen, the lens is {found:.1f} mm away, but '
            f'{answers.distance_mm:g} mm were given; check both, or leave one out'
        )
    return found


def _pattern(seen: Understood, px_per_mm: float, area_mm2: float) -> PatternDescription:
    """The visible pattern, in millimetres."""
    if seen.dots is not None:
        wide = round(seen.dots.diameter_px / px_per_mm, 3)
        pitch = round(seen.dots.pitch_px / px_per_mm, 3)
        return PatternDescription('dots', 1, (wide, wide), pitch, seen.dots.dark)
    shown, free = marks(seen.picture), ~seen.covered
    dark = float(np.mean(shown[free] ** 3)) < 0
    variance = mark_px(seen.picture, free) ** 2 - 1 / 12 - LENS_PX**2
    wide = round(4 * math.sqrt(max(variance, LEAST_RADIUS_PX**2 / 4)) / px_per_mm, 3)
    per_mm2 = float(peaks(seen.picture, dark=dark)[free].mean()) * px_per_mm**2
    return PatternDescription('spheres', max(1, round(per_mm2 * area_mm2)), (wide, wide), 2.0, dark)


def _mask(seen: Understood, size_px: tuple[int, int]) -> MaskSettings:
    """The mask in the camera's full picture. The cropped picture is its middle."""
    if not seen.covered.any():
        return MaskSettings()
    mask = np.zeros(size_px[::-1], bool)
    height, width = seen.covered.shape
    x, y = (size_px[0] - width) // 2, (size_px[1] - height) // 2
    mask[y : y + height, x : x + width] = seen.covered
    return MaskSettings(polygons_of(mask))
