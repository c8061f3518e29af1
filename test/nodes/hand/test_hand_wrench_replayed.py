"""The sum of a hand's forces in a replay waits for the sensors that the bag holds, wherever they were recorded."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import pytest

from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bag.writer import BagWriter
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.arguments import parse_arguments
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.bus.topics import FORCE_DISTRIBUTION, HAND_WRENCH
from tactile_nodes.errors import BagError
from tactile_nodes.messages import types
from tactile_nodes.nodes.hand.hand_wrench import HandWrenchNode

PRESS = Path(__file__).parents[3] / 'examples/press_bag'


@pytest.fixture
def recorded(tmp_path: Path) -> Callable[..., Path]:
    """A bag with the pictures of the example on some topics."""

    def make(*topics: str) -> Path:
        writer = BagWriter(tmp_path / 'bag')
        with BagReader(PRESS) as press:
            for topic in topics:
                writer.add_topic(dataclasses.replace(press.topics['/image_raw'], name=topic))
            for number, message in enumerate(press.messages(['/image_raw'])):
                for topic in topics:
                    writer.write(topic, message.data, message.log_ns, message.log_ns, number)
        writer.close()
        return tmp_path / 'bag'

    return make


def test_a_hand_in_a_namespace_is_found_in_its_bag(recorded: Callable[..., Path]) -> None:
    """Else each sensor counts as absent, no sum waits for the other, and each has the force of one."""
    bag = recorded('/robot/left/image_raw', '/robot/right/image_raw')
    words = ['--ros-args', '-r', '__ns:=/robot', '-p', 'hand:=two_fingers', '-p', f'bag:={bag}']
    node = HandWrenchNode(bus := InProcessBus(), parse_arguments(words))
    sums = bus.subscribe('/robot/hand_wrench', HAND_WRENCH.type_name, Qos('queue', 10))
    for sensor, expected in (('left', 0), ('right', 1)):
        force = bus.advertise(f'/robot/{sensor}/force_distribution', FORCE_DISTRIBUTION.type_name, Qos('queue', 10))
        force.publish(types.ForceDistribution())
        while node._work.qsize():
            node.spin_once()
        assert sums.waiting == expected
    node.close()
    bus.close()


def test_a_bag_without_the_sensors_of_the_hand_is_refused_with_what_it_holds(recorded: Callable[..., Path]) -> None:
    """Else the replay waits half a minute, and ends well with a bag that has no forces."""
    words = ['--ros-args', '-p', 'hand:=two_fingers', '-p', f'bag:={recorded("/robot/left/image_raw")}']
    with pytest.raises(
        BagError, match='holds no /left/image_raw and no /right/image_raw, but /robot/left/image_raw; choose'
    ):
        HandWrenchNode(InProcessBus(), parse_arguments(words))
