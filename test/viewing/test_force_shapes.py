"""A force distribution as picture, points, contact, markers, and where its frame stands."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tactile_nodes.messages import decode, encode, stamp_ns, types
from tactile_nodes.viewing import force_shapes

FORCE = types.ForceDistribution
HEAD = types.Header(stamp=types.Time(sec=7, nanosec=9), frame_id='gel_surface')


def force(status: int = FORCE.STATUS_OK, touched: bool = True) -> types.ForceDistribution:
    """Two rows of three bins of 2 mm x 3 mm, with 0.5 N on the bin of row 1, column 2, whose centre is (2, 1.5) mm."""
    values = np.zeros(6, np.float32)
    values[5] = 0.5
    place = types.Point(x=0.002, y=0.0015)
    return FORCE(
        header=HEAD, rows=2, cols=3, bin_width=0.002, bin_height=0.003, origin=types.Point(x=-0.003, y=-0.003),
        normal_force=values, total=0.5, in_contact=touched, contact=place, status=status,
        contacts=[types.Contact(position=place, force=0.5, length=math.nan)] if touched else [],
    )  # fmt: skip


def points(message: types.PointCloud2) -> np.ndarray:
    return np.asarray(message.data).view('<f4').reshape(message.height, message.width, 4)


def test_the_map_is_a_picture_of_newtons_with_rows_along_y() -> None:
    picture = decode(encode(force_shapes.force_map(force())), 'sensor_msgs/msg/Image')
    assert (picture.height, picture.width, picture.step, picture.encoding) == (2, 3, 12, '32FC1')
    assert picture.is_bigendian == 0
    assert np.asarray(picture.data).view('<f4').tolist() == [0, 0, 0, 0, 0, 0.5]


def test_each_point_is_the_centre_of_its_bin_with_its_force() -> None:
    cloud = decode(encode(force_shapes.force_points(force())), 'sensor_msgs/msg/PointCloud2')
    found = points(cloud)
    assert found[1, 2] == pytest.approx([0.002, 0.0015, 0.0, 0.5])
    assert found[0, 0] == pytest.approx([-0.002, -0.0015, 0.0, 0.0])
    assert [(field.name, field.offset, field.datatype) for field in cloud.fields] == [
        ('x', 0, 7), ('y', 4, 7), ('z', 8, 7), ('normal_force', 12, 7),
    ]  # fmt: skip
    assert (cloud.point_step, cloud.row_step, len(cloud.data)) == (16, 48, 96)


@pytest.mark.parametrize(
    'shape',
    [
        force_shapes.force_map,
        force_shapes.force_points,
        force_shapes.contact_point,
        lambda force: force_shapes.contact_markers(force).markers[-1],
    ],
)
def test_every_view_carries_stamp_and_frame_of_the_image(shape) -> None:  # type: ignore[no-untyped-def]
    head = shape(force()).header
    assert (stamp_ns(head.stamp), head.frame_id) == (7_000_000_009, 'gel_surface')


def test_an_arrow_of_20_mm_a_newton_ends_at_the_contact() -> None:
    clear, arrow = decode(encode(force_shapes.contact_markers(force())), 'visualization_msgs/msg/MarkerArray').markers
    assert clear.action == types.Marker.DELETEALL
    assert (arrow.type, arrow.action) == (types.Marker.ARROW, types.Marker.ADD)
    tail, tip = arrow.points
    assert (tail.x, tail.y, tail.z) == pytest.approx((0.002, 0.0015, 0.010))
    assert (tip.x, tip.y, tip.z) == (0.002, 0.0015, 0.0)


def test_the_arrow_lies_along_the_force_where_shear_is_known_and_an_ellipse_is_as_large_as_the_contact() -> None:
    place = types.Point(x=0.002, y=0.0015)
    contact = types.Contact(
        position=place, force=0.5, shear_x=0.1, shear_y=-0.2, length=0.010, width=0.004, angle=math.pi / 2
    )
    force = FORCE(header=HEAD, rows=1, cols=1, contacts=[contact], in_contact=True)
    _, arrow, outline = force_shapes.contact_markers(force).markers
    tail, tip = arrow.points
    assert (tip.x - tail.x, tip.y - tail.y, tip.z - tail.z) == pytest.approx((0.002, -0.004, -0.010))
    assert (outline.type, outline.ns) == (types.Marker.LINE_STRIP, 'outlines')
    x, y = ([getattr(each, name) for each in outline.points] for name in ('x', 'y'))
    assert (min(y), max(y)) == pytest.approx((0.0015 - 0.005, 0.0015 + 0.005))  # turned by 90°: long along y
    assert (min(x), max(x)) == pytest.approx((0.002 - 0.002, 0.002 + 0.002))


def test_shear_and_size_that_are_not_known_are_not_drawn() -> None:
    unknown = types.Contact(force=0.5, **dict.fromkeys(('shear_x', 'shear_y', 'length', 'width', 'angle'), math.nan))
    force = FORCE(header=HEAD, rows=1, cols=1, contacts=[unknown], in_contact=True)
    _, arrow = force_shapes.contact_markers(force).markers
    assert (arrow.points[0].x, arrow.points[0].y) == (0.0, 0.0)


def test_an_invalid_pressure_is_no_number() -> None:
    field = types.ForceField(rows=2, cols=2, pressure=np.ones(4, np.float32), status=FORCE.STATUS_INVALID)
    assert np.isnan(np.asarray(force_shapes.pressure_map(field).data).view('<f4')).all()


def test_arrows_of_a_degraded_force_have_another_colour() -> None:
    fine, degraded = (
        force_shapes.contact_markers(force(status)).markers[1].color
        for status in (FORCE.STATUS_OK, FORCE.STATUS_DEGRADED)
    )
    assert (fine.r, fine.g, fine.b) != (degraded.r, degraded.g, degraded.b)


def test_an_arrow_vanishes_a_second_after_its_force() -> None:
    """When the node has died, nothing deletes it."""
    _, arrow = force_shapes.contact_markers(force()).markers
    assert (arrow.lifetime.sec, arrow.lifetime.nanosec) == (1, 0)


def test_without_touch_there_is_no_contact_and_no_arrow() -> None:
    assert force_shapes.contact_point(force(touched=False)) is None
    assert len(force_shapes.contact_markers(force(touched=False)).markers) == 1


def test_an_invalid_force_is_drawn_by_nothing() -> None:
    invalid = force(FORCE.STATUS_INVALID)
    assert np.isnan(np.asarray(force_shapes.force_map(invalid).data).view('<f4')).all()
    assert force_shapes.force_points(invalid).width == 0
    assert force_shapes.contact_point(invalid) is None
    assert [marker.action for marker in force_shapes.contact_markers(invalid).markers] == [types.Marker.DELETEALL]


def test_the_transform_leads_from_the_surface_to_its_parent() -> None:
    (made,) = force_shapes.surface_transform(
        'finger', 'gel_surface', (1.0, 2.0, 3.0), (0.0, 0.0, math.pi / 2), 5
    ).transforms
    assert (made.header.frame_id, made.child_frame_id, stamp_ns(made.header.stamp)) == ('finger', 'gel_surface', 5)
    assert (made.transform.translation.x, made.transform.translation.z) == (1.0, 3.0)
    turn = made.transform.rotation
    assert (turn.x, turn.y, turn.z, turn.w) == pytest.approx((0, 0, math.sqrt(0.5), math.sqrt(0.5)))


def test_roll_comes_before_yaw() -> None:
    # Rz(90°) Rx(90°) takes x to y, y to z, z to x: the turn by 120° about (1, 1, 1), quaternion (1, 1, 1, 1) / 2.
    turn = force_shapes.quaternion(math.pi / 2, 0.0, math.pi / 2)
    assert (turn.x, turn.y, turn.z, turn.w) == pytest.approx((0.5, 0.5, 0.5, 0.5))
