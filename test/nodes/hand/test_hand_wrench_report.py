"""What the node of a hand's sum reports of itself."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from seen import received

from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.arguments import parse_arguments
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.messages import types
from tactile_nodes.nodes.hand.hand_wrench import HandWrenchNode


@pytest.fixture
def node(bus: InProcessBus) -> Iterator[HandWrenchNode]:
    made = HandWrenchNode(bus, parse_arguments(['--ros-args', '-p', 'hand:=two_fingers']))
    yield made
    made.close()


def reported(node: HandWrenchNode, monkeypatch: pytest.MonkeyPatch, *sums: tuple[str, ...]) -> tuple[int, str]:
    """The report after sums of these sensors."""
    found = [types.HandWrench(sensors=list(each), missing=[]) for each in sums]
    monkeypatch.setattr(node._forces, 'add', lambda *_: found)
    node._on_force('left', received(types.ForceDistribution()))
    node._report()
    (status,) = node.diagnostics.message(0).status
    return status.level, status.message


def test_a_sensor_is_reported_that_is_in_no_sum_and_not_one_that_is_late_once(
    node: HandWrenchNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a busy machine the last sum before each report lacked one or the other: a warning every few seconds."""
    both, left = ('left', 'right'), ('left',)
    assert reported(node, monkeypatch, both, left) == (0, 'of all 2 sensors')
    level, text = reported(node, monkeypatch, left, left)
    assert level == 1
    assert text.startswith('without right')
    level, text = reported(node, monkeypatch)
    assert level == 1
    assert text.startswith('without left, right')


def test_a_second_sum_in_one_namespace_is_refused(bus: InProcessBus) -> None:
    """Else a controller gets the sums of two hands in turn."""
    bus.advertise('/hand_wrench', topics.HAND_WRENCH.type_name, topics.HAND_WRENCH.qos, '/other')
    words = ['--ros-args', '-p', 'hand:=two_fingers']
    with pytest.raises(ConfigurationError, match=r'^/hand_wrench is already published by /other, '):
        HandWrenchNode(bus, parse_arguments(words))
    HandWrenchNode(bus, parse_arguments([*words, '-r', '__ns:=/robot'])).close()
