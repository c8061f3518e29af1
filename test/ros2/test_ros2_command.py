"""`tactile` on the ROS 2 graph: the verbs that look at a running system, a recording, and a replay."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bus import topics
from tactile_nodes.bus.node.arguments import parse_arguments
from tactile_nodes.bus.node.node import Node
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.cli.main import main
from tactile_nodes.messages import types
from tactile_nodes.nodes.player import PlayerNode
from tactile_nodes.nodes.recorder import RecorderNode

Join = Callable[[], Any]
Until = Callable[[Callable[[], Any]], Any]
Tell = Callable[..., tuple[int, str]]


class Sensor(Node):
    NAME = 'sensor'

    def __init__(self, bus: Any, arguments: Any = None, clock: Any = None) -> None:
        super().__init__(bus, arguments, clock)
        self.model = self.create_publisher(topics.MODEL_IN_USE)
        self.model.publish(types.Provenance(model='fast'))
        self.wrench = self.create_publisher(topics.WRENCH)
        self.create_trigger('~/tare', lambda: 'tared')
        self.create_timer(0.02, lambda: self.wrench.publish(types.WrenchStamped(header=types.Header(frame_id='gel'))))


@pytest.fixture
def tell(
    join: Join, spinning: Callable[[Node], Node], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Tell:
    """Status and output of a command, while a sensor is in the graph."""
    spinning(Sensor(join()))
    monkeypatch.setenv('TACTILE_BUS', 'ros2')

    def run(*words: str) -> tuple[int, str]:
        capsys.readouterr()
        return main(words), capsys.readouterr().out

    return run


def test_nodes_and_topics_of_the_graph_are_listed(tell: Tell) -> None:
    assert '/sensor' in tell('node', 'list')[1].split()
    said = tell('topic', 'list', '-t')[1]
    assert '/wrench [geometry_msgs/msg/WrenchStamped]' in said
    assert '/parameter_events [rcl_interfaces/msg/ParameterEvent]' in said


def test_node_is_described_and_answers(tell: Tell) -> None:
    status, said = tell('node', 'info', '/sensor')
    assert status == 0
    assert '/wrench: geometry_msgs/msg/WrenchStamped' in said
    assert 'Answers: its process in' in said
    assert 'Process:' not in said  # ROS 2 does not tell


def test_messages_are_printed_also_those_that_were_sent_before(tell: Tell) -> None:
    assert 'frame_id: gel' in tell('topic', 'echo', '--once', '/wrench')[1]
    assert 'model: fast' in tell('topic', 'echo', '--once', '/model_in_use')[1]


def test_parameters_are_read_and_refused(tell: Tell) -> None:
    assert 'use_sim_time' in tell('param', 'list', '/sensor')[1]
    assert 'False' in tell('param', 'get', '/sensor', 'use_sim_time')[1]
    assert tell('param', 'set', '/sensor', 'use_sim_time', 'true')[0] == 1


def test_service_is_called(tell: Tell) -> None:
    status, said = tell('service', 'call', '/sensor/tare', 'std_srvs/srv/Trigger')
    assert status == 0
    assert 'tared' in said


def test_recorder_records_what_is_in_the_graph_and_the_player_brings_it_back(
    tell: Tell, join: Join, spinning: Callable[[Node], Node], until: Until, tmp_path: Path
) -> None:
    arguments = parse_arguments(['--ros-args', '-p', f'bag:={tmp_path / "bag"}', '-p', 'regex:=wrench|model_in_use'])
    recorder = RecorderNode(join(), arguments)
    spinning(recorder)
    until(lambda: recorder.writer is not None and recorder.writer.totals.messages > 5)
    status, said = tell('service', 'call', '/recorder/stop', 'std_srvs/srv/Trigger')
    assert status == 0, said
    with BagReader(tmp_path / 'bag') as reader:
        found = [entry.topic for entry in reader.messages()]
    assert found.count('/model_in_use') == 1  # it was sent before
    assert found.count('/wrench') >= 5
    listener = join().subscribe('/again/wrench', topics.WRENCH.type_name, Qos('queue', 1000))
    file = tmp_path / 'player.yaml'
    file.write_text(f'player: {{ros__parameters: {{bag: {tmp_path / "bag"}, remap: ["/wrench:=/again/wrench"]}}}}')
    spinning(PlayerNode(join(), parse_arguments(['--ros-args', '--params-file', str(file)])))
    received = listener.get(120.0)  # on an overloaded machine a player waits for its listeners for longer
    assert received is not None
    assert received.message.header.frame_id == 'gel'
