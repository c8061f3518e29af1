"""Quality of service of single topics, set by parameters under rclpy's names."""

from __future__ import annotations

from pathlib import Path

import pytest

from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.arguments import NodeArguments, parse_arguments
from tactile_nodes.bus.node.node import Node
from tactile_nodes.bus.node.parameters import from_message, to_message
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.messages import services, types

FILE = """
/**:
  ros__parameters:
    qos_overrides:
      /skin/wrench:
        publisher: {depth: 5, durability: transient_local, reliability: best_effort, history: keep_last}
      /skin/image_raw:
        subscription: {depth: 3}
      /elsewhere:
        publisher: {depth: 9}
"""


class Ends(Node):
    NAME = 'ends'

    def __init__(self, bus: InProcessBus, arguments: NodeArguments | None = None) -> None:
        super().__init__(bus, arguments)
        self.wrench = self.create_publisher(topics.WRENCH)
        self.image = self.create_subscription(topics.IMAGE, lambda _: None)


@pytest.fixture
def node(tmp_path: Path) -> Ends:
    file = tmp_path / 'p.yaml'
    file.write_text(FILE)
    return Ends(InProcessBus(), parse_arguments(['--ros-args', '-r', '__ns:=/skin', '--params-file', str(file)]))


def test_an_end_has_what_was_set_for_its_topic_by_its_full_name(node: Ends) -> None:
    qos = node.wrench.qos  # type: ignore[attr-defined]
    assert (qos.depth, qos.latched, qos.reliable) == (5, True, False)
    assert node.image.qos.depth == 3


def test_other_ends_have_what_the_table_says() -> None:
    node = Ends(InProcessBus())
    assert node.wrench.qos == topics.WRENCH.qos  # type: ignore[attr-defined]


def test_overrides_are_parameters_that_only_a_restart_changes(node: Ends) -> None:
    name = 'qos_overrides./skin/wrench.publisher.depth'
    bus = node.bus
    listed = node._parameters.list(types.ListParameters_Request()).result.names
    assert name in listed
    (value,) = node._parameters.get(types.GetParameters_Request(names=[name])).values
    assert from_message(value) == 5
    (descriptor,) = node._parameters.describe(types.DescribeParameters_Request(names=[name])).descriptors
    assert descriptor.read_only
    parameters = [types.Parameter(name=name, value=each) for each in (value, to_message(6))]
    same, other = node._parameters.set(types.SetParameters_Request(parameters=parameters)).results
    assert same.successful  # as when what `param dump` wrote is loaded
    assert other.reason == f'{name!r} can only be set when the node starts'
    assert bus.graph().services('/skin/ends/set_parameters')[0].type_name == services.SET_PARAMETERS


@pytest.mark.parametrize(
    ('rule', 'words'),
    [
        ('qos_overrides./wrench.publisher.depth:=0', 'must be an integer from 1 to 2147483647'),
        ('qos_overrides./wrench.publisher.depth:=true', 'must be an integer from 1 to 2147483647'),
        ('qos_overrides./wrench.publisher.depth:=2147483648', 'must be an integer from 1 to 2147483647'),
        ('qos_overrides./wrench.publisher.reliability:=sometimes', "must be reliable or best_effort, got 'sometimes'"),
        ('qos_overrides./wrench.publisher.history:=keep_all', "must be keep_last, got 'keep_all'"),
        ('qos_overrides./wrench.publisher.speed:=1', 'is not a policy that can be set; available: depth'),
        ('qos_overrides./wrench.sender.depth:=1', "is not of the form 'qos_overrides./topic.publisher.depth'"),
        ('qos_overrides.wrench.publisher.depth:=1', "is not of the form 'qos_overrides./topic.publisher.depth'"),
        ('qos_overrides.depth:=1', "is not of the form 'qos_overrides./topic.publisher.depth'"),
    ],
)
def test_what_cannot_be_set_is_refused_in_a_sentence(rule: str, words: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        Ends(InProcessBus(), parse_arguments(['--ros-args', '-p', rule]))
    assert words in str(caught.value)
