"""The bridge's Cyclone DDS is 11, ROS 2 Jazzy's is 0.10: two of one version would find each other anyway."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from dds_sides import Other

from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.dds import settings
from tactile_nodes.messages import types
from tactile_nodes.nodes.dds_bridge import DdsBridgeNode

Start = Callable[..., DdsBridgeNode]
StartOther = Callable[[], Other]
TOPIC = 'rt/skin/wrench'
TYPE = 'geometry_msgs::msg::dds_::WrenchStamped_'


def offered(bus: InProcessBus) -> Any:
    bus.add_node('/skin/force_estimator')
    return bus.advertise('/skin/wrench', topics.WRENCH.type_name, topics.WRENCH.qos, '/skin/force_estimator')


def test_a_ros_2_program_that_starts_after_the_bridge_sees_its_topics(
    older: StartOther, bridge: Start, bus: InProcessBus
) -> None:
    offered(bus)
    bridge()
    assert older().ask('finds', topic=TOPIC)['type'] == TYPE


def test_a_ros_2_program_that_was_there_before_the_bridge_sees_its_topics(
    older: StartOther, bridge: Start, bus: InProcessBus
) -> None:
    offered(bus)
    earlier = older()
    bridge()
    assert earlier.ask('finds', topic=TOPIC)['type'] == TYPE


def test_it_is_heard_also_when_cyclone_has_given_up_asking_who_is_there(
    older: StartOther, bridge: Start, bus: InProcessBus, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After 30 s by itself; here after the time of a packet, so that only the other's announcement is left."""
    monkeypatch.setattr(settings, '_ASK_FOR', '1ms')
    offered(bus)
    bridge()
    assert older().ask('finds', topic=TOPIC)['type'] == TYPE


def test_it_is_asked_also_where_its_announcement_is_not_heard(
    older: StartOther, bridge: Start, bus: InProcessBus, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cyclone 11 by itself: what comes by the loopback interface is dropped."""
    monkeypatch.setattr(settings, '_interfaces', lambda: '')
    monkeypatch.setattr(settings, '_ASK_EVERY', '1s')
    offered(bus)
    bridge()
    assert older().ask('finds', topic=TOPIC)['type'] == TYPE


def test_a_late_reader_of_the_older_cyclone_gets_a_wrench(older: StartOther, bridge: Start, bus: InProcessBus) -> None:
    publisher = offered(bus)
    bridge()
    late = older()
    late.ask('finds', topic=TOPIC)
    late.ask('listen', topic=TOPIC)
    wrench = types.Wrench(force=types.Vector3(x=0.5, z=-2.25))
    message = types.WrenchStamped(
        header=types.Header(stamp=types.Time(sec=5, nanosec=6), frame_id='gel_surface'), wrench=wrench
    )
    got: dict[str, Any] = {}
    while not got:  # what is sent before the reader knows of its writer is lost to it
        if publisher.listeners:
            publisher.publish(message)
        got = late.ask('take', topic=TOPIC, wait_s=0.2)
    assert got == {'frame_id': 'gel_surface', 'sec': 5, 'nanosec': 6, 'values': [0.5, 0.0, -2.25, 0.0, 0.0, 0.0]}


def test_a_program_of_the_bridges_own_version_that_starts_after_it_sees_its_nodes(
    later: StartOther, bridge: Start, bus: InProcessBus
) -> None:
    offered(bus)
    bridge()
    nodes = later().ask('nodes', wanted=['/skin/force_estimator'])['nodes']
    assert nodes['/skin/force_estimator']['topics'].keys() == {TOPIC}
