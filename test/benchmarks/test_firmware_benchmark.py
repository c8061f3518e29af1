"""The bench of real firmware: its line, its ear, the faults that it makes, and how it judges."""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import re
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from coarse_table import coarse_table

from benchmarks import firmware
from benchmarks.devices.direct_port import DirectPort
from benchmarks.devices.rehearsal import JumpingClock
from benchmarks.firmware import pressed
from benchmarks.firmware.descent import LIMITS, approach
from benchmarks.firmware.faults import FAULTS
from benchmarks.firmware.line import Line, Program, ReportedPlace, open_wire
from benchmarks.firmware.obeys import connected, obeys
from benchmarks.firmware.page import complaints, page
from benchmarks.firmware.press import Bench, Machine, Outcome, require_begun
from benchmarks.harness.running import run
from tactile_nodes.clock import SystemClock
from tactile_nodes.collection.safety import FORCE, SENSOR, SILENT_MACHINE, Safety
from tactile_nodes.collection.settings import CollectionSettings
from tactile_nodes.drivers.cnc.grbl import GrblCnc
from tactile_nodes.drivers.force_torque.contract import Sample
from tactile_nodes.emulators.cnc.grbl import Grbl
from tactile_nodes.emulators.cnc.grbl_dialect import GrblSettings
from tactile_nodes.emulators.serial_ports import PtyPort
from tactile_nodes.emulators.world import NOTHING, World, WorldSettings
from tactile_nodes.errors import ConfigurationError, DeviceNotFoundError, TactileError

S = 1_000_000_000
SURFACE_MM = -20.0


def ear() -> ReportedPlace:
    return ReportedPlace(SURFACE_MM, lambda _: None)


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


@contextlib.contextmanager
def emulated(folder: Path, *changes: str) -> Iterator[Machine]:
    """The project's Grbl at a port, as a firmware of the bench."""
    clock, world = SystemClock(), World(WorldSettings(start_mm=(-5.0, -5.0, -5.0)), table=coarse_table())
    device = Grbl(world, clock, GrblSettings(changes=changes))
    with PtyPort(device, clock, folder / 'board', reset_on_open=True) as port:
        machine = firmware.machines(arguments(grbl=[f'a Grbl={port.path.resolve()}']))[0]
        yield replace(machine, settings=replace(machine.settings, boot_s=0.3))


@pytest.fixture
def _soon_at_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    """The emulated firmware needs no seconds to come to rest and to answer."""
    module = sys.modules[Bench.__module__]
    monkeypatch.setattr(module, 'SETTLE_S', 0.3)
    monkeypatch.setattr(module, 'ASKED_S', 1.0)


@pytest.fixture
def line() -> Iterator[Line]:
    """To a program that says all that it hears."""
    program = Program('cat')
    yield Line(program, 'grbl', ear(), SystemClock())
    program.close()


@pytest.fixture
def bench(tmp_path: Path) -> Callable[..., Bench]:
    machine = firmware.machines(arguments(grbl=['A=b']))[0]
    return lambda fault, **more: Bench(machine, FAULTS[fault], SystemClock(), tmp_path, **more)


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
    place = ear()
    place.take(line, S)
    assert place.depth_mm == pytest.approx(0.5)


def test_between_two_reports_the_tip_goes_on_and_without_reports_it_rests() -> None:
    """0.1 mm deeper in 0.1 s, so 0.05 mm more 0.05 s later; and a second later where it was last heard of."""
    place = ear()
    place.take(at(-20.1), S)
    place.take(at(-20.2), S + S // 10)
    assert place.depth_at(S + 3 * S // 20) == pytest.approx(0.25)
    assert place.depth_at(2 * S) == pytest.approx(0.2)


def test_what_a_restarted_firmware_calls_zero_is_where_the_tip_stands() -> None:
    place = ear()
    place.take(at(-20.4), S)
    place.restarted()
    place.take('<Alarm|MPos:0.000,0.000,0.000|FS:0,0>', 2 * S)
    assert place.depth_mm == pytest.approx(0.4)
    place.take(at(-0.1), 3 * S)
    assert place.deepest_mm == pytest.approx(0.5)
    assert place.moved_ns == 3 * S


# The line.


def test_a_program_on_a_line_is_heard_before_the_faults_and_may_be_restarted(tmp_path: Path) -> None:
    script = tmp_path / 'firmware'
    script.write_text(f'echo "Grbl 1.1h [help]"; while read -r line; do echo "{at(-20.5)}"; done')
    place, program = ear(), Program(f'sh {script}')
    line = Line(program, 'grbl', place, SystemClock())
    line.faults.mute = True

    def deep() -> bool:
        line.receive(b'\n')
        line.run()
        return place.depth_mm == pytest.approx(0.5)

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
    machine = replace(machine, settings=replace(machine.settings, boot_s=0.3, answer_s=0.5))
    assert re.match(r'refused: no response from it at', obeys(machine, SystemClock(), tmp_path)['connect'])


def test_what_was_measured_is_kept_with_what_was_measured_before(tmp_path: Path) -> None:
    """The result of a firmware, beside that of another one, from the file that the first run has written."""
    for name in ('one', 'another'):
        given = arguments(grbl=[f'{name}=/no/such/simulator'], only=['none'], output=tmp_path)
        assert run(firmware.BENCHMARK, given) == 0
    kept = json.loads((tmp_path / 'firmware.json').read_text(encoding='utf-8'))
    assert list(kept['firmware']) == ['one', 'another']
    assert kept['command'] == "tactile bench firmware --grbl 'another=…' -o docs/results"
    assert '## another' in (tmp_path / 'firmware.md').read_text(encoding='utf-8')


# Connecting.


def test_no_hard_limits_are_refused_by_name_unless_they_are_accepted_and_an_echo_is_no_obstacle(tmp_path: Path) -> None:
    with emulated(tmp_path) as machine:
        found = connected(machine, SystemClock(), tmp_path)
    refused = "it has hard limits switched off ($21=0); switch it on, or add 'no hard limits' to the setting accept"
    assert found['connect, it says $21=0'] == f'refused: {refused}'
    assert found["connect, it says $21=0, 'no hard limits' accepted"] == 'Grbl, locked by an alarm'
    assert found['connect, all that is sent comes back'] == 'Grbl, locked by an alarm'


def test_a_board_whose_memory_has_no_hard_limits_is_refused_as_well(tmp_path: Path) -> None:
    with emulated(tmp_path, '$21=0') as machine:
        assert r'hard limits switched off ($21=0)' in obeys(machine, SystemClock(), tmp_path)['connect']


# Presses.


def test_a_firmware_that_is_silent_for_moments_comes_to_above_the_gel() -> None:
    """Half a second in two, in which it stands still and says nothing: each stops the way, and none ends it."""
    clock, world = JumpingClock(), World(WorldSettings(start_mm=(-5.0, -5.0, -5.0)), table=coarse_table())
    device = Grbl(world, clock, GrblSettings())
    settings = replace(firmware.machines(arguments(grbl=['A=b']))[0].settings, boot_s=0.2)
    cnc = GrblCnc(settings, clock, lambda: DirectPort(device, clock), threaded=False)
    cnc.connect()
    stop, stops = cnc.stop, []
    cnc.stop = lambda: stops.append(stop())  # type: ignore[method-assign,assignment]
    halves = itertools.count()
    clock.every(0.5, lambda: setattr(device.faults, 'hung', next(halves) % 4 == 0))
    approach(cnc, (-20.0, -20.0, -20.0), -19.0)
    assert stops
    assert cnc.status().position_mm == pytest.approx((-20.0, -20.0, -19.8))


LOADS = [
    ('force', 'force', 'the force is 3.57 N, above the limit of 3 N'),
    ('bearable', 'overload', 'the force is 6.07 N, more than the bearable 5 N'),
    ('torque', 'force', 'the torque is 0.250 N m, above the limit of 0.18 N m'),
    ('rise', 'force', 'the force rises by 50 N/s, above 40 N/s'),
]


@pytest.mark.parametrize(('fault', 'kind', 'reason'), LOADS)
def test_each_load_is_too_great_in_its_own_way(fault: str, kind: str, reason: str, bench: Callable[..., Bench]) -> None:
    """At 0.3 mm the gel gives (0.577·0.3)^1.5 = 0.07 N, to which 3.5 N or 6 N come; 2 N within 40 ms are 50 N/s."""
    press = bench(fault)
    safety = Safety(CollectionSettings(limits=LIMITS).watched)
    safety.watch(S, camera=False)
    safety.tare(NOTHING)
    press.reported.take(at(-20.3), S)
    for number in range(100):
        if number == 50:
            assert safety.trip is None
            press.begun_ns = S
        now_ns = S + number * S // 500
        safety.sample(Sample(press.wrench_at(now_ns), now_ns, now_ns, 0, number, 0, 0, 0, ()))
    assert safety.trip is not None
    assert (safety.trip.kind, safety.trip.reason) == (kind, reason)
    press.reported.take(at(-19.9), S)
    assert press.wrench_at(S) == NOTHING


def test_a_press_that_ends_before_its_fault_tells_nothing_of_it(bench: Callable[..., Bench]) -> None:
    press = bench('none')
    with pytest.raises(TactileError, match='before its fault: error 8'):
        require_begun(press, Outcome('error 8', 'driver'))
    press.begun_ns = S
    require_begun(press, Outcome('it is silent', 'machine'))


def test_a_press_that_a_silence_stopped_tells_nothing_of_a_load(bench: Callable[..., Bench]) -> None:
    """A busy computer silences firmware and sensor; only where a fault does is that what came of it."""
    for name, kind in [('force', SILENT_MACHINE), ('bearable', SENSOR), ('late', SILENT_MACHINE)]:
        with pytest.raises(TactileError, match='before its fault told: it is silent'):
            require_begun(bench(name, begun_ns=S), Outcome('it is silent', kind))
    for name, kind in [('late', SENSOR), ('mute', SILENT_MACHINE), ('force', FORCE)]:
        require_begun(bench(name, begun_ns=S), Outcome('it is silent', kind))


@pytest.mark.usefixtures('_soon_at_rest')
def test_too_great_a_force_stops_the_press_and_the_tip_goes_up(tmp_path: Path) -> None:
    with emulated(tmp_path) as machine:
        came = pressed(machine, FAULTS['force'], SystemClock(), tmp_path)
    assert re.fullmatch(r'the force is 3\.[5-9]\d N, above the limit of 3 N', came['said'])
    assert (came['kind'], came['up']) == ('force', 'up')
    assert 0.3 <= came['reached_mm'] < 1.0
    assert came['up_mm'] == pytest.approx(1.0, abs=0.01)


@pytest.mark.usefixtures('_soon_at_rest')
def test_when_the_commanding_process_is_killed_the_tip_goes_up_by_what_watches_over_it(tmp_path: Path) -> None:
    with emulated(tmp_path) as machine:
        came = pressed(machine, FAULTS['killed'], SystemClock(), tmp_path)
    assert 'failed' not in came, came
    assert came['said'] == 'what watches over it says 8 times $J=G21 G90 G53 Z-19.000 F600.0'
    assert came['up'] == 'up'
    assert 0.3 <= came['reached_mm'] < 1.0
    assert came['noticed_s'] < came['rest_s']


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
def test_one_line_is_damaged_on_its_way_and_no_other(fault: str, sent: bytes, arrives: bytes, line: Line) -> None:
    FAULTS[fault].begin(line)
    assert line.faults.passed('>', b'?') == b'?'
    assert arrives in line.faults.passed('>', sent)
    assert line.faults.passed('>', sent) == sent


def test_an_echo_says_all_that_is_sent_and_loses_none_of_it(line: Line) -> None:
    FAULTS['echo'].begin(line)
    assert line.faults.passed('>', b'?') == b'?'
    assert line.faults.passed('<', b'ok\r\n') == b'ok\r\n'
    assert line.take_output() == b'?'


def test_a_fault_that_kills_kills_nobody_where_nobody_is_reported_to_be_killed(line: Line) -> None:
    with pytest.raises(ConfigurationError, match='not the one to be killed'):
        FAULTS['killed'].begin(line)


@pytest.mark.parametrize(
    ('kind', 'sent', 'arrives'),
    [
        ('grbl', at(-20.4).encode() + b'\r\n', b'<Jog|MPos:0.000,0.000,0.000|FS:60,0>\r\n'),
        ('marlin', b'X:20.00 Y:20.00 Z:19.60 E:0.00\n', b'X:0.00 Y:0.00 Z:0.00 E:0.00\n'),
        ('marlin', b'ok X:20.0 Y:20.0 Z:19.6 E:0\n', b'ok X:0.00 Y:0.00 Z:0.00 E:0\n'),
    ],
)
def test_reports_of_zero_replace_the_true_ones(kind: str, sent: bytes, arrives: bytes) -> None:
    program = Program('cat')
    line = Line(program, kind, ear(), SystemClock())
    FAULTS['zero'].begin(line)
    assert line.faults.passed('<', sent) == line.faults.passed('<', sent) == arrives
    program.close()


# What is reported.


def outcome(reason: str, reached_mm: float) -> dict[str, Any]:
    times = {'noticed_s': 0.3, 'rest_s': None}
    return {'said': reason, 'kind': 'machine', 'reached_mm': reached_mm, **times, 'up': 'up', 'up_mm': 1.0}


def result(kind: str = 'grbl', **faults: dict[str, Any]) -> dict[str, Any]:
    machine = {'processor': 'P', 'cores_allowed': 2, 'load_before': [1.0]}
    about = {'kind': kind, 'sources': 'of here', 'command': 'bench', 'commit': 'c0ffee', 'machine': machine}
    return {'firmware': {'A firmware': {**about, 'obeys': {'home': '1.0 s'}, 'faults': faults}}}


def test_a_press_that_went_on_is_complained_of_and_one_that_stopped_is_not() -> None:
    found = complaints(result(none=outcome('', 2.0), mute=outcome('it is silent', 0.6), cut=outcome('', 2.0)))
    assert found == ['A firmware, nothing arrives in either direction: 2.00 mm, nothing was said']


def test_a_line_with_a_checksum_is_reported_again_so_that_the_press_goes_on() -> None:
    assert complaints(result('marlin', deeper_9=outcome('', 2.0))) == []
    assert complaints(result('grbl', deeper_9=outcome('', 2.0)))
    assert complaints(result('marlin', deeper_9=outcome('it is off its way', 1.0)))


def test_a_load_that_trips_as_another_kind_and_a_tip_that_stays_down_are_complained_of() -> None:
    overload = outcome('the force is 3.60 N', 0.6) | {'kind': 'overload'}
    left = outcome('what watches over it says', 0.6) | {'up': 'not at the safe height, 1.00 mm'}
    assert len(complaints(result(force=overload, killed=left))) == 2
    assert complaints(result(force=overload | {'kind': 'force'}, bearable=overload, killed=left | {'up': 'up'})) == []


def test_the_page_tells_what_a_run_does_then() -> None:
    force = outcome('the force is 3.60 N', 0.6) | {'kind': 'force'}
    text = page(result(force=force, bearable=force | {'kind': 'overload'}, cut=force | {'up': 'it hangs'}))
    assert '| the force is 3.60 N | up | continues, skips this press |' in text
    assert '| the force is 3.60 N | up | waits for a person |' in text
    assert '| the force is 3.60 N | it hangs | ends |' in text


def test_the_page_tells_depth_times_and_words_of_each_fault() -> None:
    text = page(result(mute=outcome('it is silent', 0.6), restart={'failed': 'no power to cut'}))
    assert '| nothing that it sends arrives | 0.60 | 0.30 | – | 1.00 | it is silent | up | ends |' in text
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
