"""Presses put together from the messages of a running rig, as they come."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from press_bags import SECOND_NS, START_NS

from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bus.topics import PRESS, PRESS_IMAGE, REFERENCE_IMAGE, RIG_STATE
from tactile_nodes.conversions import header
from tactile_nodes.learning.recorded.bags import CollectionBag
from tactile_nodes.learning.recorded.rig_presses import ABSENT_NS, IDLE_NS, SETTLED_NS, RigPresses
from tactile_nodes.messages import types

TOPICS = (PRESS, PRESS_IMAGE, REFERENCE_IMAGE, RIG_STATE)


class Rig:
    """Counts how often it was asked to end."""

    def __init__(self) -> None:
        self.asked = 0

    def stop(self) -> None:
        self.asked += 1


@pytest.fixture
def rig() -> Rig:
    return Rig()


@pytest.fixture
def presses(rig: Rig) -> RigPresses:
    return RigPresses(rig.stop)


def feed(presses: RigPresses, bag: Path, most: int = 1000) -> None:
    """The messages of a bag in the order in which they were published, up to so many presses."""
    with BagReader(bag) as reader:
        takers: dict[str, Callable[..., None]] = {
            f'/{PRESS_IMAGE.name}': presses.image, f'/{REFERENCE_IMAGE.name}': presses.reference,
            f'/{RIG_STATE.name}': presses.state,
        }  # fmt: skip
        for message in reader.messages([f'/{topic.name}' for topic in TOPICS]):
            decoded = reader.decode(message)
            if message.topic in takers:
                takers[message.topic](decoded)
                continue
            presses.press(decoded, message.data, START_NS)
            most -= 1
            if not most:
                return


def between(seconds: float) -> types.RigState:
    """The rig's state between presses."""
    return types.RigState(header=header(START_NS + round(seconds * SECOND_NS), 'rig'), depth=-0.01, press=0)


def test_presses_are_those_that_a_bag_of_the_same_messages_holds(presses: RigPresses, bag: Path) -> None:
    feed(presses, bag)
    presses.end()
    with CollectionBag(bag) as recorded:
        expected = [(press.message.press, len(press.frames), len(press.untouched)) for press in recorded.presses()]
    found = [(press.message.press, len(press.frames), len(press.untouched)) for _, press in presses]
    assert found == expected
    assert len(found) == 12


def test_the_bag_that_a_recorder_makes_of_them_is_named(presses: RigPresses, bag: Path) -> None:
    feed(presses, bag)
    with CollectionBag(bag) as recorded:
        list(recorded.presses())
        assert presses.card_entries('gel-7')[0]['id'] == recorded.bag_id
    assert (presses.card_entries('gel-7')[0]['attempts'], presses.card_entries('gel-7')[0]['gel']) == (12, 'gel-7')


def test_the_last_press_waits_for_its_images_and_no_longer(presses: RigPresses, bag: Path) -> None:
    feed(presses, bag, most=1)
    presses.look(START_NS + SETTLED_NS - 1, rig_is_there=True)
    assert not presses.waiting
    presses.look(START_NS + SETTLED_NS, rig_is_there=True)
    assert presses.waiting


def test_they_end_when_the_rig_is_gone(presses: RigPresses, bag: Path) -> None:
    assert not presses.look(START_NS, rig_is_there=False)  # it has not come yet
    feed(presses, bag, most=2)
    assert not presses.look(START_NS, rig_is_there=True)
    assert presses.look(START_NS, rig_is_there=False) == 'has ended'
    assert not presses.look(START_NS, rig_is_there=False)
    assert [press.message.press for _, press in presses] == [1, 2]
    assert list(presses) == []


def test_they_end_when_no_rig_comes(presses: RigPresses) -> None:
    assert not presses.look(START_NS, rig_is_there=False)
    assert not presses.look(START_NS + ABSENT_NS - 1, rig_is_there=False)
    assert 'did not appear within 120 s' in presses.look(START_NS + ABSENT_NS, rig_is_there=False)
    assert not presses.look(START_NS + 2 * ABSENT_NS, rig_is_there=False)
    assert list(presses) == []


def test_a_rig_that_came_in_time_may_take_longer_than_that(presses: RigPresses) -> None:
    presses.look(START_NS, rig_is_there=False)
    presses.look(START_NS + ABSENT_NS - 1, rig_is_there=True)
    assert not presses.look(START_NS + 2 * ABSENT_NS, rig_is_there=True)
    presses.end()
    assert list(presses) == []


def test_a_rig_that_was_asked_to_end_has_done_so_when_it_reported_no_press_for_two_seconds(
    presses: RigPresses, rig: Rig
) -> None:
    presses.state(between(0.0))
    presses.state(between(60.0))
    assert not presses.waiting
    presses.stop()
    assert rig.asked == 1
    presses.state(between(61.0))
    presses.state(types.RigState(header=header(START_NS + 62 * SECOND_NS, 'rig'), press=7))
    presses.state(between(63.0))
    presses.state(between(63.0 + 0.99 * IDLE_NS / SECOND_NS))
    assert not presses.waiting
    presses.state(between(63.0 + IDLE_NS / SECOND_NS))
    assert list(presses) == []


def test_a_rig_that_has_ended_is_not_asked_to(presses: RigPresses, rig: Rig) -> None:
    presses.end()
    presses.stop()
    assert rig.asked == 0


def test_what_a_rig_tells_after_the_end_is_not_kept(presses: RigPresses, bag: Path) -> None:
    """A rig that goes on after `stay:=true` presses for hours: nobody would take what is kept."""
    feed(presses, bag, most=2)
    presses.end()
    assert [press.message.press for _, press in presses] == [1, 2]
    entries = presses.card_entries('gel-7')
    feed(presses, bag)
    presses.look(START_NS + SETTLED_NS, rig_is_there=True)
    assert not presses.waiting
    assert presses._aligner.left_over == 0
    assert presses.card_entries('gel-7') == entries


def test_what_a_paused_rig_tells_for_hours_is_not_collected(presses: RigPresses) -> None:
    """Three hours of ten states a second: the tip stays above the gel, is in it for a minute, and is above it again."""
    for second in range(0, 3 * 3600):
        depth = 0.001 if 3600 <= second < 3660 else -0.01
        for tenth in range(10):
            stamp = START_NS + second * SECOND_NS + tenth * SECOND_NS // 10
            presses.state(types.RigState(header=header(stamp, 'rig'), depth=depth))
    assert [each.in_gel for each in presses._aligner._spans] == [False, True, False]
    # The last state above the gel is at 3599.9 s, the first in it at 3600 s; no state is near 3 h and a minute.
    times_s = (-0.4, 1000.05, 3599.94, 3599.96, 3630.05, 3659.94, 3659.96, 10860.0)
    found = [presses._aligner._is_untouched(START_NS + round(each * SECOND_NS)) for each in times_s]
    assert found == [True, True, True, False, False, False, True, True]


@pytest.fixture
def threads_take_turns_often() -> Iterator[None]:
    usual = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(usual)


@pytest.mark.usefixtures('threads_take_turns_often')
def test_what_was_odd_is_reported_while_more_comes(presses: RigPresses) -> None:
    """The fit asks in its thread while the node's takes images; here each cannot be read for a reason of its own."""
    unreadable = [
        types.Image(header=header(START_NS + number, 'camera'), height=2, width=2, encoding=f'odd{number}', step=2,
                    data=np.zeros(4, np.uint8)) for number in range(6000)
    ]  # fmt: skip
    node = threading.Thread(target=lambda: [presses.image(each) for each in unreadable])
    node.start()
    while node.is_alive():
        presses.card_entries('gel-7')
    assert len(presses.card_entries('gel-7')[0]['problems']) == len(unreadable)
