"""A force distribution and a force field as standard messages that other tools draw: pictures, points, markers.

All carry the header of their source. An invalid distribution has no shape: these messages have no status, so the
picture is NaN, the cloud and the markers are empty, and there is no contact.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tactile_nodes.messages import time_from_ns, types
from tactile_nodes.sensors import Hand
from tactile_nodes.shapes import Float32

POINT_BYTES = 16
ARROW, LINE_STRIP, DELETE_ALL = 0, 4, 3
METRES_PER_NEWTON = 0.02
SHAFT_M, HEAD_M, LINE_M = 0.001, 0.002, 0.0004
OUTLINE_POINTS = 48
MARKER_LIFETIME = types.Duration(sec=1)  # so that no contact stays on the screen when the node has died
OK_COLOUR = types.ColorRGBA(r=0.1, g=0.8, b=0.2, a=1.0)
DEGRADED_COLOUR = types.ColorRGBA(r=1.0, g=0.6, b=0.0, a=1.0)


def is_usable(force: types.ForceDistribution | types.ForceField) -> bool:
    """Whether its numbers can be used at all."""
    return force.status != types.ForceDistribution.STATUS_INVALID


def force_map(force: types.ForceDistribution) -> types.Image:
    """The normal force as a picture of 32FC1 in N: one pixel per bin, rows along y; NaN if it is invalid."""
    return _picture(force, np.asarray(force.normal_force, np.float32))


def pressure_map(field: types.ForceField) -> types.Image:
    """The pressure as a picture of 32FC1 in Pa: one pixel per cell, rows along y; NaN if it is unknown."""
    return _picture(field, np.asarray(field.pressure, np.float32))


def force_points(force: types.ForceDistribution) -> types.PointCloud2:
    """A point at the centre of each bin: x, y, z in m and normal_force in N, float32; in the bins' rows and columns."""
    rows, cols = (force.rows, force.cols) if is_usable(force) else (1, 0)
    table = np.zeros((rows, cols, 4), np.float32)
    if table.size:
        table[..., 0] = force.origin.x + (np.arange(cols) + 0.5) * force.bin_width
        table[..., 1] = (force.origin.y + (np.arange(rows) + 0.5) * force.bin_height)[:, None]
        table[..., 2] = force.origin.z
        table[..., 3] = _forces(force)
    return types.PointCloud2(
        header=force.header,
        height=rows,
        width=cols,
        fields=[_field(name, 4 * place) for place, name in enumerate(('x', 'y', 'z', 'normal_force'))],
        point_step=POINT_BYTES,
        row_step=POINT_BYTES * cols,
        data=_bytes(table),
        is_dense=True,
    )


def contact_point(force: types.ForceDistribution) -> types.PointStamped | None:
    """The position of the largest contact in m; None without contact."""
    if not (force.in_contact and is_usable(force)):
        return None
    return types.PointStamped(header=force.header, point=force.contact)


def contact_markers(force: types.ForceDistribution) -> types.MarkerArray:
    """An arrow for each contact, its head on the gel, along the force including shear, 20 mm per newton.

    Around it, an ellipse with the length and width of the contact, if known. Green, or orange if degraded. The first
    marker deletes those of the previous frame.
    """
    drawn: list[types.Marker] = []
    for number, contact in enumerate(force.contacts if is_usable(force) else []):
        drawn.append(_arrow(force, number))
        if math.isfinite(contact.length) and math.isfinite(contact.width):
            drawn.append(_outline(force, number))
    return types.MarkerArray(markers=[types.Marker(header=force.header, action=DELETE_ALL), *drawn])


def surface_transform(
    parent: str, child: str, xyz_m: tuple[float, ...], rpy_rad: tuple[float, ...], stamp_ns: int
) -> types.TFMessage:
    """The pose of the frame `child` in `parent`.

    Roll, pitch and yaw turn about the fixed axes x, y, z in this order, as in URDF: R = Rz(yaw) Ry(pitch) Rx(roll).
    (0, 0, pi/2) is the quaternion (0, 0, sqrt(1/2), sqrt(1/2)).
    """
    x, y, z = xyz_m
    transform = types.Transform(translation=types.Vector3(x=x, y=y, z=z), rotation=quaternion(*rpy_rad))
    head = types.Header(stamp=time_from_ns(stamp_ns), frame_id=parent)
    return types.TFMessage(transforms=[types.TransformStamped(header=head, child_frame_id=child, transform=transform)])


def hand_transforms(hand: Hand, stamp_ns: int) -> types.TFMessage:
    """The mounting poses of all sensors of a hand, in one message: a latched topic keeps only the last."""
    mounted = [each.frame for each in hand.sensors]
    found = [surface_transform(each.parent, each.id, each.xyz_m, each.rpy_rad, stamp_ns) for each in mounted]
    return types.TFMessage(transforms=[transform for each in found for transform in each.transforms])


def quaternion(roll: float, pitch: float, yaw: float) -> types.Quaternion:
    """The rotation Rz(yaw) Ry(pitch) Rx(roll)."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(each / 2), math.sin(each / 2)) for each in (roll, pitch, yaw))
    return types.Quaternion(
        x=sr * cp * cy - cr * sp * sy,
        y=cr * sp * cy + sr * cp * sy,
        z=cr * cp * sy - sr * sp * cy,
        w=cr * cp * cy + sr * sp * sy,
    )


def _forces(force: types.ForceDistribution) -> Float32[np.ndarray, 'rows cols']:
    return np.asarray(force.normal_force, np.float32).reshape(force.rows, force.cols)


def _bytes(values: np.ndarray) -> np.ndarray:
    """The bytes of float32, little endian, in a separate array: the message freezes it."""
    return np.frombuffer(values.astype('<f4').tobytes(), np.uint8)


def _field(name: str, offset: int) -> types.PointField:
    return types.PointField(name=name, offset=offset, datatype=types.PointField.FLOAT32, count=1)


def _picture(message: types.ForceDistribution | types.ForceField, values: Float32[np.ndarray, ' cells']) -> types.Image:
    """A picture with one pixel per cell."""
    size = message.rows * message.cols
    shown = values if is_usable(message) and values.size == size else np.full(size, np.nan, np.float32)
    return types.Image(
        header=message.header,
        height=message.rows,
        width=message.cols,
        encoding='32FC1',
        step=4 * message.cols,
        data=_bytes(shown),
    )


def _arrow(force: types.ForceDistribution, number: int) -> types.Marker:
    """The force on the gel is (shear x, shear y, -force): the tail points against it. Unknown shear counts as zero."""
    contact = force.contacts[number]
    tip = contact.position
    shear_x, shear_y = (value if math.isfinite(value) else 0.0 for value in (contact.shear_x, contact.shear_y))
    tail = types.Point(
        x=tip.x - METRES_PER_NEWTON * shear_x,
        y=tip.y - METRES_PER_NEWTON * shear_y,
        z=tip.z + METRES_PER_NEWTON * contact.force,
    )
    scale = types.Vector3(x=SHAFT_M, y=HEAD_M, z=HEAD_M)
    return _marker(force, 'contacts', number, type=ARROW, points=[tail, tip], scale=scale)


def _outline(force: types.ForceDistribution, number: int) -> types.Marker:
    contact = force.contacts[number]
    middle, angle = contact.position, contact.angle if math.isfinite(contact.angle) else 0.0
    points = []
    for turn in np.linspace(0, math.tau, OUTLINE_POINTS + 1).tolist():
        along, across = contact.length / 2 * math.cos(turn), contact.width / 2 * math.sin(turn)
        right = along * math.cos(angle) - across * math.sin(angle)
        down = along * math.sin(angle) + across * math.cos(angle)
        points.append(types.Point(x=middle.x + right, y=middle.y + down, z=middle.z))
    return _marker(force, 'outlines', number, type=LINE_STRIP, points=points, scale=types.Vector3(x=LINE_M))


def _marker(force: types.ForceDistribution, group: str, number: int, **fields: Any) -> types.Marker:
    degraded = force.status == types.ForceDistribution.STATUS_DEGRADED
    return types.Marker(
        header=force.header,
        ns=group,
        id=number,
        color=DEGRADED_COLOUR if degraded else OK_COLOUR,
        lifetime=MARKER_LIFETIME,
        **fields,
    )
