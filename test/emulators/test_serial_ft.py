"""The emulated serial sensors, fed with bytes and times by hand, and on their pseudo-terminal."""

from __future__ import annotations

import re
import struct
from pathlib import Path

import pytest
import serial

from tactile_nodes.clock import SystemClock
from tactile_nodes.emulators.force_torque.serial_ft import PtySensor
from tactile_nodes.emulators.force_torque.serial_ft_bota import BotaSensor, crc16_x25
from tactile_nodes.emulators.force_torque.serial_ft_sensor import microsecond_clock
from tactile_nodes.emulators.force_torque.serial_ft_text import TextLineSensor

MS = 1_000_000
LOAD = (1.0, -2.0, 0.5, 0.0, 0.25, -0.125)


class Step:
    """A world in which the load comes on at a time."""

    def __init__(self, at_ns: int = 0) -> None:
        self.at_ns = at_ns

    def wrench_at(self, time_ns: int) -> tuple[float, ...]:
        return LOAD if time_ns >= self.at_ns else (0.0,) * 6


def bota() -> BotaSensor:
    sensor = BotaSensor(Step(), noise=0.0)
    sensor.power_on(0)
    return sensor


def cell(**more: object) -> TextLineSensor:
    sensor = TextLineSensor(Step(), counts_per_unit=(1000.0,), noise=0.0, **more)
    sensor.power_on(0)
    sensor.due(0)
    return sensor


def test_a_bota_sensor_says_that_it_has_started_and_then_sends_100_frames_a_second() -> None:
    sensor = bota()
    assert sensor.due(0) == b'App Init\r\n'
    assert len(sensor.due(1000 * MS)) == 100 * 37


def test_a_frame_has_its_fields_in_order_and_the_time_at_its_end() -> None:
    sensor = bota()
    frame = sensor.due(10 * MS)[len(b'App Init\r\n') :]
    body = bytes.fromhex('0000 0000803f 000000c0 0000003f 00000000 0000803e 000000be 10270000 0000c841')
    assert frame == b'\xaa' + body + struct.pack('<H', crc16_x25(body))


def test_the_dialogue_stops_sets_up_and_runs() -> None:
    sensor = bota()
    sensor.due(0)
    answers = []
    for command in (b'C', b'c,0,1,0,4', b'f,256,0,0,1', b'R'):
        sensor.receive(command, 0)
        answers.append(sensor.due(0))
    assert answers == [b'r,0,C,0\r\n', b'r,0,c,0\r\n', b'r,0,f,0\r\n', b'r,0,R,0\r\n']
    assert len(sensor.due(1000 * MS)) == 200 * 37


@pytest.mark.parametrize('command', [b'f,20,0,0,1', b'c,0,1,1,4'])
def test_a_filter_or_format_that_it_has_not_is_refused(command: bytes) -> None:
    sensor = bota()
    sensor.due(0)
    sensor.receive(b'C', 0)
    sensor.receive(command, 0)
    assert sensor.due(0).endswith(b'r,0,%s,1\r\n' % command[:1])


def test_raw_and_overrange_are_in_the_status() -> None:
    sensor = bota()
    sensor.receive(b'Cc,0,0,0,4R', 0)
    sensor.faults.saturated = True
    frame = sensor.due(10 * MS)[-37:]
    assert struct.unpack_from('<H', frame, 1) == (0b1010,)


def test_a_text_line_is_the_time_in_microseconds_and_the_counts() -> None:
    assert cell(rate_hz=80.0, settling=1).due(25 * MS) == b'12500,500\r\n25000,500\r\n'


def test_several_channels_stand_in_one_line() -> None:
    sensor = TextLineSensor(Step(), ('fx', 'fy', 'tz'), (1.0, 10.0, 800.0), rate_hz=10.0, noise=0.0)
    sensor.power_on(0)
    assert sensor.due(100 * MS) == b'# text-line force sensor\r\n100000,1,-20,-100\r\n'


def test_an_hx711_shows_a_step_fully_after_four_conversions() -> None:
    sensor = cell(rate_hz=10.0)
    sensor.world = Step(at_ns=350 * MS)
    counts = [int(line.split(b',')[1]) for line in sensor.due(800 * MS).splitlines()]
    assert counts == [0, 0, 0, 125, 250, 375, 500, 500]


def test_its_converter_has_24_bits() -> None:
    sensor = TextLineSensor(Step(), ('fx', 'fy'), (1e9, 1e9), rate_hz=10.0, noise=0.0)
    sensor.power_on(0)
    assert sensor.due(100 * MS).endswith(b'100000,8388607,-8388608\r\n')


def test_its_microseconds_wrap_after_71_minutes() -> None:
    sensor = cell(rate_hz=80.0, settling=1, clock=microsecond_clock(offset=2**32 - 12_500))
    assert sensor.due(25 * MS) == b'0,500\r\n12500,500\r\n'


@pytest.mark.parametrize(('fault', 'expected'), [('silent', b''), ('saturated', b'12500,8388607\r\n')])
def test_faults_show_on_the_line(fault: str, expected: bytes) -> None:
    sensor = cell()
    setattr(sensor.faults, fault, True)
    assert sensor.due(12_500_000) == expected


def test_garbage_is_as_long_as_what_it_replaces() -> None:
    sensor = cell(settling=1)
    sensor.faults.garbage = 1
    sent = sensor.due(25 * MS)
    assert sent.endswith(b'25000,500\r\n')
    assert len(sent) == len(b'12500,500\r\n25000,500\r\n')


def test_on_its_terminal_it_can_be_read_unplugged_and_plugged_in_again(tmp_path: Path) -> None:
    with PtySensor(TextLineSensor(Step()), SystemClock(), tmp_path / 'ttyFT') as device:
        with serial.Serial(str(device.path), 115_200, timeout=30.0) as port:
            _assert_samples(port)
            device.unplug()
            assert not device.path.exists()
            with pytest.raises(serial.SerialException):
                port.read(1000)
        device.plug()
        with serial.Serial(str(device.path), 115_200, timeout=30.0) as port:
            _assert_samples(port)


def _assert_samples(port: serial.Serial) -> None:
    """The third line is whole: opening drops what arrived before, the banner or half of a line."""
    *_, line = (port.readline() for _ in range(3))
    assert re.fullmatch(rb'\d+,-?\d+\r\n', line)
