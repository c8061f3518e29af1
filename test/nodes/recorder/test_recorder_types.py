"""A recorder among topics that it cannot record: the others are recorded, and these are named."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from feeding import given, run

from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.diagnostics import Level
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.clock import SteppedClock
from tactile_nodes.errors import BusError
from tactile_nodes.messages import types
from tactile_nodes.nodes.recorder import RecorderNode

Start = Callable[..., RecorderNode]
FLOAT, STRING = types.Float64.__msgtype__, types.String.__msgtype__


@pytest.fixture
def start(bus: InProcessBus, clock: SteppedClock, tmp_path: Path) -> Iterator[Start]:
    made: list[RecorderNode] = []

    def make(*values: str) -> RecorderNode:
        made.append(RecorderNode(bus, given(f'bag:={tmp_path}/bag', *values), clock))
        return made[-1]

    yield make
    for node in made:
        node.close()


def states(node: RecorderNode) -> list[tuple[Level, str]]:
    node._report_health()
    return [
        (Level(each.level), each.message) for each in node.diagnostics.message(0).status if each.name.endswith('bag')
    ]


def test_a_publisher_that_comes_again_with_another_type_is_reported_as_not_recorded(bus, start: Start) -> None:
    node = start('topics:=[/chatter]')
    for content in (types.String(data='a'), types.Float64(data=1.0)):
        talker = bus.advertise('/chatter', content.__msgtype__, Qos('queue', 10))
        node._look()
        talker.publish(content)
        run(node)
        talker.close()
    text = f'not recorded, as the bag has the topic with another type: /chatter as {FLOAT}'
    assert states(node) == [(Level.WARN, text)]
    summary = node.stop_recording()
    assert summary.startswith('wrote 1 messages')
    assert text in summary
    assert states(node) == [(Level.WARN, summary)]


def test_a_topic_that_this_machine_cannot_receive_keeps_no_other_from_being_recorded(
    bus, start: Start, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    subscribe = bus.subscribe

    def refusing(topic: str, type_name: str, *rest) -> object:
        if type_name == FLOAT:  # as on ROS 2 for a type whose package is installed on the robot alone
            raise BusError(f'ROS 2 has no {type_name} here')
        return subscribe(topic, type_name, *rest)

    monkeypatch.setattr(bus, 'subscribe', refusing)
    bus.advertise('/a', FLOAT, Qos('queue', 10))
    talker = bus.advertise('/b', STRING, Qos('queue', 10))
    node = start('topics:=[/a, /b]')
    talker.publish(types.String(data='hello'))
    run(node)
    assert f'/a is not recorded: ROS 2 has no {FLOAT} here' in capsys.readouterr().err
    assert node.stop_recording().startswith('wrote 1 messages')
