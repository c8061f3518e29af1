"""What Cyclone DDS says reaches the operator, in few lines."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from typing import Any

import psutil
import pytest

from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.dds.sayings import Sayings
from tactile_nodes.nodes.dds_bridge import DdsBridgeNode

# A header of RTPS 2.1 from a vendor 1.2, and a HEARTBEAT that has 4 of the 28 bytes that it says (RTPS 2.5, 9.4.5.7).
NO_RTPS = b'RTPS\2\1\1\2' + bytes(12) + b'\7\1\x1c\0' + bytes(4)
DUMP = 'malformed packet received from vendor 1.2 length 28 state parse:HEARTBEAT <' + 400 * 'f'


def test_lines_of_a_kind_are_reported_at_once_and_then_in_one_line_a_minute_with_their_number() -> None:
    sayings = Sayings()
    sayings.take(DUMP)
    (first,) = sayings.due(100.0)
    assert first.startswith('Cyclone DDS says: malformed packet received from vendor 1.2')
    assert len(first) < 200
    for _ in range(10_000):
        sayings.take(DUMP)
    assert sayings.due(159.9) == []
    (second,) = sayings.due(160.0)
    assert second.endswith('(and 9999 more like it)')
    assert sayings.due(1000.0) == []
    assert sayings.malformed == 10_001


def test_lines_of_another_kind_are_not_kept_back() -> None:
    sayings = Sayings()
    sayings.take(DUMP)
    sayings.due(0.0)
    sayings.take(DUMP)
    sayings.take('sendmsg failed: Network is unreachable')
    assert sayings.due(1.0) == ['Cyclone DDS says: sendmsg failed: Network is unreachable']


def test_kinds_that_a_sender_makes_up_are_reported_as_one() -> None:
    sayings = Sayings()
    for number in range(1000):
        sayings.take(f'{number} lies')
    assert len(sayings.due(0.0)) == 21


def test_packets_that_are_no_rtps_are_counted_and_reported_in_one_line(
    bridge: Callable[..., DdsBridgeNode], bus: InProcessBus, capfd: pytest.CaptureFixture[str]
) -> None:
    reports = bus.subscribe('/diagnostics', topics.DIAGNOSTICS.type_name, Qos('queue', 100))
    before = {entry.laddr.port for entry in _datagram_ends()}
    bridge()
    ports = {entry.laddr.port for entry in _datagram_ends()} - before
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as somebody:
        for port in ports:
            for _ in range(100):
                somebody.sendto(NO_RTPS, ('127.0.0.1', port))
    counted = 0
    while counted < 100:
        report = reports.get(30.0)
        assert report is not None, 'the bridge never reported them'
        values = {entry.key: entry.value for status in report.message.status for entry in status.values}
        counted = int(values.get('malformed_packets', 0))
    lines = [line for line in capfd.readouterr().err.splitlines() if 'malformed packet' in line]
    assert len(lines) == 1
    assert '[dds_bridge]: Cyclone DDS says: malformed packet received from vendor 1.2 length 28' in lines[0]


def _datagram_ends() -> list[Any]:
    return [entry for entry in psutil.Process(os.getpid()).net_connections('udp4') if entry.laddr]
