"""The emulated Marlin against what was observed on Marlin 2.1.2.7's own code."""

from __future__ import annotations

import pytest
from cnc_dialogue import Dialogue

from benchmarks.devices.marlin import Marlin, MarlinSettings, xor


def marlin(emergency_parser: bool = True, homed: bool = True) -> Dialogue:
    settings = MarlinSettings(emergency_parser=emergency_parser)
    dialogue = Dialogue(lambda world, clock: Marlin(world, clock, settings))
    dialogue.hear()
    if homed:
        dialogue.say(b'G28\n', 20)
    return dialogue


def numbered(number: int, command: str) -> bytes:
    text = f'N{number} {command}'
    return f'{text}*{xor(text)}\n'.encode()


def test_it_says_start_when_it_gets_power() -> None:
    received = Dialogue(Marlin).hear()
    assert received.startswith(b'start\n')
    assert b'Marlin 2.1.2.7\n' in received


def test_the_checksum_is_the_exclusive_or_of_all_characters() -> None:
    """From Marlin's documentation of checksums: N3 T0*57."""
    assert xor('N3 T0') == 57


def test_an_unknown_command_is_reported_and_still_ok() -> None:
    assert marlin().say(b'M8\n') == b'echo:Unknown command: "M8"\nok\n'


def test_it_tells_its_capabilities() -> None:
    assert b'Cap:EMERGENCY_PARSER:0\n' in marlin(emergency_parser=False).say(b'M115\n')


def test_a_position_is_the_target_while_the_count_is_where_it_is() -> None:
    received = marlin().say(b'G1 X10 F600\nM114\n', 0.01)
    assert received == b'ok\nX:10.00 Y:0.00 Z:60.00 E:0.00 Count X:0 Y:0 Z:24000\nok\n'


def test_a_dwell_is_in_milliseconds() -> None:
    dialogue = marlin()
    assert dialogue.say(b'G4 P500\n', 0.4) == b''
    assert dialogue.hear(0.2) == b'ok\n'


def test_waiting_for_the_end_of_motion_tells_every_two_seconds_that_it_is_busy() -> None:
    """50 mm at 600 mm/min: 5.05 s."""
    dialogue = marlin()
    received = dialogue.say(b'G1 X50 F600\nM400\n', 6)
    assert received == b'ok\n' + 2 * b'echo:busy: processing\n' + b'ok\n'
    assert dialogue.tip[0] == pytest.approx(-70)


def test_a_wrong_checksum_or_number_is_asked_for_again() -> None:
    dialogue = marlin()
    assert dialogue.say(numbered(0, 'M110 N0')) == b'ok\n'
    assert dialogue.say(b'N1 M17*0\n') == b'Error:checksum mismatch, Last Line: 0\nResend: 1\nok\n'
    received = dialogue.say(numbered(7, 'M17'))
    assert received == b'Error:Line Number is not Last Line Number+1, Last Line: 0\nResend: 1\nok\n'
    assert dialogue.say(numbered(1, 'M17')) == b'ok\n'


@pytest.mark.parametrize(('parser', 'place'), [(True, -115.0), (False, -70.0)])
def test_a_quick_stop_is_quick_only_with_the_emergency_parser(parser: bool, place: float) -> None:
    """Behind a wait for the end of a move it comes too late; 5 mm are done after 0.5 s and half the ramp, 0.025 s."""
    dialogue = marlin(parser)
    dialogue.say(b'G1 X50 F600\nM400\n', 0.525)
    dialogue.say(b'M410\n', 6)
    assert dialogue.tip[0] == pytest.approx(place, abs=0.03)


def test_a_quick_stop_on_its_way_to_a_switch_halts_it() -> None:
    """As 2.1.2.1 did, a second after M410."""
    dialogue = marlin(homed=False)
    dialogue.say(b'G28\n', 0.3)
    dialogue.say(b'M410\n', 0.9)
    before = dialogue.tip
    assert dialogue.hear(0.2) == b'echo:Homing Failed\nError:Printer halted. kill() called!\n'
    assert dialogue.say(b'M115\n', 3) == b''
    assert dialogue.tip == before


def backing_off() -> Dialogue:
    """One that homes, and is on its way off the switch of z."""
    dialogue = marlin(homed=False)
    dialogue.say(b'G28\n')
    while dialogue.tip[2] < -0.5:
        dialogue.hear(0.02)
    dialogue.hear(0.2)
    while dialogue.tip[2] > -1.0:
        dialogue.hear(0.02)
    return dialogue


def test_a_quick_stop_on_its_way_off_a_switch_ends_only_that_way() -> None:
    """As 2.1.2.1 did at 5 of 11 moments: it went on to home."""
    dialogue = backing_off()
    assert dialogue.say(b'M410\n', 20).endswith(b'ok\nok\n')
    assert dialogue.tip[0] == pytest.approx(-120.0, abs=0.01)


def test_a_further_quick_stop_ends_the_next_way() -> None:
    dialogue = backing_off()
    dialogue.say(b'M410\n', 0.5)
    before = dialogue.tip
    assert dialogue.say(b'M410\n', 2.0).endswith(b'Error:Printer halted. kill() called!\n')
    assert dialogue.tip == pytest.approx(before, abs=0.01)


def test_after_a_kill_there_is_total_silence() -> None:
    dialogue = marlin()
    assert dialogue.say(b'M112\n') == b'Error:Printer halted. kill() called!\n'
    assert dialogue.say(b'M115\nM112\n', 3) == b''
    dialogue.device.power_cycle()
    assert dialogue.hear().startswith(b'start\n')


def test_targets_beyond_the_room_are_clipped_without_a_word() -> None:
    dialogue = marlin()
    assert dialogue.say(b'G1 X500 F2400\n', 5) == b'ok\n'
    assert dialogue.tip[0] == pytest.approx(0.0)


def test_lines_beyond_its_buffers_vanish_silently() -> None:
    dialogue = marlin()
    received = dialogue.say(b''.join(b'G1 X%.1f F600\n' % (n / 10) for n in range(61)), 20)
    assert received.count(b'ok') < 61
    assert dialogue.device.overflowed > 0
