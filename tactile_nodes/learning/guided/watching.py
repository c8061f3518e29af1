"""What the camera sees of a person's press: no contact, motion, or a press held still, and its place."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from tactile_nodes.learning.agreement.objections import middles
from tactile_nodes.learning.field.calibration import measured_by
from tactile_nodes.sensing.elasticity.regions import Regions
from tactile_nodes.sensing.elasticity.view import View
from tactile_nodes.sensing.features import make_encoding
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.geometry import centre_crop
from tactile_nodes.sensing.rest.prepared import Measuring
from tactile_nodes.sensing.rest.reference import average
from tactile_nodes.sensors import Sensor
from tactile_nodes.shapes import Float, UInt8

UNTOUCHED, MOVING, STEADY = 'untouched', 'moving', 'steady'
REGIONS = 10
HELD = 8
"""Number of successive images that must agree for a press to count as held still."""
OF_TEXTURE = {
    'flow': {'name': 'inverse_compositional', 'options': {'finest_scale': 0}},
    'encoding': {'name': 'cartesian_mean', 'options': {}},
}
LEAST_NOISE_PX = 0.01
"""Least noise of regions in images at rest, which is that of the simulated sensor. 20 g move them by 0.18 px,
those of printed dots by 0.26 with a noise of 0.054."""
TOUCHED_NOISE, SAME_NOISE, SAME_SHARE = 3.0, 2.0, 0.03
"""Thresholds in units of that noise: for contact, and for the difference between two images of one press. The third
is a share of the largest motion, added to the second."""

FOLLOWED = 0.02
"""Share of what is left of the motion that an image of the untouched gel adds to what is subtracted: cameras drift. At
60 images a second, a press still counts if a region moves by more than 0.04 px in a second."""


class Watch:
    """Compares image after image with the untouched gel.

    Args:
        sensor: the description, which relates places in the image to places on the gel.
        rests: images of the untouched gel, for the reference image (their mean) and the noise.

    Raises:
        ImageError: they show no markers.
    """

    def __init__(self, sensor: Sensor, rests: Sequence[UInt8[np.ndarray, 'h w']]) -> None:
        self._held = deque[np.ndarray](maxlen=HELD)
        regions = {'rows': REGIONS, 'cols': REGIONS}
        methods = measured_by(sensor, OF_TEXTURE, regions, [])
        width, height = (side // REGIONS * REGIONS for side in sensor.image.crop_px)
        self._size = width, height
        flow, encoding = make_flow(**methods['flow']), make_encoding(**methods['encoding'])
        self._rest = Measuring(flow, encoding).beside(self._cut(average(rests)))
        sides_mm = sensor.gel.width_mm, sensor.gel.height_mm
        places = np.stack(np.meshgrid(*(np.linspace(-0.4, 0.4, 9) * side for side in sides_mm)), axis=-1)
        seen = View(sensor).shares_of(places.reshape(-1, 2))
        self._usable = Regions(sensor, REGIONS, REGIONS).usable.reshape(REGIONS, REGIONS)
        self._drifted_px = np.zeros((REGIONS, REGIONS, 2), np.float32)
        self._place_of = np.linalg.lstsq(_with_one(seen), places.reshape(-1, 2), rcond=None)[0]
        self._noise_px = max(LEAST_NOISE_PX, *(_most(self._looked_at(each)[0]) for each in rests))
        self.state, self.place_mm = UNTOUCHED, (np.nan, np.nan)

    def see(self, picture: UInt8[np.ndarray, 'h w']) -> str:
        """Process one image; returns the state."""
        motion, place = self._looked_at(picture)
        self._held.append(motion)
        self.place_mm = place
        if _most(motion) < TOUCHED_NOISE * self._noise_px:
            self.state = UNTOUCHED
            self._drifted_px += FOLLOWED * np.nan_to_num(motion)
        else:
            same = len(self._held) == HELD and all(self._alike(self._held[0], each) for each in self._held)
            self.state = STEADY if same else MOVING
        return self.state

    def holds(self, picture: UInt8[np.ndarray, 'h w'], other: UInt8[np.ndarray, 'h w']) -> bool:
        """Whether two images show the same press."""
        return self._alike(self._looked_at(picture)[0], self._looked_at(other)[0])

    def _cut(self, picture: UInt8[np.ndarray, 'h w']) -> UInt8[np.ndarray, 'h2 w2']:
        return np.ascontiguousarray(centre_crop(picture, *self._size))

    def _alike(self, one: Float[np.ndarray, 'rows cols 2'], other: Float[np.ndarray, 'rows cols 2']) -> bool:
        return _most(other - one) <= SAME_NOISE * self._noise_px + SAME_SHARE * _most(one)

    def _looked_at(self, picture: UInt8[np.ndarray, 'h w']) -> tuple[np.ndarray, tuple[float, float]]:
        seen = self._rest.features(self._cut(picture))
        followed = (seen.confidence >= 0.5) & self._usable
        motion = np.where(followed[..., None], seen.values - self._drifted_px, np.nan)
        moved = np.nan_to_num(np.square(motion).sum(axis=-1))
        x, y = (_with_one(middles(moved[None])) @ self._place_of)[0].tolist()
        return motion, (x, y)


def _most(motion: Float[np.ndarray, 'rows cols 2']) -> float:
    """The largest motion of the regions, except for a hundredth; regions that are not tracked (NaN) are ignored."""
    moved = np.hypot(motion[..., 0], motion[..., 1])
    return float(np.nanpercentile(moved, 99)) if np.isfinite(moved).any() else 0.0


def _with_one(values: Float[np.ndarray, 'n 2']) -> Float[np.ndarray, 'n 3']:
    return np.column_stack([values, np.ones(len(values))])
