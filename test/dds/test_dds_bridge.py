"""What a ROS 2 process sees of this bus over DDS, and what of it comes here."""

from __future__ import annotations

import select
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dds_sides import Other

from tactile_nodes import messages
from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.arguments import parse_arguments
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.errors import NOT_AGAIN, BusError, ConfigurationError
from tactile_nodes.messages import types
from tactile_nodes.nodes.dds_bridge import DdsBridgeNode

Start = Callable[..., DdsBridgeNode]
# What ROS 2 Jazzy's generator wrote into share/geometry_msgs/msg/WrenchStamped.json.
WRENCH_HASH = 'RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77'


def wrench(z: float) -> types.WrenchStamped:
    return types.WrenchStamped(
        header=types.Header(stamp=types.Time(sec=5, nanosec=6), frame_id='gel_surface'),
        wrench=types.Wrench(force=types.Vector3(z=z)),
    )


def offer(bus: InProcessBus, topic: topics.Topic, node: str = '/skin/force_estimator') -> Any:
    bus.add_node(node)
    return bus.advertise('/skin/' + topic.name, topic.type_name, topic.qos, node)


def when_wanted(publisher: Any) -> None:
    """Wait until somebody receives what is published: the bridge does so once it has a reader."""
    while not publisher.listeners:
        select.select([], [], [], 0.02)


def test_the_graph_shows_each_node_by_its_own_name_with_its_topics_types_and_hashes(
    other: Other, bridge: Start, bus: InProcessBus
) -> None:
    offer(bus, topics.WRENCH)
    bridge()
    nodes = other.ask('nodes', wanted=['/skin/force_estimator', '/dds_bridge'])['nodes']
    assert nodes['/skin/force_estimator'] == {
        'topics': {'rt/skin/wrench': ['geometry_msgs::msg::dds_::WrenchStamped_', f'typehash={WRENCH_HASH};']},
        'readers': 0,
    }
    assert {'rt/rosout', 'rt/diagnostics'} == nodes['/dds_bridge']['topics'].keys()


def test_a_node_that_has_ended_is_in_the_graph_no_more(other: Other, bridge: Start, bus: InProcessBus) -> None:
    publisher = offer(bus, topics.WRENCH)
    bridge()
    other.ask('nodes', wanted=['/skin/force_estimator'])
    publisher.close()
    bus.remove_node('/skin/force_estimator')
    bus.add_node('/skin/newcomer')
    nodes = other.ask('nodes', wanted=['/skin/newcomer'])['nodes']
    assert '/skin/force_estimator' not in nodes


def test_a_reader_gets_the_bytes_that_travelled_here(other: Other, bridge: Start, bus: InProcessBus) -> None:
    publisher = offer(bus, topics.WRENCH)
    bridge()
    other.ask('listen', topic='rt/skin/wrench', kind='WrenchStamped')
    when_wanted(publisher)
    publisher.publish(wrench(-0.25))
    got = other.ask('take', topic='rt/skin/wrench')
    assert bytes.fromhex(got['data']) == messages.encode(wrench(-0.25))
    assert "frame_id='gel_surface'" in got['text']
    assert 'force=Vector3(x=0.0, y=0.0, z=-0.25)' in got['text']


def test_an_image_whose_bytes_do_not_fill_the_last_four_arrives_whole(
    other: Other, bridge: Start, bus: InProcessBus
) -> None:
    publisher = offer(bus, topics.IMAGE, '/skin/camera')
    bridge()
    other.ask('listen', topic='rt/skin/image_raw', kind='Image', reliable=False)
    when_wanted(publisher)
    assert other.ask('found', topic='rt/skin/image_raw')['writers'] == 1
    pixels = np.arange(441 * 439, dtype=np.uint32).astype(np.uint8)
    image = types.Image(height=441, width=439, encoding='mono8', step=439, data=pixels)
    publisher.publish(image)
    got = bytes.fromhex(other.ask('take', topic='rt/skin/image_raw')['data'])
    sent = messages.encode(image)
    assert len(sent) % 4 == 3
    assert len(got) - len(sent) in {0, 1}
    assert got[4 : len(sent)] == sent[4:]  # the header says how many bytes only fill the last four


def test_who_comes_late_still_gets_what_is_latched(other: Other, bridge: Start, bus: InProcessBus) -> None:
    publisher = offer(bus, topics.REFERENCE_IMAGE, '/skin/flow_features')
    publisher.publish(types.Image(height=2, width=2, encoding='mono8', step=2, data=np.array([1, 2, 3, 4], np.uint8)))
    bridge()
    other.ask('listen', topic='rt/skin/reference_image', kind='Image', latched=True)
    assert 'data=[1, 2, 3, 4]' in other.ask('take', topic='rt/skin/reference_image')['text']


def test_what_nodes_have_said_is_given_to_those_who_come_late_as_ros_2_does(other: Other, bridge: Start) -> None:
    node = bridge()
    node.log.info('it is done')
    other.ask('listen', topic='rt/rosout', kind='Log', latched=True)
    logs = [other.ask('take', topic='rt/rosout')['text'] for _ in range(2)]
    assert "msg='it is done'" in logs[1]


def test_what_nobody_reads_there_is_not_received_here(other: Other, bridge: Start, bus: InProcessBus) -> None:
    image, force = offer(bus, topics.IMAGE, '/skin/camera'), offer(bus, topics.WRENCH)
    bridge()
    other.ask('listen', topic='rt/skin/wrench', kind='WrenchStamped')
    when_wanted(force)
    assert image.listeners == 0


def test_what_is_not_to_be_sent_is_not_shown(other: Other, bridge: Start, bus: InProcessBus) -> None:
    offer(bus, topics.WRENCH)
    offer(bus, topics.IMAGE)
    bridge('send:=[/*, /skin/wrench]')
    nodes = other.ask('nodes', wanted=['/skin/force_estimator', '/dds_bridge'])['nodes']
    assert nodes['/skin/force_estimator']['topics'].keys() == {'rt/skin/wrench'}
    assert nodes['/dds_bridge']['topics'].keys() == {'rt/rosout', 'rt/diagnostics'}


def test_a_robots_wrench_is_published_here_and_not_sent_back(other: Other, bridge: Start, bus: InProcessBus) -> None:
    subscription = bus.subscribe('/robot/wrench', 'geometry_msgs/msg/WrenchStamped', Qos('queue', 10))
    bridge('take:=[/robot/wrench@geometry_msgs/msg/WrenchStamped]')
    received = None
    while received is None:  # what is not reliable gets lost until the bridge's reader knows of the writer as well
        assert other.ask('write', topic='rt/robot/wrench', x=0.0, z=-1.5)['readers'] == 1
        received = subscription.get(0.2)
    assert received.message.wrench.force.z == -1.5
    assert received.message.header.frame_id == 'robot_wrist'
    nodes = other.ask('nodes', wanted=['/dds_bridge'])['nodes']
    assert nodes['/dds_bridge']['readers'] == 1
    assert 'rt/robot/wrench' not in nodes['/dds_bridge']['topics']


def test_a_stuck_reader_keeps_nobody_waiting_and_gets_the_newest_afterwards(
    other: Other, bridge: Start, bus: InProcessBus
) -> None:
    publisher = offer(bus, topics.IMAGE, '/skin/camera')
    node = bridge()
    other.ask('listen', topic='rt/skin/image_raw', kind='Image')
    when_wanted(publisher)
    other.signal(signal.SIGSTOP)
    done = bus.subscribe('/done', topics.WRENCH.type_name, Qos('queue', 1))
    end = bus.advertise('/done', topics.WRENCH.type_name, topics.WRENCH.qos)
    for number in range(60):
        pixels = np.full(193600, number, np.uint8)
        publisher.publish(types.Image(height=440, width=440, encoding='mono8', step=440, data=pixels))
    node.post(lambda: end.publish(wrench(0.0)))  # after all that the images had it do
    assert done.get(20.0) is not None
    other.signal(signal.SIGCONT)
    got = b''
    while got[-1:] != b'\x3b':  # 59
        got = bytes.fromhex(other.ask('take', topic='rt/skin/image_raw')['data'])


def test_a_bridge_that_is_reported_to_end_leaves_the_graph(other: Other, tmp_path: Path) -> None:
    words = [sys.executable, '-m', 'tactile_nodes.nodes.composed', 'dds_bridge']
    program = subprocess.Popen(words, stderr=subprocess.PIPE, text=True)
    try:
        other.ask('nodes', wanted=['/dds_bridge'])
        program.send_signal(signal.SIGINT)
        assert program.wait(20.0) == 0
        assert other.ask('gone')['seconds'] is not None
    finally:
        program.kill()
        program.communicate()


def test_a_second_bridge_on_a_bus_is_refused(bridge: Start, bus: InProcessBus) -> None:
    bus.add_node('/left/dds_bridge')
    with pytest.raises(ConfigurationError, match='/left/dds_bridge already shows this bus over DDS'):
        bridge()


def test_a_bridge_under_another_name_is_refused_in_a_sentence(cyclone: None, domain: int, bus: InProcessBus) -> None:
    with pytest.raises(ConfigurationError, match=r'must be called dds_bridge.* leave out the remap __node:=mine'):
        DdsBridgeNode(bus, parse_arguments(['--ros-args', '-r', '__node:=mine']))


def test_a_domain_is_joined_once_by_a_process(bridge: Start, domain: int) -> None:
    from tactile_nodes.dds.participant import Participant
    from tactile_nodes.dds.settings import Discovery

    bridge()
    with pytest.raises(BusError, match=f'cannot join DDS domain {domain}'):
        Participant(domain, Discovery())


def test_a_topic_without_its_type_is_refused_with_an_example(bridge: Start) -> None:
    with pytest.raises(ConfigurationError, match='/robot/wrench@geometry_msgs/msg/WrenchStamped'):
        bridge('take:=[/robot/arm]')


def test_without_cyclone_the_program_says_what_to_install(tmp_path: Path, domain: int) -> None:
    code = (
        "import sys; sys.modules['cyclonedds'] = None; sys.modules['cyclonedds.core'] = None; "
        "sys.argv = ['dds_bridge_node']; from tactile_nodes.nodes.dds_bridge import main; sys.exit(main())"
    )
    ended = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=False)
    assert ended.returncode == NOT_AGAIN
    assert "install it with: pip install 'tactile_nodes[dds]'" in ended.stderr
    assert 'Traceback' not in ended.stderr
