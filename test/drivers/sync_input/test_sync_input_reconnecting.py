"""A sync input whose port vanishes: found again, within the time that its reader has, and never without a word."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import pytest

from tactile_nodes.clock import NS_PER_S, SteppedClock, SystemClock
from tactile_nodes.drivers.health import Health, Level
from tactile_nodes.drivers.sync_input.control_line import Edge, SyncInputSettings, WatchedLine
from tactile_nodes.drivers.sync_input.reconnecting import ReconnectingSyncInput, reconnecting_sync_input
from tactile_nodes.emulators import world
from tactile_nodes.emulators.sync_line import EmulatedControlLine
from tactile_nodes.errors import DeviceError, DeviceLostError, DeviceNotFoundError, DeviceTimeoutError

MS = 1_000_000


class Scripted:
    """A watched line that gives what it is set to: edges, or an error."""

    description = {'line': 'CTS of the test'}  # noqa: RUF012

    def __init__(self, *answers: Exception | int) -> None:
        self.answers = list(answers)
        self.closed = 0
        self.health = Health(Level.OK, '')

    def read(self, timeout_s: float) -> Sequence[Edge]:
        answer = self.answers.pop(0) if self.answers else DeviceTimeoutError('still')
        if isinstance(answer, Exception):
            raise answer
        return [Edge(1000 + number, number % 2 == 1, number, 1e-3) for number in range(1, answer + 1)]

    def close(self) -> None:
        self.closed += 1


def around(clock: SteppedClock, *opened: Scripted | Exception) -> tuple[ReconnectingSyncInput, list[int]]:
    """The input, and when it tried to connect."""
    tried: list[int] = []
    left = list(opened)

    def connect() -> Scripted:
        tried.append(clock.now_ns())
        answer = left.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    line = ReconnectingSyncInput(connect, clock, 'CTS of the test')  # type: ignore[arg-type]
    return line, tried


class Ticking(SteppedClock):
    """A clock on which sleeping is all that takes time."""

    def sleep_until(self, ns: int) -> None:
        self.advance(max(0, ns - self.now_ns()) / NS_PER_S)


@pytest.fixture
def clock() -> SteppedClock:
    return Ticking(NS_PER_S)


LOST = DeviceLostError('CTS of the test is gone (Input/output error); check its cable and reopen it')
AWAY = DeviceNotFoundError('no such port')


def test_a_line_that_was_never_there_fails_at_once(clock: SteppedClock) -> None:
    line, _ = around(clock, AWAY)
    with pytest.raises(DeviceNotFoundError):
        line.open()
    assert line.health.level == Level.STALE
    with pytest.raises(DeviceError, match='open it before reading'):
        line.read(0.1)


def test_a_lost_line_is_found_again_and_numbers_go_on(clock: SteppedClock) -> None:
    first = Scripted(2, LOST)
    line, _ = around(clock, first, Scripted(3))
    line.open()
    assert [edge.number for edge in line.read(1.0)] == [1, 2]
    with pytest.raises(DeviceTimeoutError, match='reconnecting'):
        line.read(1.0)
    assert first.closed == 1
    assert line.health.level == Level.ERROR and 'check its cable' in line.health.message
    assert [edge.number for edge in line.read(1.0)] == [3, 4, 5]
    assert line.health == Health(Level.OK, 'edges: 5; reconnected so far: 1')
    assert line.description['times lost'] == '1'


def test_attempts_become_rarer_up_to_five_seconds_and_reading_keeps_to_its_timeout(clock: SteppedClock) -> None:
    line, tried = around(clock, Scripted(LOST), *[AWAY] * 20)
    line.open()
    started_ns = clock.now_ns()
    for _ in range(400):
        before_ns = clock.now_ns()
        with pytest.raises(DeviceTimeoutError):
            line.read(0.1)
        assert clock.now_ns() - before_ns <= 100 * MS
    apart = [(b - a) / NS_PER_S for a, b in zip([started_ns, *tried[1:]], tried[1:], strict=False)]
    assert apart[:8] == pytest.approx([0.25, 0.5, 1.0, 2.0, 4.0, 5.0, 5.0, 5.0], abs=1e-6)
    assert 'lost for ' in line.health.message and 'no such port' in line.health.message


def test_after_it_was_found_delays_begin_anew(clock: SteppedClock) -> None:
    line, tried = around(clock, Scripted(LOST), AWAY, AWAY, Scripted(1, LOST), Scripted(1))
    line.open()
    for _ in range(40):
        try:
            line.read(0.25)
        except DeviceTimeoutError:
            continue
    assert len(tried) == 5
    assert line.description['times lost'] == '2'


def test_closing_while_it_is_away_is_the_end(clock: SteppedClock) -> None:
    line, tried = around(clock, Scripted(LOST), Scripted(1))
    line.open()
    with pytest.raises(DeviceTimeoutError):
        line.read(0.0)
    line.close()
    line.close()
    with pytest.raises(DeviceError, match='open it before reading'):
        line.read(1.0)
    assert len(tried) == 1


def test_a_port_that_is_not_there_is_named() -> None:
    line = reconnecting_sync_input(SyncInputSettings('/dev/no-such-port'), SystemClock())
    with pytest.raises(DeviceNotFoundError, match='/dev/no-such-port'):
        line.open()


class Always:
    """A line that changes every 40 ms."""

    def line_level(self, time_ns: int) -> bool:
        return time_ns // (40 * MS) % 2 == 1

    def line_edges(self) -> Sequence[world.Edge]:
        return ()


@pytest.fixture
def plugged() -> Iterator[tuple[ReconnectingSyncInput, Callable[[bool], None]]]:
    """An emulated adapter in a process's time, and a hand that pulls it out and plugs it in."""
    clock, wires = SystemClock(), []
    pulled = False

    def connect() -> WatchedLine:
        wire = EmulatedControlLine(Always(), clock)
        wire.unplugged = pulled
        wires.append(wire)
        line = WatchedLine('CTS of the emulated port', wire, SyncInputSettings(), clock)
        line.open()
        return line

    def pull(out: bool) -> None:
        nonlocal pulled
        pulled = out
        for wire in wires:
            wire.unplugged = out

    line = ReconnectingSyncInput(connect, clock, 'CTS of the emulated port')
    line.open()
    yield line, pull
    line.close()


def test_an_adapter_that_is_pulled_out_and_plugged_in_sees_edges_again(
    plugged: tuple[ReconnectingSyncInput, Callable[[bool], None]],
) -> None:
    line, pull = plugged
    edges = list(line.read(1.0))
    pull(True)
    with pytest.raises(DeviceTimeoutError):
        for _ in range(100):
            edges += line.read(1.0)
    with pytest.raises(DeviceTimeoutError):
        line.read(0.3)  # the first attempt finds nothing, too
    assert line.health.level == Level.ERROR
    pull(False)
    edges += line.read(2.0)
    assert line.health.level == Level.OK
    assert [edge.number for edge in edges] == list(range(1, len(edges) + 1))
