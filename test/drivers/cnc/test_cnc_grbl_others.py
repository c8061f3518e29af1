"""What original firmware and its relatives say otherwise than the emulated controllers, as transcripts."""

from __future__ import annotations

import pytest
from cnc_rigs import Script
from test_cnc_grbl import BANNER, CONNECT, HOME, IDENTITY, IDLE, PREAMBLE, SETTINGS, UNLOCK, nothing, play

from tactile_nodes.drivers.cnc.contract import CncState
from tactile_nodes.drivers.cnc.grbl import GrblCnc
from tactile_nodes.drivers.health import Level
from tactile_nodes.errors import DeviceFaultError

HAL_BANNER = b"\r\nGrblHAL 1.1f ['$' or '$HELP' for help]\r\n"
HAL_IDENTITY = (
    b'[VER:1.1f.20260817:rig 1, the left one]\r\n[OPT:VNMZHSL+,100,1024,3,8]\r\n[AXS:3:XYZ]\r\n[NEWOPT:ENUMS,RT+,HOME,'
    b'ES,TC,SED,ETH,FS]\r\n[FIRMWARE:grblHAL]\r\n[SIGNALS:HSEP]\r\n[NVS STORAGE:*FLASH]\r\n[FREE MEMORY:118K]\r\n'
    b'[DRIVER:STM32F401CC]\r\n[BOARD:Blackpill]\r\n[AUX IO:4,4,1,0]\r\n[PLUGIN:SDCARD v1.10]\r\nok\r\n'
)
HAL_MORE = (
    b'$37=0\r\n$39=1\r\n$70=15\r\n$300=rig\r\n$302=192.168.5.1\r\n$341=0\r\n$370=0\r\n$393=5.0\r\n$481=0\r\n$676=15\r\n'
    b'$734=0,0,0\r\nok\r\n'
)
HAL_SETTINGS = SETTINGS.replace(b'$22=1', b'$22=5').replace(b'ok\r\n', b'') + HAL_MORE
HAL_REPORT = (
    b'<Idle|MPos:-1.000,-1.000,-1.000|Bf:100,1023|FS:0,0|Pn:PH|WCO:0.000,0.000,0.000|WCS:G54|Ov:100,100,100|A:|MPG:0|H:1,7|'
    b'TLR:0|T:0|SD:1|FW:grblHAL|Sc:XYZ|D:0|In:-1>\r\n'
)
HAL_LOCKED = b'<Alarm:11' + HAL_REPORT[5:]


def changed(*settings: tuple[bytes, bytes], identity: bytes = IDENTITY) -> Script:
    memory = SETTINGS
    for old, new in settings:
        memory = memory.replace(old, new)
    return [(b'$I\n', identity), CONNECT[1], (b'$$\n', memory)]


def test_grblhal_may_say_much_more_about_itself() -> None:
    """Identity, settings and full reports as its newer versions give them, a lock that only asks for homing."""

    def act(cnc: GrblCnc) -> None:
        cnc.home()
        status = cnc.status()
        assert (status.state, status.position_mm, status.homed) == (CncState.IDLE, (-1.0, -1.0, -1.0), True)

    start = HAL_BANNER + b'ALARM:11\r\n[MSG:Homing cycle required]\r\n'
    script = [(b'$I\n', HAL_IDENTITY), (b'?', HAL_LOCKED), (b'$$\n', HAL_SETTINGS)]
    home = [(b'$H\n', b'[MSG:Homing]\r\nok\r\n'), PREAMBLE, (b'?', HAL_REPORT), (b'?', HAL_REPORT)]
    cnc = play([*script, *home], act, first=start)
    assert cnc.description['kind'] == 'CNC, grblHAL 1.1f.20260817:rig 1, the left one'
    assert cnc.description['$302'] == '192.168.5.1'
    assert cnc.description['$734'] == '0,0,0'
    assert cnc.health.level == Level.OK


def test_line_feeds_alone_end_lines_as_well() -> None:
    script = [(sent, answer.replace(b'\r\n', b'\n')) for sent, answer in [*CONNECT, *HOME]]
    play(script, GrblCnc.home, first=(BANNER + UNLOCK).replace(b'\r\n', b'\n'))


def test_an_alarm_before_the_banner_is_no_reason_not_to_home() -> None:
    """Opening the port has restarted a board that moved; and before that its adapter has sent noise."""
    first = b'\x00\xf8\xe0' + b'\r\nALARM:3\r\nok\r\n' + BANNER + UNLOCK
    cnc = play([*CONNECT, (b'\x18', BANNER + UNLOCK), *HOME], GrblCnc.home, first=first)
    assert cnc.health.level == Level.OK


def test_a_board_that_restarts_twice_when_its_port_is_opened_is_asked_again() -> None:
    cnc = play([(b'$I\n', IDENTITY[:20] + BANNER + UNLOCK), *CONNECT, *HOME], GrblCnc.home)
    assert cnc.description['kind'].endswith(' 1.1h.20190830')


@pytest.mark.parametrize('word', ['Check', 'Sleep', 'Door:1', 'Tool', 'Hold:0', 'Run', 'Home', 'Jog'])
def test_a_machine_that_does_something_else_is_refused(word: str) -> None:
    """In check mode everything is answered with ok, and nothing moves."""
    script = [CONNECT[0], (b'?', IDLE.replace(b'Idle', word.encode()))]
    with pytest.raises(DeviceFaultError, match=rf'is busy \({word}\)'):
        play(script, nothing)


def test_work_positions_wait_for_their_offset() -> None:
    """It comes with every thirtieth report while it moves, with every tenth at rest."""
    bare = (b'?', b'<Idle|WPos:9.000,9.000,9.000|FS:0,0>\r\n')
    work = (b'?', b'<Idle|WPos:9.000,9.000,9.000|FS:0,0|WCO:-10.000,-10.000,-10.000>\r\n')
    start = [CONNECT[0], (b'?', b'<Alarm|WPos:0.000,0.000,0.000|FS:0,0>\r\n'), CONNECT[2]]

    def act(cnc: GrblCnc) -> None:
        cnc.home()
        assert cnc.status().position_mm == pytest.approx((-1.0, -1.0, -1.0))

    play([*start, *HOME[:2], *[bare] * 9, work, bare], act)


def test_a_grbl_compiled_to_count_up_from_its_switches_has_its_box_there() -> None:
    """A Z among the letters of [OPT:], and X and Y home to their lower ends ($23=3)."""
    compiled = IDENTITY.replace(b'OPT:V,', b'OPT:VZ,')
    with pytest.raises(DeviceFaultError, match='no homing'):
        play(changed((b'$22=1', b'$22=0'), identity=compiled), nothing)
    cnc = play(changed((b'$22=1', b'$22=1\r\n$23=3'), identity=compiled), nothing)
    assert cnc.limits.lowest_mm == (0.0, 0.0, -60.0)
    assert cnc.limits.highest_mm == (120.0, 120.0, 0.0)


def test_homing_of_grblhal_is_on_by_the_lowest_bit_alone() -> None:
    script = [(b'$I\n', HAL_IDENTITY), (b'?', HAL_LOCKED), (b'$$\n', HAL_SETTINGS.replace(b'$22=5', b'$22=4'))]
    with pytest.raises(DeviceFaultError, match='homing switched off'):
        play(script, nothing, first=HAL_BANNER)


def test_an_alarm_of_another_firmware_is_named_by_its_number() -> None:
    """grblHAL knows more than the eleven: 17 is a motor fault."""

    def act(cnc: GrblCnc) -> None:
        cnc.home()
        with pytest.raises(DeviceFaultError, match='alarm 17, unknown'):
            cnc.move(z=-5.0, feed=600.0)
        assert cnc.health.level == Level.ERROR

    move = (b'G21 G90 G53 G1 X-1.000 Y-1.000 Z-5.000 F600.0\n', b'ALARM:17\r\n[MSG:Motor fault]\r\n')
    play([*CONNECT, *HOME, move], act)
