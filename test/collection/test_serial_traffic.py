"""Every byte between the computer and the machine's controller comes into the bag, as it passed."""

from __future__ import annotations

from pathlib import Path

import pytest

from tactile_nodes import messages
from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.clock import SystemClock
from tactile_nodes.collection.run import voice as voice_module
from tactile_nodes.collection.run.run_messages import traffic_message
from tactile_nodes.collection.run.voice import TOPICS, Names, Voice
from tactile_nodes.collection.settings import CollectionSettings
from tactile_nodes.collection.station import Station
from tactile_nodes.drivers.cnc.contract import CncSettings, CncState, CncStatus
from tactile_nodes.drivers.force_torque.contract import ForceTorqueSettings
from tactile_nodes.emulators.cnc.grbl import Grbl
from tactile_nodes.emulators.serial_ports import PtyPort
from tactile_nodes.emulators.world import World, WorldSettings

START_NS = 1_795_000_000_000_000_000
PORT = '/dev/ttyRIG'
STATUS = CncStatus(CncState.IDLE, (0.0, 0.0, 0.0), True, START_NS, 0)


def listening(bus: InProcessBus) -> object:
    return bus.subscribe('/serial_traffic', topics.SERIAL_TRAFFIC.type_name, Qos('queue', 1000))


def test_a_message_holds_the_bytes_with_their_way_stamp_and_port() -> None:
    data = messages.encode(traffic_message(True, START_NS + 7, b'\x85\x00\xff?', PORT, 'rig'))
    message = messages.decode(data, 'tactile_nodes/msg/SerialTraffic')
    assert messages.stamp_ns(message.header.stamp) == START_NS + 7
    assert (message.port, message.sent, message.header.frame_id) == (PORT, True, 'rig')
    assert message.data.tobytes() == b'\x85\x00\xff?'


def voice_on_a_bus(warned: list[str]) -> tuple[Voice, InProcessBus]:
    bus = InProcessBus(SystemClock())
    publishers = {topic: bus.advertise('/' + topic.name, topic.type_name, topic.qos) for topic in TOPICS}
    return Voice(publishers, Names('', 'rig', '', '', '', '', '', PORT), bus.clock, (0.0, 0.0), warned.append), bus


def test_what_passed_before_anybody_listened_is_sent_to_the_first_who_does() -> None:
    """The machine is opened, and reports its settings, before a recorder can have come."""
    warned: list[str] = []
    voice, bus = voice_on_a_bus(warned)
    voice.passed('>', START_NS, b'$$\n')
    voice.status(STATUS, None, None)
    voice.passed('<', START_NS + 1, b'$0=10\r\n')
    subscription = listening(bus)
    voice.status(STATUS, None, None)
    voice.passed('<', START_NS + 2, b'ok\r\n')
    voice.the_rest()
    published = [subscription.take().message for _ in range(3)]
    assert [(each.sent, each.data.tobytes()) for each in published] == [
        (True, b'$$\n'),
        (False, b'$0=10\r\n'),
        (False, b'ok\r\n'),
    ]
    assert [messages.stamp_ns(each.header.stamp) for each in published] == [START_NS, START_NS + 1, START_NS + 2]
    assert subscription.take() is None
    assert warned == []


def test_bytes_that_gave_way_before_anybody_listened_are_counted_and_reported_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of pieces of 1 to 5 bytes the newest two wait: 1 + 2 + 3 bytes are gone."""
    monkeypatch.setattr(voice_module, 'MOST_TRAFFIC', 2)
    warned: list[str] = []
    voice, bus = voice_on_a_bus(warned)
    for size in range(1, 6):
        voice.passed('<', START_NS + size, b'.' * size)
    voice.status(STATUS, None, None)
    assert warned == []  # nobody knows yet how many it will be
    subscription = listening(bus)
    voice.status(STATUS, None, None)
    voice.status(STATUS, None, None)
    voice.the_rest()
    assert [len(subscription.take().message.data) for _ in range(2)] == [4, 5]
    assert len(warned) == 1
    assert warned[0].startswith('6 bytes to or from the machine were not recorded')


def test_bytes_that_nobody_ever_listened_to_are_reported_at_the_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(voice_module, 'MOST_TRAFFIC', 2)
    warned: list[str] = []
    voice, _ = voice_on_a_bus(warned)
    for _ in range(3):
        voice.passed('>', START_NS, b'?\n')
    voice.the_rest()
    assert len(warned) == 1
    assert warned[0].startswith('2 bytes')


def test_a_station_hands_on_every_byte_of_its_machine(tmp_path: Path) -> None:
    clock, passed = SystemClock(), []
    device = Grbl(World(WorldSettings()), clock)
    with PtyPort(device, clock, tmp_path / 'ttyRIG', reset_on_open=True) as port:
        station = Station(
            CollectionSettings(),
            CncSettings(str(port.path)),
            ForceTorqueSettings(),
            WorldSettings(),
            clock,
            lambda _: None,
            lambda _: None,
            lambda _: None,
            lambda *piece: passed.append(piece),
        )
        station.close()
    sent = b''.join(data for way, _, data in passed if way == '>')
    received = b''.join(data for way, _, data in passed if way == '<')
    assert sent.startswith(b'$I\n?$$\n')
    assert b"Grbl 1.1h ['$' for help]" in received
    assert b'$132=60.000' in received
    stamps = [stamp_ns for _, stamp_ns, _ in passed]
    assert stamps == sorted(stamps)
