"""A force distribution in the standard messages that other tools draw: picture, points, contact, markers.

All carry the header of what they are made of. A distribution that is invalid has no shape: these messages hold no
status, so the picture is NaN, the cloud and the markers are empty, and there is no contact.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float32

from tactile_nodes.messages import time_from_ns, types

POINT_BYTES = 16
ARROW, DELETE_ALL = 0, 3
METRES_PER_NEWTON = 0.02
SHAFT_M, HEAD_M = 0.001, 0.002
OK_COLOUR = types.ColorRGBA(r=0.1, g=0.8, b=0.2, a=1.0)
DEGRADED_COLOUR = types.ColorRGBA(r=1.0, g=0.6, b=0.0, a=1.0)


def is_usable(force: types.ForceDistribution) -> bool:
    """Whether its numbers may be used at all."""
    return force.status != types.ForceDistribution.STATUS_INVALID


def force_map(force: types.ForceDistribution) -> types.Image:
    """The normal force on each bin as a picture of 32FC1 in N: a pixel a bin, rows along y; NaN when it is invalid."""
    values = _forces(force) if is_usable(force) else np.full((force.rows, force.cols), np.nan, np.float32)
    return types.Image(
        header=force.header,
        height=force.rows,
        width=force.cols,
        encoding='32FC1',
        step=4 * force.cols,
        data=_bytes(values),
    )


def force_points(force: types.ForceDistribution) -> types.PointCloud2:
    """A point at the centre of each bin: x, y, z in m and normal_force in N, float32; as rows and columns of bins."""
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
    """The place of the largest contact in m; None when nothing touches."""
    if not (force.in_contact and is_usable(force)):
        return None
    return types.PointStamped(header=force.header, point=force.contact)


def contact_markers(force: types.ForceDistribution) -> types.MarkerArray:
    """An arrow for each contact, its head on the gel, 20 mm long for a newton; green, or orange when degraded.

    The first marker takes away those of the frame before.
    """
    arrows = [_arrow(force, number) for number in range(len(force.contacts))] if is_usable(force) else []
    return types.MarkerArray(markers=[types.Marker(header=force.header, action=DELETE_ALL), *arrows])


def surface_transform(
    parent: str, child: str, xyz_m: tuple[float, ...], rpy_rad: tuple[float, ...], stamp_ns: int
) -> types.TFMessage:
    """Where the frame `child` stands in `parent`.

    Roll, pitch and yaw turn about the fixed axes x, y, z in this order, as in URDF: R = Rz(yaw) Ry(pitch) Rx(roll).
    (0, 0, pi/2) is the quaternion (0, 0, sqrt(1/2), sqrt(1/2)).
    """
    x, y, z = xyz_m
    transform = types.Transform(translation=types.Vector3(x=x, y=y, z=z), rotation=quaternion(*rpy_rad))
    head = types.Header(stamp=time_from_ns(stamp_ns), frame_id=parent)
    return types.TFMessage(transforms=[types.TransformStamped(header=head, child_frame_id=child, transform=transform)])


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
    """The bytes of float32, little endian, in an array of their own: the message freezes it."""
    return np.frombuffer(values.astype('<f4').tobytes(), np.uint8)


def _field(name: str, offset: int) -> types.PointField:
    return types.PointField(name=name, offset=offset, datatype=types.PointField.FLOAT32, count=1)


def _arrow(force: types.ForceDistribution, number: int) -> types.Marker:
    contact = force.contacts[number]
    tip = contact.position
    tail = types.Point(x=tip.x, y=tip.y, z=tip.z + METRES_PER_NEWTON * contact.force)
    degraded = force.status == types.ForceDistribution.STATUS_DEGRADED
    return types.Marker(
        header=force.header,
        ns='contacts',
        id=number,
        type=ARROW,
        points=[tail, tip],
        pose=types.Pose(orientation=types.Quaternion(w=1.0)),
        scale=types.Vector3(x=SHAFT_M, y=HEAD_M, z=HEAD_M),
        color=DEGRADED_COLOUR if degraded else OK_COLOUR,
    )
