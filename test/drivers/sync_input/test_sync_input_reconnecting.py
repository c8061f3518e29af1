"""A sync input whose port vanishes: found again, within the time that its reader has, and never without a word."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Iterator, Sequence

import pytest

from benchmarks.devices.sync_line import EmulatedControlLine
from tactile_nodes.clock import SystemClock
from tactile_nodes.drivers.health import Level
from tactile_nodes.drivers.sync_input.control_line import SyncInputSettings, WatchedLine
from tactile_nodes.emulators import world
from tactile_nodes.errors import DeviceError, DeviceTimeoutError

MS = 1_000_000


class Always:
    """A line that changes every 40 ms."""

    def line_level(self, time_ns: int) -> bool:
        return time_ns // (40 * MS) % 2 == 1

    def line_edges(self) -> Sequence[world.Edge]:
        return ()


@pytest.fixture
def plugged() -> Iterator[tuple[WatchedLine, Callable[[bool], None], threading.Event]]:
    """An emulated adapter in a process's time, a hand that pulls it out and plugs it in, and whether to connect."""
    clock, wires, connecting = SystemClock(), [], threading.Event()
    connecting.set()
    pulled = False

    def connect() -> EmulatedControlLine:
        connecting.wait()
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
    yield line, pull, connecting
    connecting.set()
    line.close()


def test_an_adapter_that_is_pulled_out_and_plugged_in_sees_edges_again(
    plugged: tuple[WatchedLine, Callable[[bool], None], threading.Event],
) -> None:
    line, pull, connecting = plugged
    edges = list(line.read(1.0))
    connecting.clear()
    pull(True)
    with pytest.raises(DeviceTimeoutError, match=r'is lost \(.*check its cable.*\); reconnecting'):
        for _ in range(100):
            edges += line.read(0.2)
    connecting.set()
    reason = ''
    while 'use an adapter with control lines' not in reason:  # the first attempt fails, too
        with pytest.raises(DeviceTimeoutError) as timeout:
            line.read(0.3)
        reason = str(timeout.value)
    assert line.health.level == Level.ERROR
    assert re.match(r'lost for \d+\.\d s, reconnecting', line.health.message)
    pull(False)
    edges += line.read(2.0)
    assert line.health.level == Level.OK
    assert line.health.message.endswith('; reconnected so far: 1')
    assert line.description['times lost'] == '1'
    assert [edge.number for edge in edges] == list(range(1, len(edges) + 1))


def test_closing_while_it_is_away_is_the_end(
    plugged: tuple[WatchedLine, Callable[[bool], None], threading.Event],
) -> None:
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
