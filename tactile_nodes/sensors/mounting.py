"""Where the gel's surface is on a robot, and the name of its frame in messages."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactile_nodes.params import parameter
from tactile_nodes.shapes import Float


@dataclass(frozen=True)
class Mounting:
    """The surface frame in its parent frame. Roll, pitch and yaw turn about the parent's fixed axes, as in URDF.

    Raises:
        ValueError: a name is not valid in ROS, a frame is its own parent, or three numbers are missing.
    """

    id: str = parameter('gel_surface', 'name of the surface frame in messages')
    parent: str = parameter(
        'tactile_sensor', 'parent frame; empty: the transform is published elsewhere, for example by a URDF'
    )
    position_mm: tuple[float, ...] = parameter((0.0, 0.0, 0.0), "the surface's origin in the parent frame")
    rpy_deg: tuple[float, ...] = parameter((0.0, 0.0, 0.0), "roll, pitch and yaw about the parent's fixed axes x, y, z")

    def __post_init__(self) -> None:
        for name in ('position_mm', 'rpy_deg'):
            given = getattr(self, name)
            if len(given) != 3:
                raise ValueError(f'frame.{name} must hold 3 numbers, got {list(given)}')
        for name, frame in (('id', self.id), ('parent', self.parent)):
            if frame.startswith('/') or any(map(str.isspace, frame)):
                raise ValueError(f'frame.{name} is {frame!r}; names of frames have no spaces and no leading slash')
        if not self.id or self.id == self.parent:
            raise ValueError(f'frame.id is {self.id!r}, but must be given and differ from frame.parent')

    @property
    def xyz_m(self) -> tuple[float, ...]:
        return tuple(each / 1000 for each in self.position_mm)

    @property
    def rpy_rad(self) -> tuple[float, ...]:
        return tuple(map(math.radians, self.rpy_deg))

    def coincides(self, other: Mounting) -> bool:
        """Whether both surfaces are at one place, to a millimetre, and their z axes less than 30 degrees apart."""
        one, two = self.parent_from_surface, other.parent_from_surface
        return bool(math.dist(one[:3, 3], two[:3, 3]) < 1e-3 and one[:3, 2] @ two[:3, 2] > math.cos(math.radians(30)))

    @cached_property
    def parent_from_surface(self) -> Float[np.ndarray, '4 4']:
        """Transforms points (x, y, z, 1) [m] from surface to parent frame: Rz(yaw) Ry(pitch) Rx(roll), then a shift.

        Mounted at (0, 0, 12) mm and turned by (0, 90, 0) degrees the surface's z axis is the parent's x axis, and
        (0, 0, 0.001, 1) is at (0.001, 0, 0.012, 1).
        """
        (cr, sr), (cp, sp), (cy, sy) = ((math.cos(each), math.sin(each)) for each in self.rpy_rad)
        matrix = np.eye(4)
        matrix[:3, :3] = (
            (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
            (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
            (-sp, cp * sr, cp * cr),
        )
        matrix[:3, 3] = self.xyz_m
        matrix.flags.writeable = False
        return matrix

    def __str__(self) -> str:
        place, turn = (', '.join(f'{each:g}' for each in given) for given in (self.position_mm, self.rpy_deg))
        at = (
            f'at ({place}) mm in {self.parent}, turned by ({turn}) degrees'
            if self.parent
            else 'mounted as another node publishes'
        )
        return f'{self.id}, {at}'
