"""Topics that are received only while somebody wants them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.protocol import Qos, Received
from tactile_nodes.bus.tapping import Tap
from tactile_nodes.errors import BusError
from tactile_nodes.messages import types

WRENCH = 'geometry_msgs/msg/WrenchStamped'


class Somebody:
    """Who wants topics, with a thread that runs when the test says so."""

    def __init__(self, bus: InProcessBus) -> None:
        self.got: list[tuple[str, float]] = []
        self._work: list[Callable[[], None]] = []
        self.tap = Tap(bus, '/somebody', self._work.append, self._take)

    def _take(self, topic: str, received: Received) -> None:
        self.got.append((topic, received.message.wrench.force.z))

    def run(self) -> None:
        while self._work:
            self._work.pop(0)()


def publisher(bus: InProcessBus, topic: str, *, latched: bool = False) -> Any:
    return bus.advertise(topic, WRENCH, Qos('latest', 1, latched=latched))


def wrench(z: float) -> types.WrenchStamped:
    return types.WrenchStamped(wrench=types.Wrench(force=types.Vector3(z=z)))


def test_a_topic_that_cannot_be_received_keeps_no_other_away(monkeypatch: pytest.MonkeyPatch) -> None:
    bus = InProcessBus()
    subscribe = bus.subscribe

    def refusing(topic: str, *rest: Any) -> Any:
        if topic == '/a':  # as on ROS 2 for a type whose package is installed on the robot alone
            raise BusError('ROS 2 has no such type here')
        return subscribe(topic, *rest)

    monkeypatch.setattr(bus, 'subscribe', refusing)
    who, b = Somebody(bus), publisher(bus, '/b')
    with pytest.raises(BusError, match='no such type here'):
        who.tap.keep([('/a', WRENCH), ('/b', WRENCH)])
    b.publish(wrench(2.0))
    who.run()
    assert who.got == [('/b', 2.0)]


def test_what_is_wanted_comes_and_what_is_not_or_no_more_does_not() -> None:
    bus = InProcessBus()
    who, a, b = Somebody(bus), publisher(bus, '/a'), publisher(bus, '/b')
    who.tap.keep([('/a', WRENCH)])
    a.publish(wrench(1.0))
    b.publish(wrench(2.0))
    who.run()
    assert who.got == [('/a', 1.0)]
    assert (a.listeners, b.listeners) == (1, 0)
    who.tap.keep([])
    a.publish(wrench(3.0))
    who.run()
    assert who.got == [('/a', 1.0)]
    assert a.listeners == 0


def test_what_is_still_wanted_is_not_received_anew() -> None:
    bus = InProcessBus()
    who, a = Somebody(bus), publisher(bus, '/a', latched=True)
    a.publish(wrench(1.0))
    who.tap.keep([('/a', WRENCH)])
    who.tap.keep([('/a', WRENCH), ('/b', WRENCH)])
    who.run()
    assert who.got == [('/a', 1.0)]


def test_what_is_latched_comes_again_to_who_wants_it_again() -> None:
    bus = InProcessBus()
    who, a = Somebody(bus), publisher(bus, '/a', latched=True)
    a.publish(wrench(1.0))
    for _ in range(2):
        who.tap.keep([('/a', WRENCH)])
        who.run()
        who.tap.close()
    assert who.got == [('/a', 1.0), ('/a', 1.0)]


def test_messages_that_wait_for_too_long_are_counted() -> None:
    bus = InProcessBus()
    who, a = Somebody(bus), publisher(bus, '/wrench')
    who.tap.keep([('/wrench', WRENCH)])
    for number in range(20):
        a.publish(wrench(float(number)))
    who.run()
    assert [z for _, z in who.got] == [
        float(number) for number in range(4, 20)
    ]  # of a topic whose newest counts, 16 wait
    assert who.tap.dropped == 4
