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


@pytest.mark.parametrize(
    ('set_to', 'is_first'),
    [
        pytest.param({}, False, id='it starts after the bridge'),
        pytest.param({}, True, id='it was there before the bridge'),
        # By itself Cyclone asks for 30 s; here for the time of a packet: only the other's announcement is left.
        pytest.param({'_ASK_FOR': '1ms'}, False, id='nobody asks any more who is there'),
        # As Cyclone 11 is by itself: what comes by the loopback interface is dropped.
        pytest.param({'_interfaces': str, '_ASK_EVERY': '1s'}, False, id='its announcement is not heard'),
    ],
)
def test_a_ros_2_program_sees_the_topics_of_the_bridge(
    older: StartOther, bridge: Start, bus: InProcessBus, monkeypatch: pytest.MonkeyPatch,
    set_to: dict[str, Any], is_first: bool,
) -> None:  # fmt: skip
    for name, value in set_to.items():
        monkeypatch.setattr(settings, name, value)
    offered(bus)
    earlier = older() if is_first else None
    bridge()
    assert (earlier or older()).ask('finds', topic=TOPIC)['type'] == TYPE


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
