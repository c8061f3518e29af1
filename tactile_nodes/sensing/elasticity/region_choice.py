"""How many regions the picture of a described sensor is divided into."""

from __future__ import annotations

import math

from tactile_nodes.sensing.elasticity.regions import Regions
from tactile_nodes.sensors import Sensor

REGIONS_A_PATCH, LEAST_REGION_PX = 20 / 18, 14.0
"""Regions along a side of a patch, and pixels along a side of a region: what the paper's sensor has, and the least that
texture can be followed in."""

REGIONS_A_DOT = 1.15
"""Along a row of printed dots: with fewer than one, two dots are told as one."""

LEAST_SEEN = 0.2
"""Share of the regions that have to see the gel, so that forces can be told."""


def usual_regions(sensor: Sensor) -> Regions:
    """Regions about a tenth narrower than patches, as the paper's sensor has them, but at least `LEAST_REGION_PX` wide;
    of printed dots about a tenth narrower than they are apart."""
    whole, sides_px = Regions(sensor, 1, 1), sensor.image.crop_px[::-1]
    if sensor.pattern.kind == 'dots':
        pitch_px = whole.view.px_per_mm * sensor.pattern.pitch_mm
        rows, cols = (_dividing(side, REGIONS_A_DOT * side / pitch_px, side) for side in sides_px)
    else:
        sides = zip(sides_px, whole.patches.shape, strict=True)
        rows, cols = (_dividing(side, REGIONS_A_PATCH * count, int(side / LEAST_REGION_PX)) for side, count in sides)
    return Regions(sensor, rows, cols)


def _dividing(side_px: int, wanted: float, most: int) -> int:
    """How many regions a side of the picture has: of numbers that divide it the nearest to what is wanted."""
    dividing = [count for count in range(1, max(1, most) + 1) if side_px % count == 0]
    return min(dividing, key=lambda count: abs(math.log(count / wanted)))
