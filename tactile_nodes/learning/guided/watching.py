"""What the camera sees of a person's press: nothing touches, something moves, or a press is held still, and where."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, UInt8

from tactile_nodes.learning.imported.agreement import middles
from tactile_nodes.sensing.elasticity.regions import Regions
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.geometry import Crop
from tactile_nodes.sensing.rest.reference import average
from tactile_nodes.sensors import Sensor

UNTOUCHED, MOVING, STEADY = 'untouched', 'moving', 'steady'
HELD = 8
"""So many pictures in a row that show the same are a press held still."""
SIDE, SURE = 10, 0.5
"""Regions along each side of the picture, and how sure the motion of one must be to count."""
OF_TEXTURE = 'inverse_compositional', {'rows': SIDE, 'cols': SIDE, 'finest_scale': 1}
TOUCHED, LEAST_PX, SAME_SHARE = 3.0, 0.02, 0.04
"""Times what the untouched gel seems to move by, at least so much: a region that moves more is touched. Two pictures
are of one press if no region moves more than that between them, beside a share of the most that the press moves."""


class Watch:
    """Looks at picture after picture beside the mean of those of the untouched gel.

    Args:
        sensor: the description, by which a place in the picture is one on the gel.
        rests: pictures of the untouched gel, which tell what noise makes.

    Raises:
        ImageError: they show nothing that could be followed.
    """

    def __init__(self, sensor: Sensor, rests: Sequence[UInt8[np.ndarray, 'h w']]) -> None:
        self._held = deque[np.ndarray](maxlen=HELD)
        width, height = (side // (2 * SIDE) * 2 * SIDE for side in sensor.image.crop_px)  # halved, regions divide it
        self._crop = Crop.centred(sensor.image.width, sensor.image.height, width, height)
        regions = {'rows': SIDE, 'cols': SIDE}
        dots = sensor.pattern.kind == 'dots'
        self._flow = make_flow('dots', regions) if dots else make_flow(*OF_TEXTURE)
        self._flow.set_reference(np.ascontiguousarray(self._crop.apply(average(rests))))
        places = np.stack(np.meshgrid(*(np.linspace(-0.4, 0.4, 9) * side for side in _sides(sensor))), axis=-1)
        seen = Regions(sensor, 1, 1).shares_of(places.reshape(-1, 2))
        self._place_of = np.linalg.lstsq(_with_one(seen), places.reshape(-1, 2), rcond=None)[0]
        self.state, self.place_mm = UNTOUCHED, (np.nan, np.nan)
        self._touched_px = TOUCHED * max(LEAST_PX, *(_most(self._looked_at(each)[0]) for each in rests))

    def see(self, picture: UInt8[np.ndarray, 'h w']) -> str:
        """Take one picture; the state."""
        motion, place = self._looked_at(picture)
        self._held.append(motion)
        self.place_mm = place
        if _most(motion) < self._touched_px:
            self.state = UNTOUCHED
        else:
            same = len(self._held) == HELD and all(self._alike(self._held[0], each) for each in self._held)
            self.state = STEADY if same else MOVING
        return self.state

    def holds(self, picture: UInt8[np.ndarray, 'h w'], other: UInt8[np.ndarray, 'h w']) -> bool:
        """Whether two pictures show the same press."""
        return self._alike(self._looked_at(picture)[0], self._looked_at(other)[0])

    def _alike(self, one: Float[np.ndarray, 'rows cols 2'], other: Float[np.ndarray, 'rows cols 2']) -> bool:
        """Whether no region moves from one to the other, beyond noise and a share of what the press moves."""
        return _most(other - one) <= self._touched_px + SAME_SHARE * _most(one)

    def _looked_at(self, picture: UInt8[np.ndarray, 'h w']) -> tuple[np.ndarray, tuple[float, float]]:
        field = self._flow.displacement(np.ascontiguousarray(self._crop.apply(picture)))
        assert field.confidence is not None
        motion = field.displacement_px * (field.confidence >= SURE)[..., None]
        x, y = (_with_one(middles(np.square(motion).sum(axis=-1)[None])) @ self._place_of)[0].tolist()
        return motion, (x, y)


def _most(motion: Float[np.ndarray, 'rows cols 2']) -> float:
    """By which the regions move most, but for the hundredth that may be lost."""
    return float(np.percentile(np.hypot(motion[..., 0], motion[..., 1]), 99))


def _with_one(values: Float[np.ndarray, 'n 2']) -> Float[np.ndarray, 'n 3']:
    return np.column_stack([values, np.ones(len(values))])


def _sides(sensor: Sensor) -> tuple[float, float]:
    return sensor.gel.width_mm, sensor.gel.height_mm
