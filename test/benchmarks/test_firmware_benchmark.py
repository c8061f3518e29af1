"""The bench of real firmware: its line, its ear, the faults that it makes, and how it judges."""

from __future__ import annotations

import argparse
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from benchmarks import firmware
from benchmarks.firmware.faults import FAULTS
from benchmarks.firmware.line import Heard, Line, Program, open_wire
from benchmarks.firmware.obeys import obeys
from benchmarks.firmware.page import complaints, page
from tactile_nodes.clock import SystemClock
from tactile_nodes.errors import ConfigurationError, DeviceNotFoundError

S = 1_000_000_000
SURFACE_MM = -20.0


def ear() -> Heard:
    return Heard(SURFACE_MM, lambda _: None)


def at(z: float) -> str:
    return f'<Jog|MPos:-20.000,-20.000,{z:.3f}|FS:60,0>'


def until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 10
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def arguments(**other: Any) -> argparse.Namespace:
    base = {'grbl': [], 'marlin': [], 'accept': [], 'home_command': 'G28', 'net_ft': '', 'sources': ''}
    return argparse.Namespace(**{**base, **other})


# The ear.


@pytest.mark.parametrize(
    'line',
    [
        at(-20.5),
        'X:0.00 Y:0.00 Z:-20.50 E:0.00 Count X:0 Y:0 Z:-8200',
        'ok X:0.0 Y:0.0 Z:-20.5 E:0 Count: A:0 B:0 C:-2050',
    ],
)
def test_the_depth_is_heard_of_either_kind(line: str) -> None:
    heard = ear()
    heard.take(line, S)
    assert heard.depth_mm == pytest.approx(0.5)


def test_between_two_reports_the_tip_goes_on_and_without_reports_it_rests() -> None:
    """0.1 mm deeper in 0.1 s, so 0.05 mm more 0.05 s later; and a second later where it was last heard of."""
    heard = ear()
    heard.take(at(-20.1), S)
    heard.take(at(-20.2), S + S // 10)
    assert heard.depth_at(S + 3 * S // 20) == pytest.approx(0.25)
    assert heard.depth_at(2 * S) == pytest.approx(0.2)


def test_what_a_restarted_firmware_calls_zero_is_where_the_tip_stands() -> None:
    heard = ear()
    heard.take(at(-20.4), S)
    heard.restarted()
    heard.take('<Alarm|MPos:0.000,0.000,0.000|FS:0,0>', 2 * S)
    assert heard.depth_mm == pytest.approx(0.4)
    heard.take(at(-0.1), 3 * S)
    assert heard.deepest_mm == pytest.approx(0.5)
    assert heard.moved_ns == 3 * S


# The line.


def test_a_program_on_a_line_is_heard_before_the_faults_and_may_be_restarted(tmp_path: Path) -> None:
    script = tmp_path / 'firmware'
    script.write_text(f'echo "Grbl 1.1h [help]"; while read -r line; do echo "{at(-20.5)}"; done')
    heard, program = ear(), Program(f'sh {script}')
    line = Line(program, 'grbl', heard, SystemClock())
    line.faults.mute = True

    def deep() -> bool:
        line.receive(b'\n')
        line.run()
        return heard.depth_mm == pytest.approx(0.5)

    until(deep)
    assert line.take_output() == b''
    line.faults.mute = False
    line.restart()

    def greeted() -> bool:
        line.run()
        return b'Grbl 1.1h' in line.take_output()

    until(greeted)
    program.close()


def test_a_command_that_cannot_be_started_is_one_sentence() -> None:
    with pytest.raises(DeviceNotFoundError, match='cannot start /no/such/simulator'):
        open_wire('/no/such/simulator', 115200, SystemClock())


def test_what_does_not_answer_is_refused_by_the_driver(tmp_path: Path) -> None:
    machine = firmware.machines(arguments(grbl=['mute=sleep 100']))[0]
    assert re.match(r'refused: nothing answers at it with', obeys(machine, SystemClock(), tmp_path)['connect'])


# The faults.


@pytest.mark.parametrize(
    ('fault', 'sent', 'arrives'),
    [
        ('deeper_1', b'$J=G21 G90 G53 X-20.000 Y-20.000 Z-20.750 F60.0\n', b'Z-21.750 F60.0'),
        ('deeper_9', b'N7 G1 X20.000 Y20.000 Z19.250 F60.0*5\n', b'Z10.250 F60.0*5'),
        ('sideways', b'$J=G21 G90 G53 X-20.000 Y-20.000 Z-20.750 F60.0\n', b'X-21.000 Y-20.000'),
        ('faster', b'$J=G21 G90 G53 X-20.000 Y-20.000 Z-20.750 F60.0\n', b'F960.0'),
    ],
)
def test_one_line_is_damaged_on_its_way_and_no_other(fault: str, sent: bytes, arrives: bytes) -> None:
    program = Program('cat')
    line = Line(program, 'grbl', ear(), SystemClock())
    FAULTS[fault].begin(line)
    assert line.faults.passed('>', b'?') == b'?'
    assert arrives in line.faults.passed('>', sent)
    assert line.faults.passed('>', sent) == sent
    program.close()


@pytest.mark.parametrize(
    ('kind', 'said', 'arrives'),
    [
        ('grbl', at(-20.4).encode() + b'\r\n', b'<Jog|MPos:0.000,0.000,0.000|FS:60,0>\r\n'),
        ('marlin', b'X:20.00 Y:20.00 Z:19.60 E:0.00\n', b'X:0.00 Y:0.00 Z:0.00 E:0.00\n'),
        ('marlin', b'ok X:20.0 Y:20.0 Z:19.6 E:0\n', b'ok X:0.00 Y:0.00 Z:0.00 E:0\n'),
    ],
)
def test_reports_of_zero_replace_the_true_ones(kind: str, said: bytes, arrives: bytes) -> None:
    program = Program('cat')
    line = Line(program, kind, ear(), SystemClock())
    FAULTS['zero'].begin(line)
    assert line.faults.passed('<', said) == line.faults.passed('<', said) == arrives
    program.close()


# What is told.


def outcome(said: str, reached_mm: float) -> dict[str, Any]:
    times = {'noticed_s': 0.3, 'rest_s': None}
    return {'said': said, 'kind': 'machine', 'reached_mm': reached_mm, **times, 'up': 'up', 'up_mm': 1.0}


def result(kind: str = 'grbl', **faults: dict[str, Any]) -> dict[str, Any]:
    machine = {'processor': 'P', 'cores_allowed': 2, 'load_before': [1.0]}
    about = {'kind': kind, 'sources': 'of here', 'command': 'bench', 'commit': 'c0ffee', 'machine': machine}
    return {'A firmware': {**about, 'obeys': {'home': '1.0 s'}, 'faults': faults}}


def test_a_press_that_went_on_is_complained_of_and_one_that_stopped_is_not() -> None:
    found = complaints(result(none=outcome('', 2.0), mute=outcome('it is silent', 0.6), cut=outcome('', 2.0)))
    assert found == ['A firmware, nothing arrives, either way: 2.00 mm, nothing was said']


def test_a_line_with_a_checksum_is_said_again_so_that_the_press_goes_on() -> None:
    assert complaints(result('marlin', deeper_9=outcome('', 2.0))) == []
    assert complaints(result('grbl', deeper_9=outcome('', 2.0)))
    assert complaints(result('marlin', deeper_9=outcome('it is off its way', 1.0)))


def test_the_page_tells_depth_times_and_words_of_each_fault() -> None:
    text = page(result(mute=outcome('it is silent', 0.6), restart={'failed': 'no power to cut'}))
    assert '| nothing that it says arrives | 0.60 | 0.30 | – | 1.00 | it is silent | up |' in text
    assert 'not tried: no power to cut' in text
    assert '| home | 1.0 s |' in text


@pytest.mark.parametrize(
    ('given', 'sentence'),
    [
        ({}, 'name at least one firmware'),
        ({'grbl': ['./grbl_sim.exe']}, 'a firmware is NAME=COMMAND'),
        ({'grbl': ['A=b'], 'net_ft': 'box'}, '--net-ft is HOST:RDT:HTTP'),
    ],
)
def test_what_cannot_be_measured_is_refused_in_a_sentence(given: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ConfigurationError, match=sentence):
        firmware.machines(arguments(**given))
