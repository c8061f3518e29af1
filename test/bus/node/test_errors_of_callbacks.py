"""Errors in callbacks: what is logged of them, and when /diagnostics says that they are over."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node import node as module
from tactile_nodes.bus.node.node import Node
from tactile_nodes.bus.protocol import Qos, Received
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.clock import NS_PER_S, SteppedClock
from tactile_nodes.errors import ImageError
from tactile_nodes.messages import types


class Rig:
    """A node that raises each text that it is given, and the time of its computer."""

    def __init__(self, bus: InProcessBus, clock: SteppedClock, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s = 1000.0
        monkeypatch.setattr(module, 'monotonic_s', lambda: self.now_s)
        self._clock = clock
        self._node = Node(bus, clock=clock)
        self._node.create_subscription(topics.ROSOUT, self._fail)
        self._given = bus.advertise('/rosout', topics.ROSOUT.type_name, topics.ROSOUT.qos)
        self._diagnostics: Subscription = bus.subscribe('/diagnostics', topics.DIAGNOSTICS.type_name, Qos('queue', 100))

    def _fail(self, received: Received) -> None:
        if received.message.name == 'test':
            raise ImageError(received.message.msg)

    def give(self, text: str) -> None:
        self._given.publish(types.Log(name='test', msg=text))
        self._turn()

    def status(self) -> tuple[int, str]:
        """Level and text of the errors in the next /diagnostics."""
        self._clock.advance(1.0)
        self._turn()
        last = None
        while (received := self._diagnostics.take()) is not None:
            last = received
        assert last is not None
        (status,) = [each for each in last.message.status if each.name == 'node: errors']
        return status.level, status.message

    def _turn(self) -> None:
        for _ in range(10):
            self._node.spin_once()

    def close(self) -> None:
        self._node.close()


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch) -> Iterator[Rig]:
    clock = SteppedClock(NS_PER_S)
    bus = InProcessBus(clock)
    made = Rig(bus, clock, monkeypatch)
    yield made
    made.close()
    bus.close()


def _logged(capsys: pytest.CaptureFixture[str]) -> list[str]:
    return [line.partition('errors: ')[2] for line in capsys.readouterr().err.splitlines() if 'errors: ' in line]


def test_a_second_error_is_logged_too_and_the_same_one_only_once_a_minute(
    rig: Rig, capsys: pytest.CaptureFixture[str]
) -> None:
    for text in ('too dark', 'too dark', 'too small', 'too dark'):
        rig.give(text)
    assert _logged(capsys) == ['too dark', 'too small']
    rig.now_s += 59.0
    rig.give('too dark')
    assert _logged(capsys) == []
    rig.now_s += 2.0
    rig.give('too dark')
    assert _logged(capsys) == ['too dark']


def test_a_text_that_differs_in_each_frame_is_logged_ten_times_a_minute(
    rig: Rig, capsys: pytest.CaptureFixture[str]
) -> None:
    for number in range(60 * 30):  # a minute at 30 Hz
        rig.give(f'frame {number}')
        rig.now_s += 1 / 30
    assert _logged(capsys) == [f'frame {number}' for number in range(10)]
    rig.now_s += 1.0
    rig.give('the last')
    assert _logged(capsys) == ['the last']


def test_errors_are_over_ten_seconds_after_the_last(rig: Rig) -> None:
    rig.give('too dark')
    rig.now_s += 5.0
    rig.give('too small')
    assert rig.status() == (2, 'too small')
    rig.now_s += 9.0
    assert rig.status() == (2, 'too small')
    rig.now_s += 1.5
    assert rig.status() == (0, '')
    rig.give('too dark')
    assert rig.status() == (2, 'too dark')
