"""The emulated Grbl against what was observed on the original firmware compiled for a PC, byte for byte."""

from __future__ import annotations

import re

import pytest
from cnc_dialogue import Dialogue

from tactile_nodes.emulators.cnc.grbl import Grbl
from tactile_nodes.emulators.cnc.grbl_dialect import GrblSettings

BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"
UNLOCK = b"[MSG:'$H'|'$X' to unlock]\r\n"
LONG = b'G1 X-50 F600\n'


def grbl(dialect: str = 'grbl', *changes: str, homed: bool = True) -> Dialogue:
    settings = GrblSettings(dialect=dialect, changes=changes)
    dialogue = Dialogue(lambda world, clock: Grbl(world, clock, settings))
    dialogue.hear()
    if homed:
        assert dialogue.say(b'$H\n', 10) == b'ok\r\n'
        dialogue.say(b'??', 0.1)  # the slow fields come with the first two reports
    return dialogue


def place(report: bytes) -> tuple[float, ...]:
    match = re.search(rb'MPos:([-\d.]+),([-\d.]+),([-\d.]+)', report)
    assert match, report
    return tuple(float(value) for value in match.groups())


def test_it_says_its_banner_and_that_it_is_locked() -> None:
    dialogue = Dialogue(Grbl)
    assert dialogue.hear() == BANNER + UNLOCK


def test_it_says_who_it_is() -> None:
    assert grbl().say(b'$I\n') == b'[VER:1.1h.20190830:]\r\n[OPT:V,15,128]\r\nok\r\n'
    assert b'[FIRMWARE:grblHAL]\r\n' in grbl('grblhal').say(b'$I\n')


def test_locked_it_refuses_code_with_error_9_and_a_jog_with_error_8() -> None:
    dialogue = grbl(homed=False)
    assert dialogue.say(b'G1 X-1 F100\n') == b'error:9\r\n'
    assert dialogue.say(b'$J=G91 X-1 F100\n') == b'error:8\r\n'


def test_real_time_bytes_are_taken_out_wherever_they_are() -> None:
    received = grbl().say(b'(a?b)G4 P0.01\n')
    assert received == b'<Idle|MPos:-1.000,-1.000,-1.000|FS:0,0>\r\nok\r\n'


def test_a_line_of_more_than_79_characters_is_refused_and_a_long_comment_is_not() -> None:
    dialogue = grbl()
    assert dialogue.say(b'G1 X-' + b'0' * 80 + b'1 F100\n') == b'error:11\r\n'
    assert dialogue.say(b'(' + b'c' * 120 + b')\n') == b'ok\r\n'


@pytest.mark.parametrize(
    ('line', 'error'),
    [
        ('G1 X', 2),
        ('1X', 1),
        ('$Z', 3),
        ('M7', 20),
        ('G2 X1 Y1 I1 J1 F100', 20),
        ('G1 X-2', 22),
        ('G1 X-1 X-2 F100', 25),
        ('G4', 28),
        ('$J=G91 X-500 F100', 15),
        ('$J=G1 X-5 F100', 16),
        ('$J=G91 X-5', 22),
    ],
)
def test_mistakes_have_their_numbers(line: str, error: int) -> None:
    assert grbl().say(line.encode() + b'\n') == f'error:{error}\r\n'.encode()


def test_ok_means_queued_and_a_dwell_is_the_barrier() -> None:
    """10 mm at 600 mm/min with 200 mm/s²: 1 s and 0.05 s for the ramps."""
    dialogue = grbl()
    assert dialogue.say(b'G1 X-11 F600\n', 0.01) == b'ok\r\n'
    begin_ns = dialogue.clock.now_ns()
    dialogue.port.write(b'G4 P0.01\n')
    assert dialogue.port.read(5.0) == b'ok\r\n'
    assert (dialogue.clock.now_ns() - begin_ns) / 1e9 == pytest.approx(1.05, abs=0.02)
    assert dialogue.tip == pytest.approx((-11, -1, -1))


def test_a_line_beyond_the_planner_waits_for_room() -> None:
    dialogue = grbl()
    lines = [b'G1 X-%d F60\n' % (2 + n) for n in range(17)]
    assert dialogue.say(b''.join(lines[:15]), 0.1).count(b'ok') == 15
    assert dialogue.say(b''.join(lines[15:]), 0.1).count(b'ok') == 0
    assert dialogue.hear(1.2).count(b'ok') == 1


def test_without_flow_control_lines_vanish_silently() -> None:
    """61 lines at once: 34 ok, no error, on the firmware; it depends on the length of the lines."""
    dialogue = grbl()
    received = dialogue.say(b''.join(b'G1X-%.1fF600\n' % (2 + n / 10) for n in range(61)), 40)
    assert b'error' not in received
    assert 20 <= received.count(b'ok') <= 40
    assert dialogue.device.overflowed > 200


def test_a_hold_a_rest_and_a_reset_keep_the_place_without_an_alarm() -> None:
    dialogue = grbl()
    dialogue.say(LONG, 0.3)
    assert dialogue.say(b'!?', 0.01).startswith(b'<Hold:1|')
    dialogue.hear(0.2)
    rest = dialogue.say(b'?')
    assert rest.startswith(b'<Hold:0|')
    assert b'FS:600,0' in rest  # as the firmware: the feed means nothing in a hold
    assert dialogue.say(b'\x18') == BANNER
    after = dialogue.say(b'?')
    assert after.startswith(b'<Idle|')
    assert place(after) == pytest.approx(place(rest), abs=0.001)
    assert dialogue.tip == pytest.approx(place(after), abs=0.001)


def test_a_reset_while_it_moves_is_alarm_3() -> None:
    dialogue = grbl()
    dialogue.say(LONG, 0.3)
    assert dialogue.say(b'\x18') == b'ALARM:3\r\n' + BANNER + UNLOCK


def test_a_soft_limit_silences_grbl_until_a_reset_and_its_ok_comes_late() -> None:
    dialogue = grbl()
    assert dialogue.say(b'G1 Z-70 F600\n') == b'ALARM:2\r\n[MSG:Reset to continue]\r\n'
    assert dialogue.say(b'?') == b''
    assert dialogue.say(b'$$\n') == b''
    assert dialogue.say(b'\x18') == b'ok\r\n' + BANNER + UNLOCK


def test_after_a_soft_limit_grblhal_still_reports_and_refuses_lines() -> None:
    dialogue = grbl('grblhal')
    assert dialogue.say(b'G1 Z-70 F600\n').startswith(b'ALARM:2\r\n')
    assert dialogue.say(b'?').startswith(b'<Alarm|')
    assert dialogue.say(b'$$\n') == b'error:79\r\n'
    assert b'GrblHAL 1.1f' in dialogue.say(b'\x18')


def test_a_jog_is_cancelled_without_an_alarm_and_later_jogs_are_forgotten() -> None:
    dialogue = grbl()
    assert dialogue.say(b'$J=G91 G21 Z-5 F600\n$J=G91 X-5 F600\n', 0.2) == b'ok\r\nok\r\n'
    assert dialogue.say(b'\x85?', 0.01).startswith(b'<Jog|')
    assert dialogue.say(b'?', 1).startswith(b'<Jog|')
    received = dialogue.say(b'?', 1)
    assert received.startswith(b'<Idle|')
    assert place(received)[0] == -1.0


@pytest.mark.parametrize(('feed', 'firmware_mm'), [(60, 0.044), (300, 0.35), (600, 0.65)])
def test_a_cancelled_jog_stops_within_the_distance_seen_on_the_firmware(feed: int, firmware_mm: float) -> None:
    """The firmware's figures hold 30 ms of a status round trip at the feed, and the braking v²/2a."""
    dialogue = grbl('grblhal')
    dialogue.say(b'$J=G91 X-50 F%d\n' % feed, 1.0)
    before = dialogue.tip[0]
    dialogue.hear(0.03)
    dialogue.say(b'\x85', 1.0)
    distance = before - dialogue.tip[0]
    speed = feed / 60
    assert distance == pytest.approx(0.03 * speed + speed**2 / 400, abs=0.002)
    assert firmware_mm / 2 < distance < firmware_mm * 2


def test_coolant_switches_the_line_when_the_motion_is_done_and_then_says_ok() -> None:
    dialogue = grbl()
    dialogue.say(b'G1 X-11 F600\n', 0.01)
    received_before = dialogue.say(b'M8\n', 0.5)
    assert (received_before, dialogue.world.line_edges()) == (b'', ())
    assert dialogue.hear(1.0) == b'ok\r\n'
    (edge,) = dialogue.world.line_edges()
    assert edge.level
    assert dialogue.world.tip_at(edge.stamp_ns)[0] == pytest.approx(-11)
    dialogue.say(b'M9\n')
    assert not dialogue.world.line_level(dialogue.clock.now_ns())


def test_while_it_homes_it_reports_nothing_and_its_ok_comes_at_the_end() -> None:
    dialogue = grbl(homed=False)
    assert dialogue.say(b'$H\n', 0.5) == b''
    assert dialogue.say(b'?', 0.1) == b''
    assert dialogue.hear(10) == b'ok\r\n'
    assert place(dialogue.say(b'?')) == (-1, -1, -1)


def test_homing_recovers_lost_steps_and_a_stuck_axis_is_alarm_9() -> None:
    dialogue = grbl()
    dialogue.world.stick(0, dialogue.clock.now_ns())
    dialogue.say(b'G1 X-20 F2000\n', 2)
    assert dialogue.tip[0] == -1.0
    assert place(dialogue.say(b'?'))[0] == -20.0  # it counts steps, not places
    dialogue.world.stick(0, dialogue.clock.now_ns(), stuck=False)
    dialogue.say(b'G1 X-30 F2000\n', 2)
    dialogue.say(b'$H\n', 10)
    assert dialogue.tip == pytest.approx((-1, -1, -1))
    dialogue.say(b'G1 X-30 F2000\n', 2)
    dialogue.world.stick(0, dialogue.clock.now_ns())
    assert dialogue.say(b'$H\n', 10).startswith(b'ALARM:9\r\n')


def test_slow_fields_come_with_every_tenth_report_at_rest_and_never_together() -> None:
    dialogue = grbl(homed=False)
    reports = [dialogue.say(b'?', 0.2) for _ in range(25)]
    assert [n for n, report in enumerate(reports) if b'WCO:' in report] == [0, 10, 20]
    assert [n for n, report in enumerate(reports) if b'Ov:' in report] == [1, 11, 21]


def test_accessories_are_reported_with_the_overrides_only() -> None:
    dialogue = grbl()
    dialogue.say(b'M8\n')
    reports = [dialogue.say(b'?', 0.2) for _ in range(20)]
    assert 0 < sum(b'A:F' in report for report in reports) == sum(b'Ov:' in report for report in reports)


def test_reports_may_be_in_inches() -> None:
    """0.6 mm were seen as 0.0236."""
    dialogue = grbl('grbl', '$13=1')
    dialogue.say(b'$J=G91 G21 X-0.6 F600\n', 1)
    received = dialogue.say(b'?')
    assert place(received)[0] == pytest.approx(-(1 + 0.6) / 25.4, abs=5e-5)


def test_a_restart_forgets_the_place() -> None:
    dialogue = grbl()
    dialogue.say(LONG, 0.5)
    dialogue.device.power_cycle()
    assert dialogue.hear() == BANNER + UNLOCK
    assert place(dialogue.say(b'?')) == (0, 0, 0)


def test_a_hung_controller_says_nothing_to_anything() -> None:
    dialogue = grbl()
    dialogue.device.faults.hung = True
    assert dialogue.say(b'?\n$I\n\x18', 2) == b''


def test_answers_can_be_late_or_swallowed() -> None:
    dialogue = grbl()
    dialogue.device.faults.delay_s = 0.5
    assert dialogue.say(b'G4 P0.01\n', 0.4) == b''
    assert dialogue.hear(0.2) == b'ok\r\n'
    dialogue.device.faults.delay_s = 0.0
    dialogue.device.faults.swallow_ok = True
    assert dialogue.say(b'G4 P0.01\n', 0.4) == b''


def test_a_limit_switch_out_of_the_blue_is_alarm_1_and_needs_a_reset() -> None:
    dialogue = grbl()
    dialogue.say(LONG, 0.5)
    dialogue.device.alarm(1)
    assert dialogue.hear() == b'ALARM:1\r\n[MSG:Reset to continue]\r\n'
    still = dialogue.tip
    assert dialogue.say(b'?', 1) == b''
    assert dialogue.tip == still
