"""How many regions the picture of a described sensor is divided into."""

from __future__ import annotations

from tactile_nodes.sensing.elasticity.regions import WINDOW, Regions
from tactile_nodes.sensors import Sensor

REGIONS_A_PATCH, LEAST_REGION_PX = 20 / 18, 14.0
"""Regions along a side of a patch, and pixels along a side of a region: what the paper's sensor has, and the least that
texture can be followed in."""


def usual_regions(sensor: Sensor) -> Regions:
    """Regions about a tenth narrower than patches, as the paper's sensor has them, but at least `LEAST_REGION_PX` wide,
    and where dots are printed so wide that each one's window holds a dot."""
    whole, (width, height) = Regions(sensor, 1, 1), sensor.image.crop_px
    least_px = whole.px_per_mm * sensor.pattern.pitch_mm / WINDOW if sensor.pattern.kind == 'dots' else 0.0
    sides = zip(whole.patches.shape, (height, width), strict=True)
    rows, cols = (_dividing(count, side, max(least_px, LEAST_REGION_PX)) for count, side in sides)
    return Regions(sensor, rows, cols)


def _dividing(patches: int, side_px: int, least_px: float) -> int:
    """How many regions a side of the picture has: of numbers that divide it the nearest to what patches ask for."""
    dividing = [count for count in range(1, max(1, int(side_px / least_px)) + 1) if side_px % count == 0]
    return min(dividing, key=lambda count: abs(count - REGIONS_A_PATCH * patches))
