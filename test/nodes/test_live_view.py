"""The live view's node: what it receives, when, and what it shows."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from feeding import START_NS, image, located, run
from seen import force, taken_apart

from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.diagnostics import Level
from tactile_nodes.bus.protocol import Publisher
from tactile_nodes.bus.topics import Topic
from tactile_nodes.clock import SteppedClock
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.messages import types
from tactile_nodes.nodes.live_view import LiveViewNode
from tactile_nodes.web.packet import Packet

Advertise = Callable[[Topic], Publisher]
WORDS = {topics.DIAGNOSTICS.name, topics.ROSOUT.name, f'/{topics.CALIBRATION_STATE.name}'}
FORCES = {f'/{topic.name}' for topic in (topics.FORCE_DISTRIBUTION, topics.TRUE_FORCE)}
SAMPLE = struct.Struct('<dff')  # as packet.py describes it
PICTURES = {f'/{topic.name}' for topic in (topics.IMAGE, topics.FLOW_FEATURES, topics.FORCE_FIELD)}


@pytest.fixture
def node(bus: InProcessBus, clock: SteppedClock) -> Iterator[LiveViewNode]:
    made = LiveViewNode(bus, located(port=0), clock)
    yield made
    made.close()


@pytest.fixture
def shown(node: LiveViewNode, monkeypatch: pytest.MonkeyPatch) -> list[Packet]:
    """What the node shows; its server has one viewer who takes all."""
    made: list[Packet] = []
    monkeypatch.setattr(type(node.server), 'watching_of', lambda *_: 1)
    monkeypatch.setattr(type(node.server), 'has_room_for', lambda *_: True)
    monkeypatch.setattr(node.server, 'show', lambda packet, sensor: made.append(packet))
    return made


def pass_time(node: LiveViewNode, clock: SteppedClock, seconds: float) -> None:
    clock.advance(seconds)
    node.spin_once()
    run(node)


def subscribed(bus: InProcessBus) -> set[str]:
    return {end.name for end in bus.graph().subscriptions()}


def test_while_nobody_watches_no_picture_and_no_force_field_is_received(
    bus: InProcessBus, clock: SteppedClock, node: LiveViewNode
) -> None:
    pass_time(node, clock, 1.0)
    assert subscribed(bus) == WORDS | FORCES


def test_who_comes_later_is_reported_the_force_of_the_time_before(
    clock: SteppedClock, node: LiveViewNode, publisher: Advertise, monkeypatch: pytest.MonkeyPatch
) -> None:
    remembered: list[bytes] = []
    monkeypatch.setattr(node.server, 'remember', lambda samples, sensor: remembered.append(samples))
    for number in range(3):
        publisher(topics.FORCE_DISTRIBUTION).publish(force(1000.0 + 16 * number, (0.25 * number, 0.0, 0.0, 0.0)))
        pass_time(node, clock, 1 / 60)
    assert not remembered
    pass_time(node, clock, 0.25)
    assert [total for each in remembered for _, total, _ in SAMPLE.iter_unpack(each)] == [0.0, 0.25, 0.5]


def test_the_sums_of_a_hand_are_taken_in_rarely_while_nobody_watches(
    bus: InProcessBus, clock: SteppedClock, publisher: Advertise, monkeypatch: pytest.MonkeyPatch
) -> None:
    """60 sums a second that nobody sees are not decoded one by one: each quarter of a second the last is."""
    told: list[int] = []
    monkeypatch.setattr(LiveViewNode, '_on_hand', lambda _, received: told.append(received.sequence))
    node = LiveViewNode(bus, located(port=0, hand='two_fingers'), clock)
    sums = publisher(topics.HAND_WRENCH)
    for _ in range(15):
        sums.publish(types.HandWrench())
        pass_time(node, clock, 1 / 60)
    pass_time(node, clock, 0.01)
    node.close()
    assert told == [15]


def test_when_somebody_watches_it_receives_and_when_they_go_no_more(
    bus: InProcessBus, clock: SteppedClock, node: LiveViewNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    for watching in (1, 0):
        monkeypatch.setattr(type(node.server), 'watching_of', lambda *_, count=watching: count)
        pass_time(node, clock, 1.0)
        assert subscribed(bus) - WORDS - FORCES == (PICTURES if watching else set())


def test_what_is_published_is_shown_at_the_next_look(
    bus: InProcessBus, clock: SteppedClock, node: LiveViewNode, shown: list[Packet], publisher: Advertise
) -> None:
    pass_time(node, clock, 1.0)
    stamp_ms = START_NS / 1e6 + 1000.0
    publisher(topics.IMAGE).publish(image(np.full((20, 20), 90, np.uint8), round(stamp_ms * 1e6)))
    publisher(topics.FORCE_DISTRIBUTION).publish(force(stamp_ms, (0.0, 0.73, 0.0, 0.0), (1.0, 1.0)))
    pass_time(node, clock, 1 / 30)
    header, sections, samples = taken_apart(shown[-1].body + shown[-1].samples)
    assert header['force']['total_n'] == pytest.approx(0.73)
    assert sections['image'].startswith(b'\xff\xd8')
    assert [total for _, total, _ in samples] == [pytest.approx(0.73)]


def test_a_viewer_without_room_costs_no_packet(
    clock: SteppedClock, node: LiveViewNode, shown: list[Packet], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(type(node.server), 'has_room_for', lambda *_: False)
    pass_time(node, clock, 1.0)
    pass_time(node, clock, 1.0)
    assert shown == []


def test_the_address_of_the_page_is_reported_on_diagnostics(clock: SteppedClock, node: LiveViewNode) -> None:
    pass_time(node, clock, 1.0)
    (status,) = node.diagnostics.message(clock.now_ns()).status
    assert status.level == Level.OK
    assert status.message == f'{node.server.url}, viewers: 0'


def test_a_port_that_is_none_is_refused(bus: InProcessBus, clock: SteppedClock) -> None:
    with pytest.raises(ConfigurationError, match='70000'):
        LiveViewNode(bus, located(port=70000), clock)


@pytest.mark.parametrize(
    ('values', 'warning'),
    [
        ({'guests': 'watch'}, 'every user of this machine can watch'),
        ({'guests': 'act', 'address': '0.0.0.0'}, 'anyone who can reach 0.0.0.0 can watch and press the buttons'),
        ({'address': '0.0.0.0'}, '0.0.0.0 is reachable from other machines, but they count as guests: set guests'),
    ],
)
def test_who_else_may_is_reported_at_the_start(
    bus: InProcessBus, clock: SteppedClock, capfd: pytest.CaptureFixture[str], values: dict[str, str], warning: str
) -> None:
    LiveViewNode(bus, located(port=0, **values), clock).close()
    assert warning in capfd.readouterr().err
