"""Check 6: bags go both ways.

Expected: `ros2 bag info` of a bag of ours names topics, types and counts; `ros2 bag play` brings all of its messages
to an rclpy subscriber, byte for byte; what `ros2 bag record` writes of our topics, our reader reads.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from filled_messages import filled
from ros2_here import needs_ros, run

from tactile_nodes import messages
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bag.writer import BagTopic, BagWriter
from tactile_nodes.bus import topics
from tactile_nodes.bus.protocol import Qos

pytestmark = [needs_ros, pytest.mark.timeout(900)]

COUNT = 20
TAKEN_WITHIN_S = 3.0  # asked to end, ros2 bag record takes nothing more, and it tells nobody what it has
SECOND_NS = 1_700_000_000 * 10**9
SENT = [topics.WRENCH, topics.FORCE_DISTRIBUTION, topics.IMAGE]
QUEUE = Qos('queue', 1000)


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Three topics, 20 messages each, 50 ms apart."""
    writer = BagWriter(tmp_path / 'ours')
    for topic in SENT:
        writer.add_topic(BagTopic.of_type(f'/{topic.name}', topic.type_name))
    for number in range(COUNT):
        at_ns = SECOND_NS + number * 50_000_000
        for topic in SENT:
            writer.write(f'/{topic.name}', messages.encode(filled(topic.type_name, number)), at_ns, at_ns, number + 1)
    writer.close()
    return tmp_path / 'ours'


def test_ros_2_says_what_our_bag_holds(bag: Path, installed: dict[str, str]) -> None:
    said = run(['ros2', 'bag', 'info', str(bag)], installed)
    for topic in SENT:
        assert f'Topic: /{topic.name} | Type: {topic.type_name} | Count: {COUNT}' in said
    assert ['ROS', 'Distro:', installed['ROS_DISTRO']] in [line.split() for line in said.splitlines()]


def test_ros_2_plays_our_bag_to_its_subscribers(bag: Path, installed: dict[str, str], join: Callable[[], Any]) -> None:
    bus = join()
    ends = {topic: bus.subscribe(f'/{topic.name}', topic.type_name, QUEUE) for topic in SENT}
    run(['ros2', 'bag', 'play', '--delay', '3', str(bag)], installed, timeout_s=120.0)
    for topic, end in ends.items():
        received = [end.get(5.0) for _ in range(COUNT)]
        wanted = [messages.encode(filled(topic.type_name, number)) for number in range(COUNT)]
        assert [entry.data[: len(data)] for entry, data in zip(received, wanted, strict=True) if entry] == wanted


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_we_read_what_ros_2_recorded(
    storage: str, tmp_path: Path, join: Callable[[], Any], running: Callable[..., Any], until: Callable[..., Any]
) -> None:
    bus = join()
    publishers = {topic: bus.advertise(f'/{topic.name}', topic.type_name, QUEUE) for topic in SENT}
    names = [f'/{topic.name}' for topic in SENT]
    deep = tmp_path / 'deep.yaml'  # the recorder asks for 10 at once otherwise, and all come in one burst
    profile = {'history': 'keep_last', 'depth': 1000, 'reliability': 'reliable', 'durability': 'volatile'}
    deep.write_text(yaml.safe_dump(dict.fromkeys(names, profile)))
    record = ['ros2', 'bag', 'record', '-s', storage, '--qos-profile-overrides-path', str(deep)]
    program = running(*record, '-o', str(tmp_path / 'theirs'), '--topics', *names)
    until(lambda: all(publisher.listeners for publisher in publishers.values()))
    for number in range(COUNT):
        for topic, publisher in publishers.items():
            publisher.publish(filled(topic.type_name, number))
    threading.Event().wait(TAKEN_WITHIN_S)
    program.send_signal(signal.SIGINT)
    assert program.wait(20.0) == 0
    with BagReader(tmp_path / 'theirs') as reader:
        found = [entry.topic for entry in reader.messages()]
    assert {name: found.count(name) for name in names} == dict.fromkeys(names, COUNT)
