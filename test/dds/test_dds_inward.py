"""What comes from the graph is looked at before anybody here gets it."""

from __future__ import annotations

import queue
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from tactile_nodes import messages
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.bus.topics import DIAGNOSTICS, REFERENCE_IMAGE, TF_STATIC
from tactile_nodes.clock import NS_PER_S, SteppedClock
from tactile_nodes.dds.inward import Inward, Wish
from tactile_nodes.dds.opening import open_participant
from tactile_nodes.dds.settings import SUBNET, Discovery
from tactile_nodes.messages import types

WRENCH = 'geometry_msgs/msg/WrenchStamped'
Work = queue.SimpleQueue[Callable[[], None]]


@pytest.fixture
def participant(cyclone: None, domain: int) -> Iterator[Any]:
    made = open_participant(domain, Discovery())
    yield made
    made.close()


@pytest.fixture
def robot(participant: Any, domain: int) -> Iterator[Any]:
    made = open_participant(domain, Discovery(SUBNET))  # joins the domain as the first one has set it up
    yield made
    made.close()


@pytest.fixture
def work() -> Work:
    return queue.SimpleQueue()


def run_until(work: Work, holds: Callable[[], bool]) -> None:
    while not holds():
        work.get(timeout=20.0)()


def test_bytes_that_are_no_such_message_are_counted_and_passed_on_to_nobody(
    participant: Any, robot: Any, bus: InProcessBus, work: Work
) -> None:
    subscription = bus.subscribe('/robot/wrench', WRENCH, Qos('queue', 10))
    tested = Inward(participant, bus, '/dds_bridge', [Wish('/robot/wrench', WRENCH)], work.put)
    writer = robot.writer('/robot/wrench', WRENCH, Qos('queue', 10))
    good = messages.encode(types.WrenchStamped(header=types.Header(frame_id='wrist')))
    # No UTF-8. Bytes that do not fit the type at all are kept out by Cyclone itself.
    writer.write(good.replace(b'wrist', b'\xff\xfe\xfd\xfc\xfb'))
    writer.write(good)
    run_until(work, lambda: tested.taken == 1)
    assert tested.malformed == 1
    assert [received.message.header.frame_id for received in iter(subscription.take, None)] == ['wrist']


@pytest.mark.parametrize(('age_s', 'complains'), [(0.1, False), (-3.0, True)])
def test_clocks_that_are_apart_are_reported(
    participant: Any, robot: Any, work: Work, age_s: float, complains: bool
) -> None:
    bus = InProcessBus(SteppedClock(1_700_000_000 * NS_PER_S))  # however long the way here takes
    tested = Inward(participant, bus, '/dds_bridge', [Wish('/robot/wrench', WRENCH)], work.put)
    writer = robot.writer('/robot/wrench', WRENCH, Qos('queue', 10))
    stamp = messages.time_from_ns(bus.clock.now_ns() - round(age_s * NS_PER_S))
    writer.write(messages.encode(types.WrenchStamped(header=types.Header(stamp=stamp))))
    run_until(work, lambda: tested.taken == 1)
    assert tested.apart_s == age_s
    assert ('the clocks differ' in tested.complaint) is complains


def test_a_message_without_a_stamp_is_no_clock_that_differs(
    participant: Any, robot: Any, bus: InProcessBus, work: Work
) -> None:
    tested = Inward(participant, bus, '/dds_bridge', [Wish('/robot/wrench', WRENCH)], work.put)
    writer = robot.writer('/robot/wrench', WRENCH, Qos('queue', 10))
    writer.write(messages.encode(types.WrenchStamped()))
    run_until(work, lambda: tested.taken == 1)
    assert (tested.apart_s, tested.complaint) == (0.0, '')


def test_bytes_in_another_encoding_are_counted(participant: Any, robot: Any, bus: InProcessBus, work: Work) -> None:
    subscription = bus.subscribe('/robot/wrench', WRENCH, Qos('queue', 10))
    tested = Inward(participant, bus, '/dds_bridge', [Wish('/robot/wrench', WRENCH)], work.put)
    writer = robot.writer('/robot/wrench', WRENCH, Qos('queue', 10))
    plain = messages.encode(types.WrenchStamped())
    writer.write(b'\0\7\0\0' + plain[4:])  # PLAIN_CDR2, little endian (XTypes 1.3, table 59)
    writer.write(plain)
    run_until(work, lambda: tested.taken == 1)
    assert tested.malformed == 1
    assert [received.data for received in iter(subscription.take, None)] == [plain]


def test_a_latched_message_of_before_the_bridge_started_comes_and_waits_for_late_subscribers(
    participant: Any, robot: Any, bus: InProcessBus, work: Work
) -> None:
    latched = Qos('queue', 1, latched=True)
    writer = robot.writer('/tf_static', TF_STATIC.type_name, latched)  # a robot publishes it once, at its start
    writer.write(messages.encode(types.TFMessage(transforms=[types.TransformStamped(child_frame_id='wrist')])))
    tested = Inward(participant, bus, '/dds_bridge', [Wish('/tf_static', TF_STATIC.type_name)], work.put)
    run_until(work, lambda: tested.taken == 1)
    late = bus.subscribe('/tf_static', TF_STATIC.type_name, latched)
    assert [received.message.transforms[0].child_frame_id for received in iter(late.take, None)] == ['wrist']


def test_who_comes_late_gets_the_latched_message_of_each_publisher(
    participant: Any, robot: Any, bus: InProcessBus, work: Work
) -> None:
    """A robot has several publishers of /tf_static: one for its links, one for each camera."""
    tested = Inward(participant, bus, '/dds_bridge', [Wish('/tf_static', TF_STATIC.type_name)], work.put)
    names = ['arm', 'camera']
    writers = [robot.writer('/tf_static', TF_STATIC.type_name, TF_STATIC.qos) for _ in names]
    for name, writer in zip(names, writers, strict=True):
        writer.write(messages.encode(types.TFMessage(transforms=[types.TransformStamped(child_frame_id=name)])))
    run_until(work, lambda: tested.taken == 2)
    subscription = bus.subscribe('/tf_static', TF_STATIC.type_name, TF_STATIC.qos)
    found = [received.message.transforms[0].child_frame_id for received in iter(subscription.take, None)]
    assert sorted(found) == names
    gids = tested.publishers()
    del writers, writer
    again = robot.writer('/tf_static', TF_STATIC.type_name, TF_STATIC.qos)  # restarted
    again.write(messages.encode(types.TFMessage()))
    run_until(work, lambda: tested.taken == 3)
    assert len(tested.publishers()) == 2
    assert len(tested.publishers() & gids) == 1


def test_the_age_of_a_latched_message_is_no_clock_that_differs(
    participant: Any, robot: Any, bus: InProcessBus, work: Work
) -> None:
    stamp = messages.time_from_ns(bus.clock.now_ns() - 3600 * 10**9)
    writer = robot.writer('/left/reference_image', REFERENCE_IMAGE.type_name, REFERENCE_IMAGE.qos)
    writer.write(messages.encode(types.Image(header=types.Header(stamp=stamp))))
    wish = Wish('/left/reference_image', REFERENCE_IMAGE.type_name)
    tested = Inward(participant, bus, '/dds_bridge', [wish], work.put)
    run_until(work, lambda: tested.taken == 1)
    assert (tested.apart_s, tested.complaint) == (0.0, '')


def test_what_comes_from_the_graph_goes_neither_in_a_circle_nor_back(
    bridge: Callable[..., Any], domain: int, bus: InProcessBus
) -> None:
    subscription = bus.subscribe('/diagnostics', DIAGNOSTICS.type_name, DIAGNOSTICS.qos)
    bridge('take:=[/diagnostics]')
    robot = open_participant(domain, Discovery(SUBNET))
    writer = robot.writer('/diagnostics', DIAGNOSTICS.type_name, DIAGNOSTICS.qos)
    reader = robot.reader('/diagnostics', DIAGNOSTICS.type_name, DIAGNOSTICS.qos, lambda: None)
    for number in range(5):
        status = types.DiagnosticStatus(name=f'arm {number}')
        writer.write(messages.encode(types.DiagnosticArray(status=[status])))
        while received := subscription.get(20.0):
            name = received.message.status[0].name
            if not name.startswith('dds_bridge'):
                break
        assert name == f'arm {number}'
    assert not any(b'arm' in data for _, data in reader.take())
    robot.close()


def test_what_nodes_here_publish_does_not_come_back_from_the_graph(
    bridge: Callable[..., Any], domain: int, bus: InProcessBus
) -> None:
    subscription = bus.subscribe('/tf_static', TF_STATIC.type_name, TF_STATIC.qos)
    bridge('take:=[/tf_static]')
    here = bus.advertise('/tf_static', TF_STATIC.type_name, TF_STATIC.qos, '/force_views')
    robot = open_participant(domain, Discovery(SUBNET))
    news: Work = queue.SimpleQueue()
    reader = robot.reader('/tf_static', TF_STATIC.type_name, TF_STATIC.qos, lambda: news.put(print))
    here.publish(types.TFMessage())
    news.get(timeout=20.0)
    assert len(reader.take()) == 1
    robot.writer('/tf_static', TF_STATIC.type_name, TF_STATIC.qos).write(messages.encode(types.TFMessage()))
    assert [subscription.get(20.0).publisher == here.gid for _ in range(2)] == [True, False]
    assert subscription.get(0.1) is None
    robot.close()
