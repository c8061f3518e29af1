"""Views of the force for other tools: made on demand, one stamp, a latched transform."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from feeding import START_NS, came, given, run
from seen import CELLS, ring

from tactile_nodes import conversions
from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.protocol import Publisher
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.topics import Topic
from tactile_nodes.clock import SteppedClock
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.messages import stamp_ns, types
from tactile_nodes.nodes import force_views
from tactile_nodes.nodes.force_views import ForceViewsNode

Listen = Callable[[Topic], Subscription]
Advertise = Callable[[Topic], Publisher]
VIEWS = (topics.FORCE_MAP, topics.FORCE_POINTS, topics.CONTACT, topics.CONTACT_MARKERS)


def node(bus: InProcessBus, clock: SteppedClock, *parameters: str) -> ForceViewsNode:
    return ForceViewsNode(bus, given(*parameters), clock)


def force() -> types.ForceDistribution:
    head, bins = conversions.header(START_NS, 'gel_surface'), np.array([0.0, 0.5], np.float32)
    touched = [types.Contact(force=0.5)]
    return types.ForceDistribution(header=head, rows=1, cols=2, normal_force=bins, in_contact=True, contacts=touched)


@pytest.mark.parametrize('view', VIEWS, ids=lambda view: view.name)
def test_whoever_listens_gets_each_view_with_the_stamp_of_its_image(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise, view: Topic
) -> None:
    tested, subscription, source = node(bus, clock), listen(view), publisher(topics.FORCE_DISTRIBUTION)
    source.publish(force())
    run(tested)
    view_message = came(subscription)
    head = view_message.markers[-1].header if view is topics.CONTACT_MARKERS else view_message.header
    assert (stamp_ns(head.stamp), head.frame_id) == (START_NS, 'gel_surface')


def test_a_force_whose_bins_do_not_fill_its_grid_is_reported_and_the_next_one_shown(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise, capsys: pytest.CaptureFixture[str]
) -> None:
    tested, points, source = node(bus, clock), listen(topics.FORCE_POINTS), publisher(topics.FORCE_DISTRIBUTION)
    source.publish(dataclasses.replace(force(), rows=2))
    run(tested)
    assert 'errors: a force distribution has 2 bins, but a grid of 2 x 2' in capsys.readouterr().err
    source.publish(force())
    run(tested)
    received = came(points)
    assert (received.height, received.width) == (1, 2)


def test_only_what_somebody_listens_to_is_made(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(force: types.ForceDistribution) -> types.Image:
        raise AssertionError('nobody listens to the map')

    monkeypatch.setattr(force_views.force_shapes, 'force_map', refuse)
    tested, subscription, source = node(bus, clock), listen(topics.CONTACT), publisher(topics.FORCE_DISTRIBUTION)
    source.publish(force())
    run(tested)
    assert subscription.take() is not None


def test_the_field_is_received_only_while_somebody_wants_the_pressure(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise
) -> None:
    tested, source = node(bus, clock), publisher(topics.FORCE_FIELD)
    look(tested, clock)
    assert source.listeners == 0
    subscription = listen(topics.PRESSURE_MAP)
    look(tested, clock)
    assert source.listeners == 1
    source.publish(ring(START_NS)[1])
    run(tested)
    view_message = came(subscription)
    shown = (view_message.encoding, view_message.height, view_message.width)
    assert (*shown, stamp_ns(view_message.header.stamp)) == ('32FC1', CELLS, CELLS, START_NS)
    assert np.asarray(view_message.data).view('<f4').sum() == pytest.approx(2e6, rel=1e-5)  # 2 N on cells of 1 mm²
    subscription.close()
    look(tested, clock)
    assert source.listeners == 0


def look(tested: ForceViewsNode, clock: SteppedClock) -> None:
    clock.advance(force_views.LOOK_PERIOD_S)
    tested.spin_once()
    run(tested)


def test_whoever_comes_later_still_gets_the_transform(bus: InProcessBus, clock: SteppedClock, listen: Listen) -> None:
    tested = node(bus, clock, 'parent_frame_id:=finger', 'xyz_m:=[0.0, 0.0, 0.02]')
    subscription = listen(topics.TF_STATIC)
    run(tested)
    (transform,) = came(subscription).transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ('finger', 'gel_surface')
    assert transform.transform.translation.z == 0.02


def test_without_a_parent_frame_no_transform_is_reported(
    bus: InProcessBus, clock: SteppedClock, listen: Listen
) -> None:
    tested = node(bus, clock, "parent_frame_id:=''")
    subscription = listen(topics.TF_STATIC)
    run(tested)
    assert subscription.take() is None


def test_a_place_of_two_numbers_is_refused(bus: InProcessBus, clock: SteppedClock) -> None:
    with pytest.raises(ConfigurationError, match='xyz_m takes three numbers, got 2'):
        node(bus, clock, 'xyz_m:=[0.0, 0.0]')


def test_diagnostics_say_what_was_made_of_which_view(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise
) -> None:
    tested, _, source = node(bus, clock), listen(topics.CONTACT), publisher(topics.FORCE_DISTRIBUTION)
    for _ in range(2):
        source.publish(force())
        run(tested)
    tested._report()
    (status,) = tested.diagnostics.message(0).status
    assert (status.name, status.hardware_id, status.message) == (
        'force_views: views',
        'none',
        '1 of 5 views have subscribers',
    )
    assert {entry.key: entry.value for entry in status.values} == {
        '/force_map': '0', '/force_points': '0', '/contact': '2', '/contact_markers': '0',
        '/pressure_map': '0',
    }  # fmt: skip


def test_a_described_sensor_says_where_it_is_mounted(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, tmp_path: Path
) -> None:
    # Pitched by 90 degrees: half of the angle is 45, so the quaternion is (0, sin 45, 0, cos 45).
    mounting = 'id: left_finger, parent: gripper_link, position_mm: [0.0, 0.0, 12.0], rpy_deg: [0.0, 90.0, 0.0]'
    (tmp_path / 'mine.yaml').write_text(f'frame: {{{mounting}}}\n')
    tested, subscription = node(bus, clock, f'sensor:={tmp_path}/mine.yaml'), listen(topics.TF_STATIC)
    run(tested)
    (transform,) = came(subscription).transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ('gripper_link', 'left_finger')
    moved, turned = transform.transform.translation, transform.transform.rotation
    assert (moved.x, moved.y, moved.z) == pytest.approx((0.0, 0.0, 0.012))
    assert (turned.x, turned.y, turned.z, turned.w) == pytest.approx((0.0, 0.5**0.5, 0.0, 0.5**0.5))


def test_a_parameter_overrides_what_is_described(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, tmp_path: Path
) -> None:
    (tmp_path / 'mine.yaml').write_text('frame: {id: left_finger, parent: gripper_link}\n')
    tested = node(bus, clock, f'sensor:={tmp_path}/mine.yaml', 'parent_frame_id:=tactile_sensor', 'frame_id:=skin')
    subscription = listen(topics.TF_STATIC)
    run(tested)
    (transform,) = came(subscription).transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ('tactile_sensor', 'skin')
