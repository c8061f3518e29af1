"""A sync input whose port vanishes: found again, within the time that its reader has, and never without a word."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Iterator, Sequence

import pytest

from benchmarks.devices.sync_line import EmulatedControlLine
from tactile_nodes.clock import SystemClock
from tactile_nodes.drivers.health import Level
from tactile_nodes.drivers.sync_input.control_line import Edge, SyncInputSettings, WatchedLine
from tactile_nodes.emulators import world
from tactile_nodes.errors import DeviceError, DeviceTimeoutError

MS = 1_000_000


Plugged = tuple[WatchedLine, Callable[[bool], None], threading.Event]


class Always:
    """A line that changes every 40 ms."""

    def line_level(self, time_ns: int) -> bool:
        return time_ns // (40 * MS) % 2 == 1

    def line_edges(self) -> Sequence[world.Edge]:
        return ()


@pytest.fixture
def plugged() -> Iterator[Plugged]:
    """An emulated adapter in a process's time, a hand that pulls it out and plugs it in, and a leave to connect."""
    clock, wires, may_connect = SystemClock(), [], threading.Event()
    may_connect.set()
    pulled = False

    def connect() -> EmulatedControlLine:
        assert may_connect.wait(60)
        wire = EmulatedControlLine(Always(), clock)
        wire.unplugged = pulled
        wires.append(wire)
        return wire

    def pull(out: bool) -> None:
        nonlocal pulled
        pulled = out
        for wire in wires:
            wire.unplugged = out

    line = WatchedLine('CTS of the emulated port', connect, SyncInputSettings(), clock)
    line.open()
    yield line, pull, may_connect
    line.close()


def test_an_adapter_that_is_pulled_out_and_plugged_in_sees_edges_again(
    plugged: Plugged,
) -> None:
    line, pull, may_connect = plugged
    edges = list(line.read(30.0))
    may_connect.clear()
    pull(True)
    edges += read_until_lost(line, r'is lost \(.*check its cable.*\); reconnecting')
    may_connect.set()
    edges += read_until_lost(line, 'use an adapter with control lines')  # the first attempt finds nothing, too
    assert line.health.level == Level.ERROR
    assert re.match(r'lost for \d+\.\d s, reconnecting: ', line.health.message)
    pull(False)
    edges += line.read(30.0)
    assert line.health.level == Level.OK
    assert line.health.message.endswith('; reconnected so far: 1')
    assert line.description['times lost'] == '1'
    assert [edge.number for edge in edges] == list(range(1, len(edges) + 1))


def read_until_lost(line: WatchedLine, why: str) -> list[Edge]:
    """The edges until it says so."""
    edges, said = [], ''
    while not re.search(why, said):
        try:
            edges += line.read(0.05)
        except DeviceTimeoutError as error:
            said = str(error)
    return edges


def test_closing_while_it_is_away_is_the_end(plugged: Plugged) -> None:
    line, pull, _ = plugged
    pull(True)
    with pytest.raises(DeviceTimeoutError):
        for _ in range(100):
            line.read(0.2)
    line.close()
    line.close()
    assert line.health.level == Level.STALE
    with pytest.raises(DeviceError, match='open it before reading'):
        line.read(1.0)
