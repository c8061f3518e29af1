"""The number of regions of a described sensor's image."""

from __future__ import annotations

import math

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.sensing.elasticity.regions import Regions
from tactile_nodes.sensors import Sensor

REGIONS_A_PATCH, LEAST_REGION_PX = 20 / 18, 14.0
"""Regions along a side of a patch, as on the paper's sensor; and the least side of a region in which texture can be
tracked."""

NEAR_A_PATCH = 1.8
"""The same for markers near the surface, whose motion changes within a patch. On `speckle_membrane` and `9dtact_like`
totals are then 2.9 and 3.7 % off instead of 4.3 and 6.6 %, centres 0.09 and 0.12 mm instead of 0.09 and 0.16 mm (means
of `tactile bench sensors` with the seeds 101, 606, and 717 with `--each 1`)."""

REGIONS_A_DOT = 1.15
"""Regions per dot along a row of printed dots: with fewer than one, two dots would be merged."""

LEAST_OF_WANTED = 0.5
"""Least number of regions along a side, over the wanted number. A side of 446 px can be divided into 2 or 223 equal
regions, but not into about 20."""

LEAST_SEEN = 0.2
"""Least share of the regions that must see the gel for forces to be estimated."""


def usual_regions(sensor: Sensor) -> Regions:
    """Regions about a tenth narrower than patches, as on the paper's sensor; about half as wide for markers near the
    surface; but at least `LEAST_REGION_PX`. For printed dots they are about a tenth narrower than the pitch.

    Raises:
        ConfigurationError: no such number of regions divides the image.
    """
    whole, sides_px = Regions(sensor, 1, 1), sensor.image.crop_px[::-1]
    if sensor.pattern.kind == 'dots':
        pitch_px = whole.view.px_per_mm * sensor.pattern.pitch_mm
        rows, cols = (_dividing(side, REGIONS_A_DOT * side / pitch_px, side) for side in sides_px)
    else:
        each = NEAR_A_PATCH if whole.near else REGIONS_A_PATCH
        sides = zip(sides_px, whole.patches.shape, strict=True)
        rows, cols = (_dividing(side, each * count, int(side / LEAST_REGION_PX)) for side, count in sides)
    return Regions(sensor, rows, cols)


def _dividing(side_px: int, wanted: float, most: int) -> int:
    """Number of regions along a side of the image: the divisor of its length nearest to the wanted number."""
    dividing = [count for count in range(1, max(1, most) + 1) if side_px % count == 0]
    found = min(dividing, key=lambda count: abs(math.log(count / wanted)))
    if found < LEAST_OF_WANTED * min(wanted, most):
        raise ConfigurationError(
            f'a side of {side_px} px cannot be divided into about {round(min(wanted, most))} equal regions; set '
            f'image.crop and image.crop_height to multiples of 40, such as {side_px // 40 * 40}'
        )
    return found
