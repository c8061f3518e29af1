"""The path of a body on the gel, solved stage by stage: pressed to a force, then dragged and twisted under it.

A track is solved once, in the middle of a layer of modulus 1. It holds for every place on the surface and for gels of
every modulus, since the deformation under forces in proportion to the modulus does not depend on it. Lifting the body
is the same path backwards: friction is not computed there.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass

import numpy as np

from tactile_nodes.shapes import Float, Float32
from tactile_nodes.simulation.touch.body import Body
from tactile_nodes.simulation.touch.bricks import Bricks, Layer
from tactile_nodes.simulation.touch.pressing import Pose, Pressing, Standing

RECIPE = 1
"""Raised when the code gives another solution of the same problem."""


@dataclass(frozen=True)
class Way:
    """Pressed to `force_mm2` (force over the shear modulus), then dragged by `drag_mm` towards `drag_rad` and turned.

    1 N on a gel of 0.111 MPa is 9.01 mm². With `depth_mm` it is pressed to that depth and dragged at it, however hard.
    """

    force_mm2: float = 9.0
    depth_mm: float = 0.0
    drag_mm: float = 0.0
    drag_rad: float = 0.0
    twist_rad: float = 0.0
    friction: float = 0.6
    press_stages: int = 5
    drag_stages: int = 4

    @property
    def poses(self) -> Iterator[tuple[Pose, float]]:
        """Pose of the body at each stage, and how far it is pressed (0 to 1); it does not touch at the first stage."""
        for number in range(self.press_stages + 1):
            yield Pose(), (number / self.press_stages) ** (1.0 if self.depth_mm else 1.5)
        if not (self.drag_mm or self.twist_rad):
            return
        for number in range(1, self.drag_stages + 1):
            share = number / self.drag_stages
            along = share * self.drag_mm * np.array([np.cos(self.drag_rad), np.sin(self.drag_rad)])
            yield Pose(float(along[0]), float(along[1]), share * self.twist_rad), 1.0


@dataclass(frozen=True)
class Track:
    """The layer at each stage, in the body's frame at first contact; forces are over the shear modulus.

    `moved_mm[stage, z, axis, y, x]` is on the layer's own grid. `node_mm` are the rest positions of all surface nodes
    that are ever touched. `node_force[stage, node]` is the force on them: x, y, z out of the gel, so presses are < 0.
    """

    line_mm: Float[np.ndarray, ' cells']
    z_mm: Float[np.ndarray, ' heights']
    depth_mm: Float[np.ndarray, ' stages']
    shift_mm: Float[np.ndarray, 'stages 2']
    turn_rad: Float[np.ndarray, ' stages']
    moved_mm: Float32[np.ndarray, 'stages z 3 y x']
    node_mm: Float32[np.ndarray, 'nodes 2']
    node_force: Float32[np.ndarray, 'stages nodes 3']
    slip_share: Float[np.ndarray, ' stages']
    key: str

    @property
    def force(self) -> Float[np.ndarray, 'stages 3']:
        """The whole force on the gel (over the shear modulus): x, y, and into the gel."""
        total: np.ndarray = self.node_force.sum(axis=1, dtype=float) * [1, 1, -1]
        return total


def track_key(layer: Layer, body: Body, way: Way) -> str:
    """Sixteen hexadecimal digits that change with the layer, the body, its path, or the method of solution."""
    divided = {**asdict(layer), 'moduli': []}  # as in the keys of the tables that ship: all rows are alike
    text = json.dumps([RECIPE, divided, asdict(way), body.spacing_mm], sort_keys=True)
    shape = np.round(body.height_mm, 6).astype(np.float32).tobytes()
    return hashlib.sha256(text.encode() + shape).hexdigest()[:16]


def solve_track(
    bricks: Bricks,
    body: Body,
    way: Way,
    tell: Callable[[int, int], None] | None = None,
    shear_modulus_mpa: float = 1.0,
) -> Track:
    """Solve all stages of a path, about a second each; `tell` is called with the number done and the number of all.

    The track is the same for every modulus. An error gives the force on a gel of `shear_modulus_mpa`.

    Raises:
        ConfigurationError: the strain is too large, or the body is larger than the layer.
    """
    pressing, found = Pressing(bricks, body, way.friction, shear_modulus_mpa), []
    wanted = list(way.poses)
    for number, (pose, share) in enumerate(wanted):
        if share == 0:
            found.append(pressing.standing)
        elif way.depth_mm:
            found.append(pressing.advance(pose, depth_mm=share * way.depth_mm))
        else:
            found.append(pressing.advance(pose, share * way.force_mm2))
        if tell is not None:
            tell(number + 1, len(wanted))
    return _track(bricks.layer, found, track_key(bricks.layer, body, way))


def _track(layer: Layer, found: list[Standing], key: str) -> Track:
    forces = np.stack([each.force for each in found])
    row, column = np.nonzero((forces != 0).any(axis=(0, 1)))
    node_force = forces[:, :, row, column].transpose(0, 2, 1)
    touched = np.maximum((forces[:, 2] < 0).sum(axis=(1, 2)), 1)
    return Track(
        line_mm=layer.line_mm,
        z_mm=layer.z_mm,
        depth_mm=np.array([each.depth_mm for each in found]),
        shift_mm=np.array([[each.pose.x_mm, each.pose.y_mm] for each in found]),
        turn_rad=np.array([each.pose.turn_rad for each in found]),
        moved_mm=np.stack([each.state.moved for each in found]),
        node_mm=np.stack([layer.line_mm[column], layer.line_mm[row]], -1).astype(np.float32),
        node_force=node_force.astype(np.float32),
        slip_share=np.array([each.slips.sum() for each in found]) / touched,
        key=key,
    )
