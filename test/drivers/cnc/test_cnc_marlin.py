"""The Marlin driver: numbered lines, resends, what it may do without an emergency parser, and trouble."""

from __future__ import annotations

import contextlib
from typing import Any

import pytest
from cnc_rigs import START_NS, Rig, Script, Scripted, direct_rig, homed_rig, settings_of
from jumping_clock import JumpingClock

from benchmarks.devices import marlin
from tactile_nodes.drivers.cnc.contract import CncState
from tactile_nodes.drivers.cnc.marlin import AxisSettings, MarlinCnc, axis_settings, marlin_identity, marlin_place
from tactile_nodes.drivers.health import Level
from tactile_nodes.errors import ConfigurationError, DeviceFaultError, DeviceTimeoutError

BOOT = b'start\necho: Last Updated\nMarlin 2.1.2.7\n'
# As Marlin 2.1 reports them; 1.1 puts `echo:` before each.
SETTINGS = b"""G21    ; Units in mm (mm)
; Steps per unit:
M92 X80.00 Y80.00 Z400.00 E93.00
; Max feedrates (units/s):
M203 X300.00 Y300.00 Z5.00 E25.00
; Max Acceleration (units/s2):
M201 X3000.00 Y3000.00 Z100.00 E10000.00
; Acceleration (units/s2) (P<print-accel> R<retract-accel> T<travel-accel>):
M204 P3000.00 R3000.00 T3000.00
ok
"""
WHERE = b'X:1.00 Y:2.00 Z:3.00 E:0.00 Count X:80 Y:160 Z:1200\n'
CONNECT = [
    (b'N0 M110 N0*125\n', b'ok\n'),
    (b'N1 M115*39\n', b'FIRMWARE_NAME:Marlin 2.1.2.7 (x) UUID:1\nCap:EMERGENCY_PARSER:1\nok\n'),
    (b'N2 G21*24\n', b'ok\n'),
    (b'N3 G90*19\n', b'ok T:25.0 /0.0\n'),
    (b'N4 M220 S100*101\n', b'ok\n'),
    (b'N5 M84 S0*89\n', b'ok P15 B3\n'),
    (b'N6 M503*35\n', SETTINGS),
]


def scripted(script: Script, first: bytes = BOOT, **options: Any) -> tuple[MarlinCnc, Scripted]:
    clock = JumpingClock(START_NS)
    port = Scripted(clock, script, first)
    cnc = MarlinCnc(settings_of('marlin', report_hz=1.0, **options), clock, lambda: port, threaded=False)
    cnc.connect()
    return cnc, port


@pytest.mark.parametrize(
    ('script', 'first'),
    [
        pytest.param(CONNECT, BOOT, id='started'),
        pytest.param([(CONNECT[0][0], BOOT), *CONNECT], b'', id='starts late, the first line is lost'),
        pytest.param([(CONNECT[0][0], BOOT + b'ok\n'), *CONNECT], b'', id='starts late, the first line is kept'),
        pytest.param([CONNECT[0], (CONNECT[1][0], b'ok\n' + CONNECT[1][1]), *CONNECT[2:]], BOOT, id='an ok too many'),
    ],
)
def test_connecting_agrees_on_line_numbers_and_asks_for_capabilities(script: Script, first: bytes) -> None:
    cnc, port = scripted(script, first)
    assert port.left == []
    assert cnc.description['kind'] == 'CNC, Marlin 2.1.2.7'
    assert cnc.blind_step_mm is None


@pytest.mark.parametrize(
    'answers',
    [
        [b'Error:checksum mismatch, Last Line: 6\nResend: 7\nok\n', WHERE + b'ok\n'],  # that ok is not the line's own
        [b'Error: Checksum mismatch\nResend:7\n', b'ok X:1.0 Y:2.0 Z:3.0 E:0\n'],  # OctoPrint's virtual printer
        [WHERE + b'Error:x, Last Line: 7\nResend: 8\nok\n'],  # the line after: this one had arrived
    ],
    ids=['marlin', 'no ok after the resend', 'the line after'],
)
def test_a_line_that_arrived_damaged_is_sent_again_until_it_is_answered(answers: list[bytes]) -> None:
    cnc, port = scripted([*CONNECT, *[(b'N7 M114 R*82\n', answer) for answer in answers]])
    assert cnc.status().position_mm == (1.0, 2.0, 3.0)
    assert port.left == []


@pytest.mark.parametrize(
    ('again', 'times', 'text'),
    [
        (b'Error: Checksum mismatch\nResend:8\nok\n', 1, 'requests line 8 again, but 7'),
        (b'Error:checksum mismatch, Last Line: 6\nResend: 7\nok\n', 6, 'the line is too noisy'),
    ],
    ids=['its successor is asked for', 'never gets through'],
)
def test_a_damaged_line_that_was_not_done_is_reported(again: bytes, times: int, text: str) -> None:
    cnc, _ = scripted([*CONNECT, *[(b'N7 M114 R*82\n', again)] * times])
    with pytest.raises(DeviceFaultError, match=text):
        cnc.status()


def test_firmware_other_than_marlin_is_refused_unless_accepted() -> None:
    """The answers of a real Klipper: to M410, which it does not know, it would say ok and go on moving."""
    klipper = [CONNECT[0], (CONNECT[1][0], b'ok FIRMWARE_NAME:Klipper FIRMWARE_VERSION:v0.13.0\n'), *CONNECT[2:]]
    with pytest.raises(DeviceFaultError, match=r'runs Klipper v0\.13\.0, not Marlin: it may ignore .* M410'):
        scripted(klipper)
    cnc, port = scripted(klipper, accept=('other firmware',))
    assert (cnc.description['kind'], port.left) == ('CNC, Klipper v0.13.0', [])


def test_an_ok_after_an_unknown_command_is_no_success() -> None:
    with pytest.raises(DeviceFaultError, match="does not know 'M8'; this Marlin does not support it"):
        homed_rig(line_on='M8').cnc.set_line(True)


def test_signs_of_life_extend_the_wait() -> None:
    """Homing takes 7 s against a timeout of 3 s: the busy message every 2 s keeps it waiting."""
    rig = direct_rig('marlin', home_s=3.0)
    rig.cnc.connect()
    begin = rig.seconds()
    rig.cnc.home()
    assert rig.seconds() - begin > 5.0
    assert b'busy' in rig.received()


def test_without_an_emergency_parser_only_small_steps_are_jogged() -> None:
    rig = homed_rig('marlin without parser')
    assert rig.cnc.blind_step_mm == 0.05
    with pytest.raises(ConfigurationError, match=r'cannot stop a jog of 0.06 mm in time; jog at most 0.05 mm'):
        rig.cnc.jog(dz=-0.06, feed=60.0)
    for _ in range(4):
        rig.cnc.jog(dz=-0.05, feed=60.0)
        rig.cnc.wait_idle()
    assert rig.tip[2] == pytest.approx(rig.at(0, 0, -5.2)[2], abs=0.002)


def test_a_retract_needs_no_steps() -> None:
    rig = homed_rig('marlin without parser')
    rig.go(-60, -60, -20)
    rig.cnc.retract()
    assert rig.tip[2] == pytest.approx(rig.at(0, 0, -5)[2], abs=0.01)


def test_homing_needs_a_command_from_a_person() -> None:
    rig = direct_rig('marlin', home_command='')
    rig.cnc.connect()
    with pytest.raises(ConfigurationError, match='G28 may drive the tip into the gel'):
        rig.cnc.home()
    assert b'G28' not in rig.sent()


def test_it_answers_while_it_waits_for_the_end_of_motion() -> None:
    """5 s of motion; a question that waited with M400 would take nearly all of them."""
    rig = homed_rig()
    rig.cnc.move(x=rig.at(-10, 0, 0)[0], feed=600.0)
    begin = len(rig.traffic)
    rig.cnc.wait_idle()
    queries = [stamp_ns for way, stamp_ns, data in rig.traffic[begin:] if way == '>' and b'M114 R' in data]
    answered = [stamp_ns for way, stamp_ns, data in rig.traffic[begin:] if way == '<' and data.startswith(b'X:')]
    assert 46 <= len(queries) <= 54  # 10 a second
    assert max(b - a for a, b in zip(queries, answered, strict=True)) < 20e6
    assert b'M400' in rig.sent()


def test_after_the_computer_stood_still_it_is_asked_while_it_moves_as_before() -> None:
    """Its answer was there in time, and was read when the motion had ended."""
    rig = direct_rig('marlin')
    rig.cnc.connect()
    rig.cnc.home()
    rig.cnc.move(x=10.0, feed=600.0)
    assert rig.cnc._talk().link.wait(lambda: rig.traffic[-1][0] == '>' and b'M114 R' in rig.traffic[-1][2], 1.0)
    rig.clock.advance(2.0)
    rig.cnc.wait_idle()
    begin = len(rig.traffic)
    rig.cnc.move(x=50.0, feed=600.0)
    rig.cnc.wait_idle()
    queries = [data for way, _, data in rig.traffic[begin:] if way == '>' and b'M114 R' in data]
    assert 36 <= len(queries) <= 44  # 10 a second in 4 s


def test_where_it_was_compiled_to_know_it_tells_the_real_place() -> None:
    rig = homed_rig('marlin realtime')
    rig.cnc.move(x=rig.at(-10, 0, 0)[0], feed=600.0)
    rig.clock.advance(2.0)
    status = rig.cnc.status()
    assert status.state is CncState.RUN
    assert status.position_mm[0] == pytest.approx(rig.tip[0], abs=0.2)
    assert status.position_mm[0] < rig.at(-30, 0, 0)[0]


def silent_after(rig: Rig, within_s: float) -> float:
    """How long after it began to hang its health says so, while a wait for the end of motion goes on."""
    rig.device.faults.hung = True
    begin = rig.seconds()
    with contextlib.suppress(DeviceTimeoutError):
        rig.cnc._talk().link.wait(lambda: rig.cnc.health.level == Level.ERROR, within_s)
    assert 'silent' in rig.cnc.health.message
    return rig.seconds() - begin


def test_a_controller_that_hangs_at_rest_is_silent_after_half_a_second() -> None:
    assert silent_after(homed_rig(), 2.0) < 0.5 + 0.2 + 0.1  # with the time between two questions


def test_one_that_tells_its_place_at_rest_alone_is_silent_as_soon_after_its_first_motion() -> None:
    rig = homed_rig('marlin legacy')
    rig.cnc.move(x=rig.at(-20, 0, 0)[0], feed=600.0)
    rig.cnc.wait_idle()
    rig.cnc.move(x=rig.at(-10, 0, 0)[0], feed=600.0)
    rig.cnc._talk().link.wait(lambda: False, 0.3)
    assert rig.cnc.health.level == Level.OK
    assert silent_after(rig, 2.0) < 0.8


def test_a_marlin_that_answers_only_at_rest_is_not_called_silent_while_it_moves() -> None:
    rig = homed_rig('marlin legacy')
    rig.cnc.move(x=rig.at(-10, 0, 0)[0], feed=600.0)
    worst = Level.OK
    while rig.tip[0] < rig.at(-10, 0, 0)[0] - 0.001:
        rig.cnc._talk().link.wait(lambda: False, 0.1)
        worst = max(worst, rig.cnc.health.level)
    rig.cnc.wait_idle()
    assert worst == Level.OK


def test_many_moves_in_a_row_do_not_look_like_silence() -> None:
    """Each further one is answered when one of the sixteen before it is done."""
    rig = homed_rig()
    for number in range(24):
        rig.cnc.move(x=rig.at(-60 + (number % 2), 0, 0)[0], feed=60.0)
        assert rig.cnc.health.level == Level.OK
    rig.cnc.wait_idle()


def test_a_halted_controller_is_reported() -> None:
    rig = homed_rig()
    rig.port.write(b'M112\n')
    with pytest.raises(DeviceFaultError, match='halted'):
        rig.cnc.move(z=rig.at(0, 0, -6)[2], feed=600.0)
        rig.cnc.wait_idle()
    with pytest.raises(DeviceFaultError, match='halted itself'):
        rig.cnc.move(z=rig.at(0, 0, -6)[2], feed=600.0)
    assert rig.cnc.health.level == Level.ERROR


def test_a_hung_controller_is_reported_in_time() -> None:
    rig = homed_rig()
    rig.device.faults.hung = True
    begin = rig.seconds()
    with pytest.raises(DeviceTimeoutError, match='it hangs: switch it off and on'):
        rig.cnc.move(z=rig.at(0, 0, -6)[2], feed=600.0)
    assert rig.seconds() - begin < 6.0


def test_a_question_behind_a_stop_that_takes_long_is_answered_after_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """A native build took 3.0 to 4.4 s for M410. Who sends it waits 10 s; others wait 2 s for answers of their own."""
    rig = homed_rig()
    monkeypatch.setattr(marlin, 'CLEANING_NS', 4_000_000_000)
    rig.cnc._talk().brake('is to stop')
    begin = rig.seconds()
    assert rig.cnc.status().homed
    assert rig.seconds() - begin == pytest.approx(4.0, abs=0.3)


def test_a_stop_that_is_never_answered_ends_the_wait_of_who_is_behind_it() -> None:
    rig = homed_rig()
    rig.device.faults.hung = True
    rig.cnc._talk().brake('is to stop')
    begin = rig.seconds()
    with pytest.raises(DeviceTimeoutError, match='it hangs: switch it off and on'):
        rig.cnc.status()
    assert rig.seconds() - begin < 10.0 + 2.5


def test_nothing_but_a_dialogue_of_numbered_lines_is_sent() -> None:
    rig = homed_rig()
    rig.cnc.set_line(True)
    rig.cnc.stop()
    lines = rig.sent().split(b'\n')
    assert all(line.startswith(b'N') for line in lines if line not in {b'', b'M410'})


def test_capabilities_and_places_are_read() -> None:
    identity = marlin_identity(['FIRMWARE_NAME:Marlin bugfix-2.1.x (Jan 1 2026) X', 'Cap:EEPROM:1', 'noise'])
    assert (identity.version, identity.options) == ('bugfix-2.1.x', ('EEPROM:1',))
    assert marlin_place('X:-1.50 Y:0.00 Z:60.00 E:0.00 Count X:0') == (-1.5, 0.0, 60.0)
    prusa = marlin_identity(['FIRMWARE_NAME:Prusa-Firmware 3.14.1 based on Marlin FIRMWARE_URL:https://example.org'])
    assert (prusa.firmware, prusa.version) == ('Prusa-Firmware 3.14.1 based on', 'Marlin')
    assert marlin_identity(['FIRMWARE_NAME:Teacup']).firmware == 'Teacup'
    assert marlin_identity(['FIRMWARE_NAME:Virtual Marlin 1.0 PROTOCOL_VERSION:1.0']).version == '1.0'
    assert marlin_place('T:25.0 /0.0') is None


@pytest.mark.parametrize('z', ['6..00', '6.0.0', '.', '-', 'nan'])
def test_place_that_was_damaged_on_the_line_is_none(z: str) -> None:
    """An error that nobody expects would end the thread that stops the machine."""
    assert marlin_place(f'X:-1.50 Y:0.00 Z:{z}') is None


@pytest.mark.parametrize('before', ['', '  ', 'echo:  '])
def test_settings_of_the_axes_are_read_as_marlin_reports_them(before: str) -> None:
    settings = axis_settings([before + line for line in SETTINGS.decode().splitlines()])
    assert settings == AxisSettings((80.0, 80.0, 400.0), (300.0, 300.0, 5.0), 100.0)
    assert settings.steps((0.05, 0.0, -0.05)) == 20


@pytest.mark.parametrize('lines', [[], ['echo:Unknown command: "M503"'], ['M203 X0.00 Y300.00 Z5.00']])
def test_settings_that_are_not_reported_are_not_known(lines: list[str]) -> None:
    settings = axis_settings(lines)
    assert (settings.steps((1.0, 0.0, 0.0)), settings.tells_times) == (None, False)


@pytest.mark.parametrize('kind', ['marlin', 'marlin without M503', 'marlin legacy'])
def test_a_move_that_is_sent_faster_than_an_axis_goes_does_not_look_like_silence(kind: str) -> None:
    """40 mm at 2000 mm/min would be 1.2 s; z goes 20 mm/s at most."""
    rig = homed_rig(kind)
    rig.go(-60, -60, -50, feed=2000.0)
    rig.cnc.move(z=rig.at(0, 0, -10)[2], feed=2000.0)
    rig.cnc._talk().link.wait(lambda: False, 1.3)
    assert rig.cnc.health.level == Level.OK
    rig.cnc.wait_idle()
    assert rig.cnc.health.level == Level.OK
    assert rig.tip[2] == pytest.approx(rig.at(0, 0, -10)[2])
