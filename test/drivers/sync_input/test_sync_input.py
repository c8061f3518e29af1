"""A control line of a serial port as a digital input, on an emulated line and on pyserial's own loop."""

from __future__ import annotations

import errno
import itertools
import os
import termios
import threading
import time
from collections.abc import Iterator, Sequence

import numpy as np
import pytest
import serial

from benchmarks.devices.sync_line import EmulatedControlLine, RecorderFaults, recorded
from tactile_nodes.clock import Clock, SteppedClock, SystemClock
from tactile_nodes.drivers.health import Level
from tactile_nodes.drivers.serial_port import open_port
from tactile_nodes.drivers.sync_input.control_line import (
    Edge,
    SerialControlLine,
    SyncInputSettings,
    WatchedLine,
    sync_input,
)
from tactile_nodes.emulators import world
from tactile_nodes.emulators.camera_stream import light_brightness
from tactile_nodes.emulators.clocks import DeviceClock
from tactile_nodes.errors import DeviceError, DeviceNotFoundError, DeviceTimeoutError
from tactile_nodes.sensing.sync.clocks import ClockFit, SyncLimits, fit_clocks
from tactile_nodes.sensing.sync.light import LightWatch

MS = 1_000_000


class Line:
    """A line with edges at given times."""

    def __init__(self, times_ns: Sequence[int]) -> None:
        self._edges = [world.Edge(time_ns, number % 2 == 0) for number, time_ns in enumerate(times_ns)]

    def line_level(self, time_ns: int) -> bool:
        return next((edge.level for edge in reversed(self._edges) if edge.stamp_ns <= time_ns), False)

    def line_edges(self) -> Sequence[world.Edge]:
        return self._edges


class LookedAt(EmulatedControlLine):
    """A line whose time goes on by a millisecond with each look, however late a busy machine looks."""

    def __init__(self, line: Line, clock: SteppedClock, inverted: bool = False) -> None:
        super().__init__(line, clock, inverted)
        self._passes = clock.advance

    def level(self) -> bool:
        level = super().level()
        self._passes(0.001)
        return level


@pytest.fixture
def times_ns() -> list[int]:
    return [each * MS for each in (50, 71, 89, 122, 140, 173)]


@pytest.fixture
def stepped() -> SteppedClock:
    return SteppedClock(0)


@pytest.fixture
def wire(times_ns: list[int], stepped: SteppedClock) -> LookedAt:
    return LookedAt(Line(times_ns), stepped)


def watch(line, clock: Clock | None = None, **settings: object) -> WatchedLine:
    used = clock or SystemClock()
    watched = WatchedLine('CTS of the emulated port', lambda: line, SyncInputSettings(**settings), used)
    watched.open()
    return watched


@pytest.fixture
def watched(wire: LookedAt, stepped: SteppedClock) -> Iterator[WatchedLine]:
    opened = watch(wire, stepped)
    yield opened
    opened.close()


def read(line: WatchedLine, count: int) -> list[Edge]:
    edges: list[Edge] = []
    while len(edges) < count:
        edges += line.read(30.0)
    return edges


def test_every_edge_is_seen_with_its_level_and_number_and_happened_within_its_stated_uncertainty(
    watched: WatchedLine, times_ns: list[int]
) -> None:
    edges = read(watched, 6)
    assert [(edge.level, edge.number) for edge in edges] == list(zip([True, False] * 3, range(1, 7), strict=True))
    for edge, true_ns in zip(edges, times_ns, strict=True):
        assert abs(edge.stamp_ns - true_ns) <= edge.uncertainty_s * 1e9
        assert edge.uncertainty_s <= 0.001  # two looks, a millisecond each


@pytest.mark.parametrize('can_wait', [False, True])
def test_an_edge_after_the_adapter_has_looked_lies_within_its_stated_uncertainty(can_wait: bool) -> None:
    """The adapter answers 5 ms after it has looked, as does a thread that gets no processor for as long."""
    clock, edge_ns = SteppedClock(0), 12 * MS

    class Slow:
        def level(self) -> bool:
            level = clock.now_ns() >= edge_ns
            clock.advance(0.005)
            return level

        def wait(self) -> bool:
            if not can_wait:
                return False
            if clock.now_ns() > edge_ns:
                raise OSError(errno.EIO, 'gone')
            clock.advance((edge_ns - clock.now_ns()) / 1e9)
            return True

        def close(self) -> None:
            """Nothing."""

    line = WatchedLine('a slow line', Slow, SyncInputSettings(), clock)
    line.open()
    edge = read(line, 1)[0]
    line.close()
    assert abs(edge.stamp_ns - edge_ns) <= edge.uncertainty_s * 1e9


def test_a_constant_delay_is_taken_off(wire: LookedAt, times_ns: list[int], stepped: SteppedClock) -> None:
    line = watch(wire, stepped, delay_ms=1000.0)
    edge = read(line, 1)[0]
    line.close()
    assert abs(edge.stamp_ns + 1000 * MS - times_ns[0]) <= edge.uncertainty_s * 1e9


def test_an_optocoupler_that_inverts_is_inverted_back(times_ns: list[int], stepped: SteppedClock) -> None:
    line = watch(LookedAt(Line(times_ns), stepped, inverted=True), stepped, invert=True)
    assert read(line, 1)[0].level is True
    line.close()


def test_a_line_that_does_not_change_is_a_timeout_and_waiting_for_it_does_not_burn_the_processor() -> None:
    line = watch(EmulatedControlLine(Line([]), SystemClock()))
    before_s = time.process_time()
    with pytest.raises(DeviceTimeoutError, match='has not changed'):
        line.read(0.3)
    assert time.process_time() - before_s < 0.2
    assert line.health.level == Level.OK
    line.close()


def test_closing_ends_a_wait_in_another_thread() -> None:
    line = watch(EmulatedControlLine(Line([]), SystemClock()))
    begin_s = time.monotonic()
    threading.Timer(0.2, line.close).start()
    with pytest.raises(DeviceError, match='is closed'):
        line.read(20.0)
    assert time.monotonic() - begin_s < 5.0


def test_where_the_driver_can_wait_nothing_is_polled() -> None:
    class Waiting:
        """A line that changes whenever it is waited for, ten times."""

        def __init__(self) -> None:
            self.looks = 0
            self.waits = 0
            self.over = threading.Event()

        def level(self) -> bool:
            self.looks += 1
            return self.waits % 2 == 1

        def wait(self) -> bool:
            if self.waits == 10:
                self.over.wait(120)
                raise OSError(errno.EIO, 'gone')
            self.waits += 1
            return True

        def close(self) -> None:
            """Nothing."""

    port = Waiting()
    line = watch(port)
    edges = read(line, 10)
    assert len(edges) == 10
    assert port.looks == 11
    assert all(edge.uncertainty_s == 1e-4 for edge in edges)
    port.over.set()
    line.close()


def test_a_real_serial_port_object_is_watched() -> None:
    """pyserial's loop connects RTS to CTS."""
    port = serial.serial_for_url('loop://')
    port.rts = False
    line = watch(SerialControlLine(port, 'cts'), wait=False)
    port.rts = True
    assert read(line, 1)[0].level is True
    port.rts = False
    assert read(line, 1)[0].level is False
    line.close()


def test_a_port_that_is_not_there_is_named() -> None:
    with pytest.raises(DeviceNotFoundError, match='/dev/no-such-port to watch its DSR line'):
        sync_input(SyncInputSettings('/dev/no-such-port', 'dsr'), SystemClock()).open()


def test_a_port_without_control_lines_is_refused() -> None:
    ours, theirs = os.openpty()
    with pytest.raises(DeviceError, match='use an adapter with control lines'):
        sync_input(SyncInputSettings(os.ttyname(theirs)), SystemClock()).open()
    for end in (ours, theirs):
        os.close(end)


def test_the_port_of_a_machine_that_is_in_use_is_left_as_it_is() -> None:
    """Else its baud rate would become 9600, and nothing could stop the machine any more."""
    ours, theirs = os.openpty()
    machine = open_port(os.ttyname(theirs), 115_200, 'default', SystemClock())
    with pytest.raises(DeviceNotFoundError, match='that no other program uses'):
        sync_input(SyncInputSettings(os.ttyname(theirs)), SystemClock()).open()
    assert termios.tcgetattr(theirs)[5] == termios.B115200
    machine.close()
    for each in (ours, theirs):
        os.close(each)


def irregular(count: int) -> Line:
    gaps = np.random.default_rng(1).uniform(0.4, 2.5, count)
    return Line(np.round(np.cumsum(gaps) * 1e9).astype(np.int64).tolist())


def test_two_recorders_of_one_line_are_brought_together() -> None:
    """0.3 s apart, 100 ppm, 5 % missing and doubled: the device's microseconds are put on the host's time base."""
    line = irregular(120)
    clock = DeviceClock(1e6, start_ns=300 * MS, drift_ppm=100, bits=64)
    faults = RecorderFaults(missing=0.05, doubled=0.05, jitter_s=0.001)
    device = np.array([1000 * ticks for ticks, _ in recorded(line.line_edges(), clock, faults, seed=2)])
    host = np.array([ticks for ticks, _ in recorded(line.line_edges(), DeviceClock(1e9, bits=64), faults, seed=3)])
    fit = fit_clocks(device, host, SyncLimits(jitter_s=0.003))
    assert isinstance(fit, ClockFit), fit
    times_ns = np.arange(1, 200, 5) * 1000 * MS
    found = fit.host_ns(np.array([1000 * clock.count(int(time_ns)) for time_ns in times_ns]))
    assert np.abs(found - times_ns).max() < 2 * MS


def test_a_light_before_a_camera_and_a_line_of_the_host_are_brought_together() -> None:
    """At 60 frames a second with 10 ms of exposure, on a camera clock that is 0.1 s off."""
    edges = irregular(60).line_edges()
    start_ns = np.arange(0, edges[-1].stamp_ns, 16_666_667)
    levels = np.array([light_brightness(edges, int(each), 0.010) for each in start_ns])
    watch = LightWatch(0.010)
    observed = [watch.take(int(each) + 100 * MS, float(level)) for each, level in zip(start_ns, levels, strict=True)]
    stamps_ns, lit, uncertainty_s = (
        np.concatenate([getattr(each, name) for each in observed]) for name in ('stamp_ns', 'level', 'uncertainty_s')
    )
    host = np.array([edge.stamp_ns for edge in edges])
    host_levels = np.array([edge.level for edge in edges])
    fit = fit_clocks(stamps_ns, host, SyncLimits(0.01), lit, host_levels, uncertainty_s)
    assert isinstance(fit, ClockFit), fit
    assert abs(fit.offset_s + 0.1) < 0.002


def test_recorded_edges_stay_in_order_whatever_the_faults() -> None:
    faults = RecorderFaults(missing=0.2, doubled=0.5, jitter_s=0.3)
    observed = recorded(irregular(200).line_edges(), DeviceClock(7000), faults)
    assert all(later[0] >= earlier[0] for earlier, later in itertools.pairwise(observed))
