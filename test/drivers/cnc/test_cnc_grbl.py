"""The Grbl driver: its dialogue byte for byte, and what it does when things go wrong."""

from __future__ import annotations

import contextlib
import random
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from cnc_rigs import START_NS, Rig, Script, Scripted, direct_rig, homed_rig, pty_rig, settings_of
from jumping_clock import JumpingClock

from tactile_nodes.drivers.cnc.contract import NO_HOMING, NO_SOFT_LIMITS, CncSettings, CncState
from tactile_nodes.drivers.cnc.grbl import GrblCnc
from tactile_nodes.drivers.cnc.grbl_words import parse_report
from tactile_nodes.drivers.cnc.opening import open_cnc
from tactile_nodes.drivers.health import Level
from tactile_nodes.errors import (
    ConfigurationError,
    DeviceBusyError,
    DeviceError,
    DeviceFaultError,
    DeviceLostError,
    DeviceTimeoutError,
)

BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"
UNLOCK = b"[MSG:'$H'|'$X' to unlock]\r\n"
IDENTITY = b'[VER:1.1h.20190830:]\r\n[OPT:V,15,128]\r\nok\r\n'
SETTINGS = (
    b'$1=255\r\n$10=1\r\n$13=0\r\n$20=1\r\n$21=1\r\n$22=1\r\n$32=0\r\n$120=200.000\r\n$121=200.000\r\n'
    b'$122=200.000\r\n$130=120.000\r\n$131=120.000\r\n$132=60.000\r\nok\r\n'
)
IDLE = b'<Idle|MPos:-1.000,-1.000,-1.000|FS:0,0>\r\n'
PREAMBLE = (b'G21 G90 G94 G17 G54\n', b'ok\r\n')
CONNECT = [
    (b'$I\n', IDENTITY),
    (b'?', b'<Alarm|MPos:0.000,0.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>\r\n'),
    (b'$$\n', SETTINGS),
]
HOME = [(b'$H\n', b'ok\r\n'), PREAMBLE, (b'?', IDLE)]


def play(script: Script, act: Callable[[GrblCnc], object], first: bytes = BANNER + UNLOCK, **settings: Any) -> GrblCnc:
    """Connect by a transcript, act, and see that all of it was said."""
    clock = JumpingClock(START_NS)
    port = Scripted(clock, script, first)
    cnc = GrblCnc(settings_of('grbl', **settings), clock, lambda: port, threaded=False)
    cnc.connect()
    act(cnc)
    assert port.left == []
    return cnc


def nothing(cnc: GrblCnc) -> None:
    """Connecting is enough."""


@pytest.fixture
def rig() -> Rig:
    """Homed, over the middle of the gel at the safe height."""
    return homed_rig('grbl')


def test_a_move_that_is_sent_faster_than_an_axis_goes_is_waited_for() -> None:
    """500 mm/min is Grbl's own default: 40 mm at 2000 mm/min would be 1.2 s, and are 4.8 s."""
    rig = homed_rig('grbl', changes=('$112=500',))
    rig.go(-60, -60, -45)
    assert rig.tip[2] == pytest.approx(-45.0)


# Transcripts.


def test_connecting_asks_who_where_and_how_and_changes_nothing() -> None:
    cnc = play(CONNECT, nothing)
    assert cnc.description['kind'] == 'CNC, Grbl 1.1h.20190830'
    assert cnc.limits.lowest_mm == (-120.0, -120.0, -60.0)
    assert cnc.description['$130'] == '120.000'


def test_a_controller_that_shows_no_banner_is_asked_with_a_line_that_can_move_nothing() -> None:
    greeting = [(b'$\n', b'[HLP:$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x]\r\nok\r\n')]
    play(greeting + CONNECT, nothing, first=b'')


def test_what_another_host_left_half_sent_is_spoilt_and_not_done() -> None:
    play([(b'$\n', b'error:1\r\n'), *CONNECT], nothing, first=b'')


def test_homing_a_move_and_the_barrier() -> None:
    def act(cnc: GrblCnc) -> None:
        cnc.home()
        cnc.move(z=-1.04, feed=600.0)
        cnc.wait_idle()

    there = b'<Idle|MPos:-1.000,-1.000,-1.040|FS:0,0>\r\n'
    motion = [
        (b'G21 G90 G53 G1 X-1.000 Y-1.000 Z-1.040 F600.0\n', b'ok\r\n'),
        (b'G4 P0.01\n', b'ok\r\n'),
        (b'?', there),
    ]
    play(CONNECT + HOME + motion, act)


TO_STOP = [*CONNECT, *HOME, (b'G21 G90 G53 G1 X-1.000 Y-1.000 Z-4.000 F600.0\n', b'ok\r\n'), (b'!', b'')]


def stopped(cnc: GrblCnc) -> None:
    cnc.home()
    cnc.move(z=-4.0, feed=600.0)
    cnc.stop()


def stopped_and_homed(cnc: GrblCnc) -> None:
    stopped(cnc)
    assert cnc.status().homed


def test_a_clean_stop_holds_waits_for_rest_resets_and_sets_the_modes_again() -> None:
    script = [
        (b'?', b'<Hold:1|MPos:-1.000,-1.000,-1.020|FS:600,0>\r\n'),
        (b'?', b'<Hold:0|MPos:-1.000,-1.000,-1.030|FS:600,0>\r\n'),
        (b'\x18', BANNER),
        (b'?', b'<Idle|MPos:-1.000,-1.000,-1.030|FS:0,0|WCO:0.000,0.000,0.000>\r\n'),
        PREAMBLE,
        (b'?', b'<Idle|MPos:-1.000,-1.000,-1.030|FS:0,0>\r\n'),
    ]
    play(TO_STOP + script, stopped_and_homed)


def test_a_stopped_jog_is_cancelled_and_not_reset() -> None:
    def act(cnc: GrblCnc) -> None:
        cnc.home()
        cnc.jog(dz=-2.0, feed=60.0)
        cnc.stop()
        assert cnc.status().homed

    jogging = b'<Jog|MPos:-1.000,-1.000,-1.010|FS:20,0>\r\n'
    resting = b'<Idle|MPos:-1.000,-1.000,-1.012|FS:0,0>\r\n'
    script = [
        (b'$J=G21 G90 G53 X-1.000 Y-1.000 Z-3.000 F60.0\n', b'ok\r\n'),
        (b'\x85', b''),
        (b'?', jogging),
        (b'\x85', b''),
        (b'?', resting),
        (b'?', resting),
        PREAMBLE,
        (b'?', resting),
    ]
    play(CONNECT + HOME + script, act)


def test_a_stop_that_ends_in_alarm_3_has_lost_the_place() -> None:
    def act(cnc: GrblCnc) -> None:
        stopped(cnc)
        assert not cnc.status().homed
        with pytest.raises(DeviceFaultError, match='alarm 3, a reset while it moved'):
            cnc.move(z=-3.0, feed=100.0)

    moving = b'<Run|MPos:-1.000,-1.000,-1.020|FS:600,0>\r\n'
    locked = b'<Alarm|MPos:-1.000,-1.000,-1.030|FS:0,0>\r\n'
    clock_polls: Script = [(b'?', moving)] * 60  # 3 s at a question each 50 ms: it never rests
    lost = [(b'\x18', b'ALARM:3\r\n' + BANNER + UNLOCK), (b'?', locked), (b'?', locked)]
    play(TO_STOP + clock_polls + lost, act)


def test_a_reset_whose_banner_is_not_known_is_seen_by_the_next_report() -> None:
    """FluidNC's start message is a setting of its owner."""
    rest = b'<Idle|MPos:-1.000,-1.000,-1.030|FS:0,0>\r\n'
    script = [
        (b'?', b'<Hold:0|MPos:-1.000,-1.000,-1.030|FS:600,0>\r\n'),
        (b'\x18', b'\r\nWelcome to the workshop\r\n'),
        *[(b'?', rest)] * (30 + 2),  # 10 a second for the 3 s that a banner may take; the sign of life; where it is
        PREAMBLE,
        (b'?', rest),
    ]
    play(TO_STOP + script, stopped_and_homed)


def test_a_lock_that_asks_for_homing_does_not_break_homing_off() -> None:
    """grblHAL's alarm 11 after a start."""
    locked = [(b'$H\n', b'ALARM:11\r\nok\r\n'), *HOME[1:]]
    play(CONNECT + locked, lambda cnc: cnc.home())


def test_messages_of_any_kind_are_no_answers() -> None:
    """A startup line's :ok or error, FluidNC's [MSG:INFO], settings with comments; the ok is still the line's."""
    noise = b'>G54:ok\r\n[MSG:INFO: Connecting]\r\n' + b'$0=10 (step pulse, usec)\r\nnonsense\r\n'
    script = [CONNECT[0], CONNECT[1], (b'$$\n', noise + SETTINGS)]
    started = BANNER + b'>G54G20:ok\r\n>G21:error:9\r\n' + UNLOCK
    assert play(script, nothing, first=started).limits.highest_mm == (0.0, 0.0, 0.0)


def test_inches_are_converted() -> None:
    """0.6 mm were seen reported as 0.0236."""

    def act(cnc: GrblCnc) -> None:
        cnc.home()
        assert cnc.status().position_mm[2] == pytest.approx(-0.6, abs=0.002)

    where = (b'?', b'<Idle|MPos:-0.0394,-0.0394,-0.0236|FS:0,0>\r\n')
    inches = SETTINGS.replace(b'$13=0', b'$13=1')
    play([*CONNECT[:2], (b'$$\n', inches), *HOME[:2], where, where], act)


def test_a_grbl_from_before_1_1_is_refused_by_its_age() -> None:
    """Its reports have commas, and it knows no jogs."""
    old = b'<Idle,MPos:0.000,0.000,0.000,WPos:0.000,0.000,0.000>\r\n'
    script: Script = [(b'$I\n', b'[0.9j.20160303:]\r\nok\r\n'), *[(b'?', old)] * 40]
    with pytest.raises(DeviceTimeoutError, match=r'older than Grbl 1\.1 is not supported'):
        play(script, nothing, first=b"\r\nGrbl 0.9j ['$' for help]\r\n")


FLUIDNC_BANNER = b"\r\nGrbl 3.6 [FluidNC v3.6.5-pre2 (wifi) '$' for help]\r\n"
BOX: dict[str, Any] = {'lowest_mm': (-100.0, -100.0, -40.0), 'highest_mm': (0.0, 0.0, 0.0)}


def fluidnc(**differs: bytes) -> Script:
    """What a FluidNC says of itself, each setting as its RuntimeSetting.cpp writes it."""
    script: Script = [
        (b'$I\n', b'[VER:3.6 FluidNC v3.6.5-pre2:]\r\n[OPT:MPHS]\r\nok\r\n'),
        (b'?', IDLE),
        (b'$$\n', b'$10=1\r\n$20=1\r\n$21=1\r\n$22=1\r\n$32=0\r\n$130=300.000\r\nok\r\n'),
        (b'$/stepping/idle_ms\n', b'$/stepping/idle_ms=255\r\nok\r\n'),
    ]
    for key, value in (('soft_limits', b'true'), ('motor0/hard_limits', b'true'), ('homing/cycle', b'1')):
        for axis in 'xyz':
            name = f'$/axes/{axis}/{key}'
            answer = f'{name}='.encode() + value + b'\r\nok\r\n'
            script.append((f'{name}\n'.encode(), differs.get(f'{axis}_{key.replace("/", "_")}', answer)))
    return script


def test_fluidnc_is_known_by_its_answer_and_must_be_given_its_box() -> None:
    """Where its $130 begin depends on its configuration file."""
    with pytest.raises(ConfigurationError, match='does not report its limits; set lowest_mm'):
        play(fluidnc(), nothing, first=FLUIDNC_BANNER)
    cnc = play([*fluidnc(), PREAMBLE], nothing, first=FLUIDNC_BANNER, **BOX)
    assert cnc.description['kind'].startswith('CNC, FluidNC ')
    assert cnc.limits.lowest_mm == (-100.0, -100.0, -40.0)
    assert cnc.description['notes'] == ''


def test_a_fluidnc_that_reports_after_its_banner_that_it_is_not_homed_is_connected() -> None:
    """Its alarm 14 comes some milliseconds after the banner, so during the first question (Protocol.cpp)."""
    (question, answer), *rest = fluidnc()
    late = (question, b'[MSG:INFO: ALARM: Unhomed]\r\nALARM:14\r\n' + answer)
    locked = (b'?', IDLE.replace(b'Idle', b'Alarm'))
    early = FLUIDNC_BANNER + b'[MSG:INFO: ALARM: Unhomed]\r\nALARM:14\r\n'
    for script, first in (
        ([late, locked, *rest[1:]], FLUIDNC_BANNER),
        ([(question, answer), locked, *rest[1:]], early),
    ):
        cnc = play(script, nothing, first=first, **BOX)
        assert cnc.health.level is Level.WARN, 'an error would end a run before it homes'
        assert 'not homed' in cnc.health.message


@pytest.mark.parametrize(
    ('differs', 'guard'),
    [
        ({'z_soft_limits': b'$/axes/z/soft_limits=false\r\nok\r\n'}, 'soft limits .*soft_limits of every axis'),
        ({'z_motor0_hard_limits': b'$/axes/z/motor0/hard_limits=false\r\nok\r\n'}, 'hard limits .*hard_limits of ev'),
        ({'y_homing_cycle': b'error:3\r\n'}, 'homing .*homing/cycle of every axis'),
        ({'y_homing_cycle': b'$/axes/y/homing/cycle=-1\r\nok\r\n'}, 'homing .*homing/cycle of every axis'),
    ],
)  # fmt: skip
def test_one_unguarded_axis_of_a_fluidnc_is_refused(differs: dict[str, bytes], guard: str) -> None:
    """Its own $20 speaks of the x axis alone, its $21 of any motor: both say 1 here."""
    with pytest.raises(DeviceFaultError, match=guard):
        play(fluidnc(**differs), nothing, first=FLUIDNC_BANNER, **BOX)


@pytest.mark.parametrize(
    ('line', 'state', 'held', 'place'),
    [
        ('<Idle|MPos:1.000,2.000,3.000|FS:0,0>', CncState.IDLE, False, (1.0, 2.0, 3.0)),
        ('<Hold:0|MPos:-3.830,-1.000,-2.984|Bf:15,128|FS:600,0|Ov:100,100,100|A:SFM>', CncState.HOLD, True,
         (-3.83, -1.0, -2.984)),
        ('<Hold:1|MPos:0,0,0>', CncState.HOLD, False, (0.0, 0.0, 0.0)),
        ('<Door:0|MPos:0,0,0,5,6|Pn:XYZPDHRS>', CncState.OTHER, False, (0.0, 0.0, 0.0)),
        ('<Tool|MPos:0,0,0|TLR:0|FW:grblHAL>', CncState.OTHER, False, (0.0, 0.0, 0.0)),
    ],
)  # fmt: skip
def test_reports_are_understood(line: str, state: CncState, held: bool, place: tuple) -> None:
    report = parse_report(line)
    assert report is not None
    assert (report.state, report.held, report.machine) == (state, held, place)


@pytest.mark.parametrize(
    'line',
    [
        '<>', '<Idle>', '<Idle|MPos:1,2>', '<Idle|MPos:a,b,c>', '<Idle|FS:0,0>', 'Idle', '<Idl',
        '<Idle|MPos:0,0,nan>', '<Idle|WPos:0,inf,0>', '<Idle|MPos:0,0,0|WCO:0,0,nan>',
    ],
)  # fmt: skip
def test_damaged_reports_are_none(line: str) -> None:
    assert parse_report(line) is None


# What it refuses.


@pytest.mark.parametrize(
    ('change', 'text'),
    [
        ('$20=0', r'soft limits switched off \(\$20=0\); switch it on'),
        (
            '$21=0',
            r"hard limits switched off \(\$21=0\); switch it on, or add 'no hard limits' to the setting accept",
        ),
        ('$22=0', r'homing switched off \(\$22=0\)'),
        ('$32=1', r'laser or lathe mode \(\$32=1\)'),
    ],
)
def test_dangerous_settings_are_refused(change: str, text: str) -> None:
    rig = direct_rig('grbl', changes=(change,))
    with pytest.raises(DeviceFaultError, match=text):
        rig.cnc.connect()


def test_risks_can_be_accepted_in_words_only() -> None:
    box = {'lowest_mm': (-60.0, -60.0, -55.0), 'highest_mm': (60.0, 60.0, 0.0)}
    rig = homed_rig('grbl', changes=('$20=0', '$22=0'), accept=(NO_SOFT_LIMITS, NO_HOMING), **box)
    assert rig.cnc.health.level == Level.WARN
    assert b'$H' not in rig.sent()
    with pytest.raises(
        ValueError,
        match=r"accept may contain 'no soft limits', .*'other firmware', not yes",
    ):
        CncSettings(accept=('yes',))


def test_motors_that_let_go_are_a_warning() -> None:
    rig = homed_rig('grbl', changes=('$1=25',))
    assert 'motors are released at rest' in rig.cnc.health.message
    assert rig.cnc.health.level == Level.WARN


def test_the_smaller_of_both_boxes_counts() -> None:
    rig = homed_rig('grbl', lowest_mm=(-500.0, -80.0, -33.0), highest_mm=(0.0, 0.0, 0.0))
    assert rig.cnc.limits.lowest_mm == (-120.0, -80.0, -33.0)


def test_a_safe_height_outside_the_box_is_refused() -> None:
    rig = direct_rig('grbl', safe_z_mm=5.0)
    with pytest.raises(ConfigurationError, match='safe_z_mm is 5, outside'):
        rig.cnc.connect()


@pytest.mark.parametrize('identity', [IDENTITY, b'error:8\r\n'], ids=['reported', 'reported at rest alone'])
def test_a_busy_machine_is_refused(identity: bytes) -> None:
    """Grbl 1.1h says who it is at rest alone (system.c, `system_execute_line`)."""
    with pytest.raises(DeviceFaultError, match='is busy'):
        play([(b'$I\n', identity), (b'?', b'<Run|MPos:0,0,0|FS:1,0>\r\n')], nothing)


@pytest.mark.parametrize('command', ['M8 ?', 'M8!', 'M8 ~', 'M8\n', 'M8é', 'M' * 80])
def test_a_line_that_would_act_at_once_or_not_fit_is_not_sent(rig: Rig, command: str) -> None:
    strange = homed_rig('grbl', line_on=command)
    with pytest.raises(ConfigurationError, match='cannot send'):
        strange.cnc.set_line(True)


def test_an_output_that_the_board_lacks_is_reported(rig: Rig) -> None:
    with pytest.raises(DeviceFaultError, match=r"refused 'M7': error 20, an unsupported command"):
        homed_rig('grbl', line_on='M7').cnc.set_line(True)


# What goes wrong.


def test_a_whole_day_of_trouble_writes_no_setting_and_never_unlocks(rig: Rig) -> None:
    rig.cnc.move(z=-20.0, feed=600.0)
    rig.device.alarm(1)
    with pytest.raises(DeviceFaultError):
        rig.cnc.wait_idle()
    rig.cnc.stop()
    rig.cnc.home()
    rig.device.power_cycle()
    with pytest.raises(DeviceFaultError):
        rig.cnc.move(z=-3.0, feed=600.0)
        rig.cnc.wait_idle()
    rig.cnc.home()
    rig.cnc.retract()
    assert not re.search(rb'\$\d+=', rig.sent())
    assert b'$X' not in rig.sent()
    assert b'=' not in rig.sent().replace(b'$J=', b'')


def test_an_alarm_breaks_off_who_waits_and_nothing_moves_until_it_is_homed(rig: Rig) -> None:
    rig.cnc.move(z=-20.0, feed=600.0)
    rig.device.alarm(1)
    with pytest.raises(DeviceFaultError, match='alarm 1, a limit switch was hit'):
        rig.cnc.wait_idle()
    still = rig.tip
    for call in (lambda: rig.cnc.move(z=-3.0, feed=100.0), rig.cnc.retract, lambda: rig.cnc.jog(dz=1.0, feed=100.0)):
        with pytest.raises(DeviceFaultError, match=r'alarm 1.* home it'):
            call()
    assert rig.tip == still
    assert rig.cnc.health.level == Level.ERROR
    rig.cnc.home()
    rig.go(-50, -50, -5)
    assert rig.cnc.health.level == Level.OK


def test_a_soft_limit_of_the_firmware_ends_in_homing_again() -> None:
    """The box is wider than the machine's own, which the firmware then finds."""
    rig = homed_rig('grbl')
    rig.device.machine.memory[132] = '20.000'
    with pytest.raises(DeviceFaultError, match='alarm 2, a target beyond the soft limits'):
        rig.cnc.move(z=-30.0, feed=600.0)
        rig.cnc.wait_idle()
    rig.cnc.home()
    assert rig.cnc.status().homed


def test_a_hung_controller_is_reported_in_time_and_nothing_more_is_sent(rig: Rig) -> None:
    rig.device.faults.hung = True
    begin = rig.seconds()
    with pytest.raises(DeviceFaultError, match=r'was aborted, because the machine is silent while it moves'):
        rig.cnc.move(z=-6.0, feed=600.0)
    assert rig.seconds() - begin < 0.6
    sent_bytes = len(rig.sent())
    with pytest.raises(DeviceFaultError, match='is silent while it moves; check its cable and power'):
        rig.cnc.move(z=-7.0, feed=600.0)
    assert len(rig.sent()) == sent_bytes


def test_the_stop_of_a_jog_that_a_hung_controller_makes_is_given_up_in_time(rig: Rig) -> None:
    rig.cnc.jog(dz=-1.0, feed=30.0)
    rig.device.faults.hung = True
    begin = rig.seconds()
    with pytest.raises(DeviceError):
        rig.cnc.stop()
    # REST_S for the cancel, REST_S for the hold, RESET_S for the reset, and a report asked for in each.
    assert rig.seconds() - begin < 15.0
    assert b'\x85' in rig.sent()


def test_a_missing_ok_is_no_endless_wait(rig: Rig) -> None:
    rig.device.faults.swallow_ok = True
    with pytest.raises(DeviceTimeoutError):
        rig.cnc.move(z=-6.0, feed=600.0)
    rig.device.faults.swallow_ok = False
    rig.cnc.stop()
    rig.cnc.home()
    rig.go(-60, -60, -5)
    assert rig.cnc.status().homed


def test_late_answers_are_waited_for(rig: Rig) -> None:
    rig.device.faults.delay_s = 0.3
    rig.go(-60, -60, -8)
    assert rig.tip[2] == pytest.approx(-8)


def test_noise_is_counted_and_survived(rig: Rig) -> None:
    for seed in range(20):
        rig.device.say(random.Random(seed).randbytes(30) + b'\n')
        with contextlib.suppress(DeviceTimeoutError):
            rig.cnc.status()
    rig.go(-60, -60, -8)
    assert rig.tip[2] == pytest.approx(-8)


def test_lines_lost_on_the_way_are_found_at_the_next_rest() -> None:
    """A move that the controller never made: its ok came, its motion did not."""
    rig = homed_rig('grbl')
    rig.cnc.move(z=-10.0, feed=600.0)
    rig.device.machine.planner.flush(rig.clock.now_ns())
    with pytest.raises(DeviceFaultError, match=r'stopped at .* instead of .*z -10\.000 mm'):
        rig.cnc.wait_idle()


def test_a_stuck_axis_is_not_seen_by_grbl_but_in_the_world(rig: Rig) -> None:
    """Steps are counted, not places: that is why force is watched independently."""
    rig.world.stick(2, rig.clock.now_ns())
    rig.cnc.move(z=-20.0, feed=600.0)
    rig.cnc.wait_idle()
    assert rig.cnc.status().position_mm[2] == pytest.approx(-20.0)
    assert rig.tip[2] == pytest.approx(-5.0)


def test_homing_that_finds_no_switch_is_reported(rig: Rig) -> None:
    rig.world.stick(0, rig.clock.now_ns())
    with pytest.raises(DeviceFaultError, match='alarm 9, no limit switch was found'):
        rig.cnc.home()
    assert not rig.cnc.status().homed


@pytest.mark.parametrize('kind', ['grbl', 'grblhal'])
def test_many_short_moves_lose_nothing(kind: str) -> None:
    rig = homed_rig(kind)
    for number in range(100):
        rig.cnc.move(x=-60 + 0.1 * (number + 1), feed=600.0)
    rig.cnc.wait_idle()
    assert rig.tip[0] == pytest.approx(-50.0)
    assert rig.device.overflowed == 0


def test_reports_are_asked_for_ten_times_a_second_while_it_moves_and_five_times_at_rest(rig: Rig) -> None:
    before = rig.sent().count(b'?')
    rig.cnc.move(x=-20.0, feed=600.0)
    rig.cnc.wait_idle()
    moved = rig.sent().count(b'?')
    assert moved - before == pytest.approx(4.05 * 10, abs=3)
    rig.cnc._talk().link.wait(lambda: False, 4.0)
    assert rig.sent().count(b'?') - moved == pytest.approx(4 * 5, abs=2)


# Through the operating system.


def test_an_unplugged_machine_is_lost_at_once_and_can_be_connected_again(tmp_path: Path) -> None:
    with pty_rig('grbl', tmp_path) as rig:
        rig.cnc.home()
        rig.cnc.move(x=-30.0, feed=600.0)
        rig.port.unplug()
        with pytest.raises(DeviceLostError, match='is gone'):  # and no DeviceTimeoutError, as of one that hangs
            rig.cnc.wait_idle()
        assert rig.cnc.health.level == Level.ERROR
        rig.cnc.close()
        rig.port.plug()
        rig.cnc.connect()
        assert not rig.cnc.status().homed


def test_a_machine_that_is_unplugged_as_a_line_is_sent_is_lost(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    def gone(data: bytes) -> None:
        raise DeviceLostError('the port is gone')

    monkeypatch.setattr(rig.port, 'write', gone)
    with pytest.raises(DeviceLostError, match='the port is gone'):
        rig.cnc.move(z=rig.at(0, 0, -6)[2], feed=600.0)
    assert rig.cnc.health.level == Level.ERROR


@pytest.mark.parametrize('dtr', ['pulse', 'low', 'untouched'])
def test_every_policy_for_the_reset_line_opens_a_port(dtr: str, tmp_path: Path) -> None:
    with pty_rig('grbl', tmp_path, dtr=dtr) as rig:
        assert rig.cnc.status().state is CncState.ALARM


def test_a_board_that_does_not_restart_on_opening_is_found_without_its_banner(tmp_path: Path) -> None:
    with pty_rig('grbl', tmp_path, boot_s=0.3) as rig:
        rig.cnc.close()
        rig.port.reset_on_open = False
        rig.cnc.connect()
        assert rig.cnc.description['kind'].startswith('CNC, Grbl ')


def test_a_port_is_held_by_one_program(tmp_path: Path) -> None:
    with pty_rig('grbl', tmp_path) as rig:
        other = settings_of('grbl', source=str(rig.port.path))
        with pytest.raises(DeviceBusyError, match=r'in use by another program'):
            open_cnc(other, rig.clock)


def test_reports_keep_coming_while_nobody_asks(tmp_path: Path) -> None:
    with pty_rig('grbl', tmp_path, silent_s=0.3) as rig:
        rig.device.faults.hung = True
        deadline = time.monotonic() + 60
        while rig.cnc.health.level != Level.ERROR and time.monotonic() < deadline:
            time.sleep(0.02)
        assert 'silent' in rig.cnc.health.message
