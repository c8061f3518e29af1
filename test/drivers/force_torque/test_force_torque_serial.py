"""Bota frames and the text line byte for byte, the configuration dialogue, and what comes down a bad line."""

from __future__ import annotations

import itertools
import math
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from ft_rigs import LOST_S, Rig, assert_counted, read, read_until, rig_of
from jumping_clock import AheadClock

from tactile_nodes.clock import SteppedClock, SystemClock, monotonic_s
from tactile_nodes.drivers.force_torque import bota, text
from tactile_nodes.drivers.force_torque.check import SampleCheck
from tactile_nodes.drivers.force_torque.contract import Flag, ForceTorqueSettings, TextLineSettings
from tactile_nodes.drivers.force_torque.queue import SampleQueue
from tactile_nodes.drivers.force_torque.serial_line import Gaps
from tactile_nodes.drivers.force_torque.stream import StreamedForceTorque
from tactile_nodes.errors import DeviceError, DeviceLostError, DeviceTimeoutError

# Status 0; 1, -2, 0.5 N; 0, 0.25, -0.125 N·m; 1 000 000 µs; 25 °C.
BODY = bytes.fromhex('0000 0000803f 000000c0 0000003f 00000000 0000803e 000000be 40420f00 0000c841')
FRAME = b'\xaa' + BODY + bota.crc16_x25(BODY).to_bytes(2, 'little')
READING = bota.Frame(0, (1.0, -2.0, 0.5, 0.0, 0.25, -0.125), 1_000_000, 25.0)


class ScriptedPort:
    """A port on which a dialogue is played: for each command that is expected, what is answered."""

    name = 'port'

    def __init__(self, greeting: bytes, dialogue: list[tuple[bytes, bytes]]) -> None:
        self._to_say = [greeting]
        self._dialogue = dialogue

    def write(self, data: bytes) -> None:
        expected, answer = self._dialogue.pop(0)
        assert data == expected
        self._to_say.append(answer)

    def read(self, timeout_s: float) -> bytes:
        return self._to_say.pop(0) if self._to_say else b''

    def close(self) -> None:
        assert not self._dialogue


DIALOGUE = [
    (b'C', b'r,0,C,0\r\n'),
    (b'c,0,1,0,4', b'r,0,c,0\r\n'),
    (b'f,512,0,0,1', b'r,0,f,0\r\n'),
    (b'R', b'r,0,R,0\r\n'),
]


def test_the_check_sum_is_crc_16_x25() -> None:
    assert bota.crc16_x25(b'123456789') == 0x906E


def test_a_frame_is_37_bytes_little_endian() -> None:
    assert len(FRAME) == bota.FRAME_BYTES == 37
    assert bota.parse(FRAME) == READING


def test_a_frame_is_found_whatever_comes_before_it_and_in_whatever_pieces() -> None:
    parser = bota.FrameParser()
    stream = b'r,0,R,0\r\n\xaa\xaa' + FRAME + FRAME
    frames = [frame for byte in stream for frame in parser.feed(bytes([byte]))]
    assert frames == [READING, READING]
    assert parser.bad == 2


def test_a_damaged_frame_is_dropped_and_the_next_one_found() -> None:
    parser = bota.FrameParser()
    damaged = FRAME[:20] + bytes([FRAME[20] ^ 1]) + FRAME[21:]
    assert parser.feed(damaged + FRAME) == [READING]


def test_a_force_that_is_no_number_is_read_as_what_it_is() -> None:
    """The check sum is right: the sensor says it, and whoever moves must know at once."""
    body = BODY[:2] + bytes.fromhex('0000c07f') + BODY[6:]
    frame = bota.parse(b'\xaa' + body + bota.crc16_x25(body).to_bytes(2, 'little'))
    assert frame is not None
    assert math.isnan(frame.wrench[0])
    assert frame.wrench[1:] == READING.wrench[1:]


@pytest.mark.parametrize(
    ('status', 'flags'),
    [(0, 0), (1, Flag.WARNING), (2, Flag.SATURATED), (4, Flag.FAULT), (8, Flag.FAULT), (16, Flag.FAULT), (3, 16 | 2)],
)
def test_the_bits_of_the_status_have_their_meaning(status: int, flags: int) -> None:
    assert bota.flags_of(status) == flags


@pytest.mark.parametrize(('rate_hz', 'sinc'), [(100, 512), (200, 256), (800, 64), (1000, 51), (5000, 51), (10, 512)])
def test_the_filter_gives_the_rate(rate_hz: float, sinc: int) -> None:
    assert bota.sinc_for(rate_hz) == sinc


def set_up(greeting: bytes, dialogue: list[tuple[bytes, bytes]]) -> None:
    """See that all of the dialogue is said."""
    port = ScriptedPort(greeting, list(dialogue))
    bota.set_up(port, 512, 460_800)
    port.close()


def test_the_dialogue_is_that_of_the_manual_also_with_a_sensor_that_runs_already() -> None:
    set_up(b'App Init\r\n', DIALOGUE)
    set_up(FRAME * 4, [(b'C', FRAME[5:] + b'r,0,C,0\r\n'), *DIALOGUE[1:]])


def test_a_refused_command_is_named() -> None:
    with pytest.raises(DeviceError, match='refuses'):
        set_up(b'App Init', [*DIALOGUE[:2], (b'f,512,0,0,1', b'r,0,f,1\r\n')])


def test_a_sensor_that_is_still_starting_is_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """It starts later than usual, or does not listen yet after its text."""
    monkeypatch.setattr(bota, 'BOOT_S', 0.01)
    monkeypatch.setattr(bota, 'ANSWER_S', 0.01)
    set_up(b'', [(b'C', b''), (b'C', b'App Init\r\n'), *DIALOGUE])


def test_a_device_that_does_not_answer_is_a_timeout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bota, 'ANSWER_S', 0.01)
    with pytest.raises(DeviceTimeoutError, match='does not respond'):
        set_up(b'App Init', [(b'C', b'unknown command')] * bota.STOP_TRIES)


def test_an_answer_that_was_there_before_this_computer_paused_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [100.0]

    def late() -> float:
        now_s[0] += 2.0
        return now_s[0]

    monkeypatch.setattr(bota.clocks, 'monotonic_s', late)
    set_up(b'App Init\r\n', DIALOGUE)


@pytest.mark.parametrize(
    ('line', 'expected'),
    [
        (b'1200,-351', (1200, (-351.0,))),
        (b'4294967295,8388607\r', (2**32 - 1, (8388607.0,))),
        (b'12345678901,7', (12345678901 - 2 * 2**32, (7.0,))),  # of a 64-bit clock, three hours after its start
        (b'5, 1.5, -2e3, 0, 1, 2, 3', (5, (1.5, -2000.0, 0, 1, 2, 3))),
    ],
)
def test_a_line_is_a_time_and_one_to_six_numbers(line: bytes, expected: tuple) -> None:
    assert text.parse(line) == expected


@pytest.mark.parametrize(
    'line',
    [
        b'', b'1200', b'1200,', b'-5,3', b'1200,abc', b'1,2,3,4,5,6,7,8', b'12 00,3', b'1200,0x7f', b'1200,none',
        b'# 1,2',
    ],
)  # fmt: skip
def test_anything_else_is_no_line(line: bytes) -> None:
    assert text.parse(line) is None


@pytest.mark.parametrize(('line', 'value'), [(b'5,nan,2', 'nan'), (b'5,-INF,2', '-inf'), (b'5,inf,2', 'inf')])
def test_what_an_arduino_prints_of_a_value_that_is_no_number_is_read_as_that(line: bytes, value: str) -> None:
    parsed = text.parse(line)
    assert parsed is not None
    assert str(parsed.values[0]) == value


def test_the_first_line_may_have_lost_its_head_and_is_not_believed() -> None:
    parser = text.LineParser()
    lines = parser.feed(b'34,5\r\n1000,7\r\n# remark\r\n\r\n20') + parser.feed(b'00,8\nrubbish\n')
    assert lines == [(1000, (7.0,)), (2000, (8.0,))]
    assert parser.bad == 1


def test_a_line_that_never_ends_does_not_fill_the_memory() -> None:
    parser = text.LineParser()
    assert parser.feed(b'x' * 10_000) == []
    assert parser.feed(b'y\n5,6\n') == [(5, (6.0,))]


def test_channels_go_to_their_axes_and_the_others_are_not_zero() -> None:
    settings = TextLineSettings(axes=('tz', 'fx'), units_per_count=(0.001, 0.5))
    wrench = text.wrench_of((30.0, 4.0), settings)
    assert (wrench[5], wrench[0]) == (0.03, 2.0)
    assert all(map(math.isnan, wrench[1:5]))


@pytest.mark.parametrize(
    ('axes', 'scales'), [(('fz', 'fz'), (1.0, 1.0)), (('up',), (1.0,)), ((), ()), (('fx', 'fz'), (1.0,))]
)
def test_channels_that_cannot_be_assigned_are_refused(axes: tuple, scales: tuple) -> None:
    with pytest.raises(ValueError, match='axes'):
        TextLineSettings(axes=axes, units_per_count=scales)


def test_missing_samples_follow_from_the_sensors_own_clock() -> None:
    """12 500 µs from one to the next: 37 480 µs are three periods."""
    gaps = Gaps(12_500)
    assert [gaps.missing(ticks) for ticks in (0, 12_510, 49_990, 62_500)] == [0, 0, 2, 0]


def test_the_period_is_learnt_where_nobody_says_it() -> None:
    gaps = Gaps()
    for number in range(8):
        gaps.missing(number * 100_000)
    assert gaps.period_ticks == 100_000
    assert gaps.missing(1_000_000) == 2


@pytest.fixture(params=['bota', 'text'])
def rig(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Rig]:
    with rig_of(request.param, tmp_path) as opened:
        yield opened


def test_garbage_on_the_line_loses_samples_and_nothing_else(rig: Rig) -> None:
    sensor = rig.open()
    read(sensor, 20)
    rig.faults.garbage, rig.faults.garble = 3, 2
    read_until(sensor, lambda sample: sample.dropped > 3)
    samples = read(sensor, 40)
    assert_counted(samples)
    assert 4 <= samples[-1].dropped <= 7  # a damaged byte may be in the time, or take the line end with it
    assert all(abs(sample.wrench[2] - 2.0) < 0.1 for sample in samples)


def test_values_that_repeat_for_ever_are_no_measurement(rig: Rig) -> None:
    sensor = rig.open()
    rig.faults.stuck = True
    sample = read_until(sensor, lambda sample: bool(sample.flags & Flag.STALLED))
    assert not sample.usable


def test_a_sensor_that_was_switched_off_and_on_is_set_up_anew(rig: Rig) -> None:
    """Its clock begins again: the filter that it was given is gone, and its samples would count as old for ever."""
    sensor = rig.open()
    read(sensor, 40)
    rig.device.talker.clock = rig.device.talker.clock.altered(SystemClock().now_ns(), 0.0, -10.0)
    assert not read_until(sensor, lambda sample: bool(sample.flags & Flag.RESTARTED)).flags & Flag.UNTIMED
    assert int(sensor.description['times lost']) >= 1  # a busy computer may lose it once more


@pytest.mark.parametrize('minutes', [10, 50, 100])
def test_a_clock_that_begins_again_is_noticed_however_long_it_has_run(minutes: int) -> None:
    """In 32 bits, microseconds wrap after 71 minutes; from the half of that on, zero lies ahead."""
    port = ScriptedPort(b'', [])
    connection = text.TextLineConnection(port, ForceTorqueSettings('text:port'), stepped := SteppedClock(10**18))
    queue, begin_us = SampleQueue('port', 100, SampleCheck()), minutes * 60_000_000

    def send(time_us: int) -> None:
        stepped.advance(0.0125)
        port._to_say = [b'%d,%d\n' % (time_us % 2**32, time_us % 7)]
        connection.fetch(queue)

    for number in range(20):
        send(begin_us + 12_500 * number)
    assert queue.newest is not None
    with pytest.raises(DeviceLostError, match='has restarted'):
        send(12_500)


def test_lines_that_come_at_once_are_not_stamped_after_their_arrival() -> None:
    """1 kHz; all are 3 ms late, but then three come in one read, and the last of them was not late at all."""
    port = ScriptedPort(b'', [])
    settings, stepped = ForceTorqueSettings('text:port', rate_hz=1000.0), SteppedClock(10**18)
    connection, queue = text.TextLineConnection(port, settings, stepped), SampleQueue('port', 200, SampleCheck())
    for number in range(150):
        stepped.advance(0.001)
        port._to_say = [b'%d,%d\n' % (1000 * number, number % 7)]
        connection.fetch(queue)
    port._to_say = [b''.join(b'%d,%d\n' % (1000 * number, number % 7) for number in (151, 152, 153))]
    stepped.advance(0.001)
    connection.fetch(queue)
    samples = queue.take(0.0)
    assert all(later.stamp_ns > earlier.stamp_ns for earlier, later in itertools.pairwise(samples))
    assert all(0 <= sample.arrival_ns - sample.stamp_ns <= 3_000_000 for sample in samples)
    assert abs(samples[-1].arrival_ns - stepped.now_ns()) <= 3


def test_bytes_that_are_never_a_sample_are_distinguished_from_silence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(text, 'GARBAGE_S', 0.2)
    with rig_of('text', tmp_path) as rig:
        wrong = ForceTorqueSettings(
            rig.settings.source, text=TextLineSettings(axes=('fx', 'fz'), units_per_count=(1.0, 1.0))
        )
        with pytest.raises(DeviceTimeoutError, match='no lines of t_us and 2 channels'):
            rig.make(wrong)


class Board:
    """An Arduino: it restarts whenever its port is opened, and sends nothing until it has started."""

    name = 'board'

    def __init__(self, boot_s: float, rate_hz: float = 100.0) -> None:
        self._begin_s = monotonic_s() + boot_s
        self._rate_hz = rate_hz
        self.sent = 0
        self.pulled = False

    def write(self, data: bytes) -> None:
        raise AssertionError('nothing is sent to it')

    def read(self, timeout_s: float) -> bytes:
        if self.pulled:
            raise DeviceLostError('the board is gone')
        due_s = self._begin_s + (self.sent + 1) / self._rate_hz
        time.sleep(max(0.0, min(timeout_s, due_s - monotonic_s())))
        if monotonic_s() < due_s:
            return b''
        self.sent += 1
        return b'%d,%d\n' % (round(self.sent * 1e6 / self._rate_hz), self.sent * 7 % 11)

    def close(self) -> None:
        """Nothing to close."""


def test_a_board_that_starts_longer_than_garbage_is_borne_with_is_not_garbage(monkeypatch: pytest.MonkeyPatch) -> None:
    """An Arduino takes two seconds, and the first of its lines is not believed."""
    board = Board(0.0)
    monkeypatch.setattr(text.clocks, 'monotonic_s', lambda: monotonic_s() + 10 * text.GARBAGE_S * (board.sent > 0))
    settings, clock = ForceTorqueSettings('text:board'), SystemClock()
    connection = text.TextLineConnection(board, settings, clock)
    queue = SampleQueue('board', 100, SampleCheck())
    while queue.newest is None:
        connection.fetch(queue)


def test_a_board_that_starts_longer_than_silence_is_borne_with_comes_back() -> None:
    """Giving up while it starts would open its port again, and so restart it, for ever."""
    boards: list[Board] = []

    def connect() -> text.TextLineConnection:
        boards.append(Board(0.8, rate_hz=50.0))
        return text.TextLineConnection(boards[-1], settings, clock)

    settings, clock = ForceTorqueSettings('text:board', lost_s=0.3), SystemClock()
    sensor = StreamedForceTorque('the board', connect, settings, clock, ('fz',))
    sensor.open()
    try:
        boards[0].pulled = True
        again = read_until(sensor, lambda sample: bool(sample.flags & Flag.RESTARTED))
        assert len(boards) == 2
        assert again.dropped > 40  # it was away for more than 0.8 s
    finally:
        sensor.close()


def paused_in(parser: object, now_s: list[float], seconds: float) -> object:
    """This computer pauses while it looks for samples in what it has read."""

    class Paused:
        def __getattr__(self, name: str) -> object:
            return getattr(parser, name)

        def feed(self, data: bytes) -> object:
            now_s[0] += seconds
            return parser.feed(data)

    return Paused()


def test_half_a_sample_before_this_computer_paused_is_no_garbage(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s, clock = [100.0], SystemClock()
    monkeypatch.setattr(bota.clocks, 'monotonic_s', lambda: now_s[0])
    line_port, frame_port = ScriptedPort(b'5,', []), ScriptedPort(b'App Init\r\n', list(DIALOGUE))
    for kind, port, half in (
        (text.TextLineConnection, line_port, b'5,'),
        (bota.BotaConnection, frame_port, FRAME[:20]),
    ):
        connection = kind(port, ForceTorqueSettings('a sensor:port'), clock)
        connection._parser = paused_in(connection._parser, now_s, 3.0)
        port._to_say = [half]
        connection.fetch(SampleQueue('port', 100, SampleCheck()))


def test_a_pause_of_this_computer_right_after_it_has_read_is_no_silence(ahead: AheadClock) -> None:
    """What came meanwhile is read next."""
    paused = threading.Event()

    class Pausing(text.TextLineConnection):
        def fetch(self, queue: SampleQueue) -> None:
            newest = queue.newest
            super().fetch(queue)
            if newest is not None and queue.newest is newest and not paused.is_set():
                ahead.advance(1.2 * LOST_S)
                paused.set()

    settings = ForceTorqueSettings('text:board', lost_s=LOST_S)
    board = Board(0.0, rate_hz=10.0)
    sensor = StreamedForceTorque('the board', lambda: Pausing(board, settings, ahead), settings, ahead, ('fz',))
    sensor.open()
    try:
        assert paused.wait(60)
        read(sensor)
        assert sensor.description['times lost'] == '0'
    finally:
        sensor.close()


def test_a_bota_that_takes_long_to_start_may_send_half_a_frame_first(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [100.0]
    monkeypatch.setattr(bota.clocks, 'monotonic_s', lambda: now_s[0])

    class Slow(ScriptedPort):
        def read(self, timeout_s: float) -> bytes:
            if self._to_say and self._to_say[0].startswith(b'App'):
                now_s[0] += 1.2 * bota.GARBAGE_S
            return super().read(timeout_s)

    port = Slow(b'App Init\r\n', list(DIALOGUE))
    connection = bota.BotaConnection(port, ForceTorqueSettings('bota:port'), SystemClock())
    port._to_say = [FRAME[:20]]
    connection.fetch(SampleQueue('bota', 100, SampleCheck()))
