"""What no real sensor is like: a slip in a unit or a digit, refused with the name of the entry."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from tactile_nodes.sensors.covering import corners_of

if TYPE_CHECKING:
    from tactile_nodes.sensors.description import GelDescription, Sensor

MOST_MM = 500.0
"""Of a gel, along any side."""

SOFTEST_MPA, HARDEST_MPA, MOST_OFF = 1e-4, 20.0, 1.0
"""Shear moduli from the softest jelly to hard rubber, and the share that one may be off by."""

LEAST_FILLED, MOST_FILLED = 1 / 8, 8.0
"""Times as large as the picture, along both sides, the gel is by focal length and distance."""

MOST_TILT_DEG = 80.0
"""Of a camera: beyond it, what it looks at is taken to be no farther away."""


def require_real_gel(gel: GelDescription) -> None:
    """Refuse a gel that is none. Raises ValueError."""
    for name, value in (('width_mm', gel.width_mm), ('height_mm', gel.height_mm), ('layers_mm', gel.depth_mm)):
        if not value <= MOST_MM:
            raise ValueError(
                f'gel.{name} has {value:g} mm, and no gel has more than {MOST_MM:g}: lengths are in millimetres'
            )
    for value in gel.moduli_mpa:
        if not SOFTEST_MPA <= value <= HARDEST_MPA:
            raise ValueError(
                f'gel.moduli_mpa holds {value:g}, and shear moduli of gels lie between {SOFTEST_MPA:g} and '
                f'{HARDEST_MPA:g} MPa: 100 kPa are 0.1'
            )
    if not gel.moduli_off <= MOST_OFF:
        raise ValueError(
            f'gel.moduli_off is {gel.moduli_off:g}, and it is a share of {MOST_OFF:g} at most: 0.6 is 60 %'
        )


def require_real(sensor: Sensor) -> None:
    """Refuse parts that each are possible, and not together. Raises ValueError."""
    _require_dots(sensor)
    _require_masked_within(sensor)
    _require_seen(sensor)


def _require_dots(sensor: Sensor) -> None:
    pattern, side = sensor.pattern, min(sensor.gel.width_mm, sensor.gel.height_mm)
    if pattern.kind != 'dots':
        return
    if pattern.pitch_mm > side:
        raise ValueError(
            f'pattern.pitch_mm is {pattern.pitch_mm:g}, and the gel has {side:g} mm along its shorter side: it is what '
            'lies between one dot and the next'
        )
    if pattern.diameter_mm[1] >= pattern.pitch_mm:
        raise ValueError(
            f'pattern.diameter_mm is {pattern.diameter_mm[1]:g}, and dots that are pattern.pitch_mm, '
            f'{pattern.pitch_mm:g} mm, apart would touch'
        )


def _require_masked_within(sensor: Sensor) -> None:
    width, height = sensor.image.width, sensor.image.height
    for number, text in enumerate(sensor.mask.polygons_px, 1):
        corners = corners_of(text)
        (left, top), (right, bottom) = corners.min(axis=0), corners.max(axis=0)
        if right < 0 or bottom < 0 or left > width - 1 or top > height - 1:
            raise ValueError(
                f'polygon {number} of mask.polygons_px lies wholly outside of pictures of {width}x{height} pixels'
            )


def _require_seen(sensor: Sensor) -> None:
    """By the angle that the gel fills alone: lens distortion and tilt make less of a difference than a slip."""
    camera, size = sensor.camera, sensor.image.crop_px
    leans = math.prod(math.cos(math.radians(min(abs(each), MOST_TILT_DEG))) for each in camera.tilt_deg)
    away_mm = -camera.position_mm[2] / leans
    steep = [side / 2 / away_mm for side in (sensor.gel.width_mm, sensor.gel.height_mm)]
    if camera.model == 'fisheye':
        steep = [math.atan(each) for each in steep]
    wide, high = (2 * focal * each for focal, each in zip(camera.focal_lengths_px, steep, strict=True))
    times = wide / size[0], high / size[1]
    if max(times) >= LEAST_FILLED and min(times) <= MOST_FILLED:
        return
    focal = 'camera.focal_px_per_rad' if camera.model == 'fisheye' else 'camera.focal_px'
    raise ValueError(
        f'{focal} and camera.position_mm make the gel {wide:.0f}x{high:.0f} pixels large, and {size[0]}x{size[1]} are '
        'used; check them, gel.width_mm and gel.height_mm'
    )
