"""What the ROS 2 bus refuses, in a sentence.

Against the real rclpy where there is one, else against the emulator beside this file.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import pytest

from tactile_nodes.bus.protocol import Qos
from tactile_nodes.errors import BusError, MessageError, ServiceError
from tactile_nodes.messages import services, types

NUMBER = 'std_msgs/msg/Int64'
QUEUE = Qos('queue', 1000)

Join = Callable[[], Any]


@pytest.mark.parametrize(
    ('creator', 'use', 'said'),
    [
        ('create_publisher', lambda bus: bus.advertise('/n', NUMBER, QUEUE), f'publish /n as {NUMBER}'),
        ('create_subscription', lambda bus: bus.subscribe('/n', NUMBER, QUEUE), f'subscribe to /n as {NUMBER}'),
        (
            'create_service',
            lambda bus: bus.serve('/s', services.TRIGGER, lambda request, reply: None),
            f'offer /s as {services.TRIGGER}',
        ),
        ('__init__', lambda bus: bus.add_node('/a'), 'show the node /a'),
    ],
)
def test_what_the_middleware_does_not_make_is_told_in_a_sentence(
    join: Join, monkeypatch: pytest.MonkeyPatch, creator: str, use: Callable[[Any], Any], said: str
) -> None:
    """Fast DDS raises RCLError, a RuntimeError, for a name that the process uses with another type."""

    def refuse(*words: Any, **more: Any) -> None:
        raise RuntimeError('incompatible type, at publisher.cpp:145\n>>> more, for developers')

    bus = join()
    with monkeypatch.context() as patch:
        patch.setattr(importlib.import_module('rclpy.node').Node, creator, refuse)
        with pytest.raises(BusError) as refused:
            use(bus)
    assert str(refused.value).startswith(f'ROS 2 cannot {said} (incompatible type, at publisher.cpp:145); ')
    assert '\n' not in str(refused.value)


def test_message_of_another_type_is_refused_in_a_sentence(join: Join) -> None:
    with pytest.raises(BusError, match='/n carries std_msgs/msg/Int64, not std_msgs/msg/String'):
        join().advertise('/n', NUMBER, QUEUE).publish(types.String())


def test_unknown_types_are_refused(join: Join) -> None:
    bus = join()
    with pytest.raises(MessageError, match='no message type'):
        bus.advertise('/n', 'std_msgs/msg/Nothing', QUEUE)
    with pytest.raises(BusError, match='ROS 2 has no nowhere_msgs/srv/Nothing here: install it'):
        bus.serve('/s', 'nowhere_msgs/srv/Nothing', lambda request, reply: None)


def test_closed_ends_are_refused_and_closing_twice_is_harmless(join: Join) -> None:
    bus = join()
    publisher, subscription = bus.advertise('/n', NUMBER, QUEUE), bus.subscribe('/n', NUMBER, QUEUE)
    for end in (publisher, subscription, publisher, subscription):
        end.close()
    with pytest.raises(BusError, match='the publisher of /n is closed'):
        publisher.publish(types.Int64(data=1))
    bus.close()
    bus.close()
    for use in (
        lambda: bus.advertise('/n', NUMBER, QUEUE),
        lambda: bus.subscribe('/n', NUMBER, QUEUE),
        lambda: bus.serve('/s', services.TRIGGER, lambda request, reply: None),
        lambda: bus.call('/s', services.TRIGGER, types.Trigger_Request()),
        lambda: bus.add_node('/a'),
        bus.graph,
    ):
        with pytest.raises(BusError, match='the bus is closed'):
            use()


def test_call_of_another_type_is_refused(join: Join) -> None:
    join().serve('/s', services.TRIGGER, lambda request, reply: None)
    with pytest.raises(ServiceError, match='/s is a std_srvs/srv/Trigger, not a std_srvs/srv/SetBool'):
        join().call('/s', services.SET_BOOL, types.SetBool_Request(), timeout_s=3.0)


def test_request_of_another_type_is_refused_before_it_is_sent(join: Join) -> None:
    with pytest.raises(MessageError, match='expected a std_srvs/srv/Trigger_Request, not a std_msgs/msg/Int64'):
        join().call('/s', services.TRIGGER, types.Int64(data=1))
