"""What happens in mid-press: 1 mm/s down, the fault at 0.3 mm depth, 2.0 mm commanded. The surface is at z -30 mm."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable
from typing import Any

import pytest
from cnc_rigs import START_NS, Rig, device_of, direct_rig, homed_rig, settings_of
from coarse_table import coarse_table
from jumping_clock import JumpingClock

from benchmarks.devices.direct_port import DirectPort
from benchmarks.devices.serial_faults import FaultyPort, LineFaults
from tactile_nodes.collection.actions import Go
from tactile_nodes.collection.hands import Hands, TrippedError
from tactile_nodes.collection.readings import Readings
from tactile_nodes.collection.safety import Safety
from tactile_nodes.collection.settings import LimitSettings, MotionSettings
from tactile_nodes.drivers.cnc.contract import NO_HOMING, NO_SOFT_LIMITS, CncStatus
from tactile_nodes.drivers.cnc.grbl import GrblCnc
from tactile_nodes.drivers.cnc.marlin import MarlinCnc
from tactile_nodes.drivers.health import Level
from tactile_nodes.emulators.world import World, WorldSettings
from tactile_nodes.errors import ConfigurationError, DeviceError, DeviceFaultError

SURFACE_MM = -30.0
UNLOCKED = {
    'changes': ('$20=0', '$22=0'),
    'accept': (NO_SOFT_LIMITS, NO_HOMING),
    'lowest_mm': (-100.0, -100.0, -55.0),
    'highest_mm': (60.0, 60.0, 60.0),
}


class PressRig(Rig):
    """A Grbl that does not restart when its port is opened, with faults on its line; in one thread."""

    faults: LineFaults
    hands: Hands
    deepest_mm = 0.0

    def press(self, fault: Callable[[], object] | None = None) -> None:
        """Home, go above the gel and down; at 0.3 mm the fault."""
        self.cnc.home()
        for height_mm in (-25.0, -30.0):
            self.go(-60.0, -60.0, height_mm)
        self._fault = fault
        self.hands.perform(Go(z=self.at(0.0, 0.0, SURFACE_MM - 2.0)[2], feed_mm_min=60.0))

    def look(self, status: CncStatus) -> None:
        """Called about ten times a second with the status of the machine."""
        depth_mm = SURFACE_MM - self.world.tip_at(self.clock.now_ns())[2]
        if self._fault is not None and depth_mm >= 0.3:
            fault, self._fault = self._fault, None
            fault()

    _fault: Callable[[], object] | None = None

    def restart_unheard(self) -> None:
        for banner in (b"Grbl 1.1h ['$' for help]", b"GrblHAL 1.1f ['$' or '$HELP' for help]", b'start\n'):
            self.faults.change('<', banner, b'')
        self.device.power_cycle()

    def rest(self, seconds: float = 5.0) -> float:
        """Let time pass, and give the greatest depth until now: no more than it is at the end of any way down."""
        for _ in range(round(20 * seconds)):
            with contextlib.suppress(DeviceError):
                self.cnc._talk().link.wait(lambda: False, 0.05)
        return self.deepest_mm


class WatchingClock(JumpingClock):
    """Looks at the tip wherever time goes."""

    watch: Callable[[], None] | None = None

    def sleep_until(self, deadline_ns: int) -> None:
        while self.now_ns() < deadline_ns:
            super().sleep_until(min(deadline_ns, self.now_ns() + 5_000_000))
            if self.watch is not None:
                self.watch()


def press_rig(kind: str = 'grbl', changes: tuple[str, ...] = (), **more: Any) -> PressRig:
    clock = WatchingClock(START_NS)
    start_mm, marlin = (-60.0, -60.0, -20.0), kind.startswith('marlin')
    world = World(WorldSettings(start_mm=start_mm), table=coarse_table())
    device = device_of(kind, world, clock, changes)
    settings = settings_of(kind, boot_s=0.2, **{'safe_z_mm': 35.0 if marlin else -25.0, **more})
    faults, direct = LineFaults(), DirectPort(device, clock)
    direct.read(1.0)  # its banner was said long before anybody listened
    driver = MarlinCnc if marlin else GrblCnc
    cnc = driver(settings, clock, lambda: FaultyPort(direct, faults), threaded=False)
    zero = start_mm if changes else (-120.0, -120.0, -60.0) if marlin else (0.0, 0.0, 0.0)
    rig = PressRig(cnc, world, clock, (0.0 - zero[0], 0.0 - zero[1], 0.0 - zero[2]), device, direct)
    rig.faults = faults
    safety = Safety(LimitSettings())
    rig.hands = Hands(cnc, clock, safety, Readings(), MotionSettings(), on_status=rig.look)

    def deepest() -> None:
        rig.deepest_mm = max(rig.deepest_mm, SURFACE_MM - world.tip_at(clock.now_ns())[2])

    clock.watch = deepest
    cnc.connect()
    return rig


@pytest.fixture(params=['grbl', 'grblhal', 'marlin'])
def any_rig(request: pytest.FixtureRequest) -> PressRig:
    return press_rig(request.param)


@pytest.fixture(params=['grbl', 'grblhal'])
def rig(request: pytest.FixtureRequest) -> PressRig:
    return press_rig(request.param)


# A controller that restarts.


def test_a_restart_whose_banner_is_lost_shows_in_its_reports(rig: PressRig) -> None:
    with pytest.raises(DeviceError):
        rig.press(rig.restart_unheard)
    assert rig.rest() < 0.5
    with pytest.raises(DeviceFaultError, match='has restarted, so its position is unknown'):
        rig.hands.retreat()
    assert not rig.cnc.status().homed


def test_idle_at_zero_after_a_restart_unheard_is_not_up() -> None:
    """Without homing a Grbl restarts unlocked: 'Idle at 0,0,0' is above the safe height, and the tip 0.3 mm deep."""
    rig = press_rig(**UNLOCKED, safe_z_mm=-5.0)
    with pytest.raises(DeviceError):
        rig.press(rig.restart_unheard)
    with pytest.raises(DeviceFaultError, match=r'reports x 0\.000 y 0\.000 z -?0\.\d+ mm, which it cannot'):
        rig.hands.retreat()
    assert rig.rest() < 0.6
    # From 0, it was sent to at most -10.75 mm, which is 5.75 mm below the safe height, and had gone 0.3 to 0.6 mm deep.
    assert rig.world.tip_at(rig.clock.now_ns())[2] - SURFACE_MM == pytest.approx(5.3, abs=0.3)
    assert not rig.cnc.status().homed


def test_a_marlin_that_restarted_unheard_is_known_by_the_line_that_it_asks_for() -> None:
    rig = press_rig('marlin')
    with pytest.raises(DeviceFaultError, match='has restarted, so its position is unknown'):
        rig.press(rig.restart_unheard)
    assert rig.faults.done == 1
    assert rig.rest() < 0.6
    with pytest.raises(DeviceFaultError, match='has restarted'):
        rig.hands.retreat()


def test_a_marlin_that_says_it_is_elsewhere_is_stopped() -> None:
    """Twice: once would be a damaged answer."""
    rig = press_rig('marlin')
    with pytest.raises(DeviceFaultError, match=r'reports x 6.*, which it cannot have reached'):
        rig.press(lambda: rig.faults.change('<', b'X:60.00 ', b'X:68.00 ', times=2))
    assert rig.faults.done == 2
    assert rig.rest() < 0.8


def test_a_marlin_that_deals_with_nothing_for_a_second_after_a_stop_is_not_silent() -> None:
    """Whoever watches over the rig would stop it again, and every retreat begins with a stop."""
    rig, levels = press_rig('marlin'), set()
    rig.cnc.home()
    rig.clock.watch = lambda: levels.add(rig.cnc.health.level)
    rig.go(-60.0, -60.0, -25.0)
    rig.cnc.jog(dz=-2.0, feed=60.0)
    rig.rest(1.0)
    begin = rig.seconds()
    rig.cnc.stop()
    assert rig.seconds() - begin > 1.0
    assert rig.tip[2] == pytest.approx(rig.at(0.0, 0.0, -26.0)[2], abs=0.1)
    assert levels == {Level.OK}


@pytest.mark.parametrize(('kind', 'banner'), [('grbl', b"Grbl 1.1h ['$' for help]\r\n"), ('marlin', b'start\n')])
def test_a_controller_that_says_a_banner_and_goes_on_is_stopped(kind: str, banner: bytes) -> None:
    """Reports come every 0.1 s, and it brakes at once; the jogs that it was sent would lead to 0.75 mm."""
    rig = press_rig(kind)
    with pytest.raises(DeviceFaultError, match='restarted by itself, so its position is unknown'):
        rig.press(lambda: rig.device.say(banner))
    assert rig.rest() < 0.45


def test_an_ok_too_many_of_a_marlin_is_not_taken_for_the_answer_to_another_line() -> None:
    """As a late one after a line that was asked for again: each later answer would count for the line after its own."""
    rig = press_rig('marlin')
    rig.press(lambda: rig.device.say(b'ok\n'))
    assert rig.rest() == pytest.approx(2.0, abs=0.01)
    rig.hands.retreat()
    assert rig.tip[2] == pytest.approx(35.0, abs=0.01)
    assert rig.cnc.health.level is Level.OK


def test_after_a_restart_nothing_moves_but_up() -> None:
    rig = press_rig(**UNLOCKED, safe_z_mm=-5.0)
    with pytest.raises(DeviceFaultError, match='restarted by itself'):
        rig.press(rig.device.power_cycle)
    low_mm = rig.world.tip_at(rig.clock.now_ns())[2]
    for way in ({'dz': -0.1}, {'dx': 0.1}, {'dx': 0.1, 'dz': 0.1}):
        with pytest.raises((DeviceFaultError, ConfigurationError)):
            rig.cnc.jog(**way, feed=60.0)
    with pytest.raises(DeviceFaultError):
        rig.cnc.move(z=0.0, feed=60.0)
    assert rig.world.tip_at(rig.clock.now_ns())[2] == low_mm
    rig.cnc.jog(dz=0.25, feed=60.0)
    rig.rest(1.0)
    assert rig.world.tip_at(rig.clock.now_ns())[2] == pytest.approx(low_mm + 0.25)


# A line that is damaged on its way; Grbl has no checksum.


@pytest.mark.parametrize(
    ('sent', 'arriving'),
    [
        (b'Z-30.75', b'Z-31.75'),  # goes on 1 mm, and is led back by the next line
        (b'Z-32.0', b'Z-33.0'),  # the last line
        (b'X-60.000', b'X-61.000'),  # sideways in the gel
        (b'Z-30.75', b'Z-3.75'),
    ],
)
def test_one_damaged_character_of_a_jog_is_seen_while_it_moves(sent: bytes, arriving: bytes) -> None:
    rig = press_rig()
    with pytest.raises(DeviceError):
        rig.press(lambda: rig.faults.change('>', sent, arriving))
    assert rig.faults.done == 1
    assert rig.rest() < 2.25
    assert rig.world.tip_at(rig.clock.now_ns())[0] > -60.25
    with contextlib.suppress(DeviceFaultError):
        rig.hands.retreat()
        assert rig.tip == pytest.approx(rig.at(-60.0, -60.0, -25.0), abs=0.3)


def test_a_tip_that_went_elsewhere_is_stopped_and_brought_up() -> None:
    rig = press_rig()
    with pytest.raises(DeviceFaultError, match=r'is at .* z -3\d\.\d+ mm, off the commanded path'):
        rig.press(lambda: rig.faults.change('>', b'Z-30.75', b'Z-39.75'))
    assert rig.cnc.health.level is Level.ERROR
    rig.hands.retreat()
    assert rig.tip[2] == pytest.approx(-25.0, abs=0.01)
    assert rig.cnc.status().homed
    assert rig.deepest_mm < 2.25


def test_a_long_jog_that_goes_faster_than_it_was_sent_is_stopped() -> None:
    rig = press_rig()
    rig.cnc.home()
    rig.go(-60.0, -60.0, -20.0)
    rig.faults.change('>', b'F60.0', b'F960.0')
    rig.cnc.jog(dz=-10.0, feed=60.0)
    with pytest.raises(DeviceFaultError, match=r'moves at \d+ mm/min, faster than commanded'):
        rig.cnc.wait_idle()
    rig.rest(1.0)
    assert rig.tip[2] > -24.0  # 16 mm/s for a tenth of a second, and the ramps


def test_a_single_damaged_report_ends_no_press() -> None:
    rig = press_rig()
    rig.press(lambda: rig.faults.change('<', b'MPos:-60.000', b'MPos:-20.000'))
    assert rig.faults.done == 1
    assert rig.rest() == pytest.approx(2.0, abs=0.01)
    assert rig.cnc.health.level is Level.OK


@pytest.mark.parametrize(
    ('kind', 'told', 'arriving'),
    [('grbl', b'-60.000,-30.000', b'-60.000,-20.000'), ('marlin', b'Z:30.00 E', b'Z:40.00 E')],
)
def test_a_single_damaged_report_before_the_way_down_leads_no_deeper(kind: str, told: bytes, arriving: bytes) -> None:
    """The way down is the difference between the target and the reported place: it would be 10 mm longer."""
    rig = press_rig(kind)
    rig.press()
    rig.go(-60.0, -60.0, SURFACE_MM)
    rig.faults.change('<', told, arriving)
    rig.hands.perform(Go(z=rig.at(0.0, 0.0, SURFACE_MM - 2.0)[2], feed_mm_min=60.0))
    assert rig.faults.done == 1
    assert rig.rest() == pytest.approx(2.0, abs=0.01)
    assert rig.cnc.health.level is Level.OK


@pytest.mark.parametrize(
    ('kind', 'told', 'arriving'), [('grbl', b'0,-30.', b'0,-10.'), ('marlin', b' Z:29.', b' Z:49.')]
)
def test_a_single_damaged_height_is_told_to_nobody(kind: str, told: bytes, arriving: bytes) -> None:
    rig, heights = press_rig(kind), []
    look = rig.hands._on_status
    assert look is not None

    def watch(status: CncStatus) -> None:
        heights.append(status.position_mm[2] - rig.at(0.0, 0.0, SURFACE_MM)[2])
        look(status)

    rig.hands._on_status = watch
    rig.press(lambda: rig.faults.change('<', told, arriving))
    assert rig.faults.done == 1
    assert max(heights[-20:]) < 1.0
    assert rig.rest() == pytest.approx(2.0, abs=0.01)


def test_a_controller_that_repeats_what_it_received_is_taken_at_its_word() -> None:
    rig = press_rig()

    def echo_damaged() -> None:
        rig.device.say(b'[echo: $J=G21G90G53X-60.000Y-60.000Z-31.450F60.0]\r\n')

    with pytest.raises(DeviceFaultError, match=r'received .*Z-31\.450.* instead of .*'):
        rig.press(echo_damaged)
    assert rig.rest() < 1.0


def test_a_line_on_which_all_that_is_sent_comes_back_ends_no_press(any_rig: PressRig) -> None:
    """An adapter with its echo on returns each byte: a question just before its answer, as ``?<Jog|MPos:…>``."""

    def echo(way: str, data: bytes) -> bytes:
        if way == '>':
            any_rig.device.say(data)
        return data

    any_rig.faults.lie = echo
    any_rig.cnc.connect()
    any_rig.press()
    assert any_rig.rest() == pytest.approx(2.0, abs=0.01)
    any_rig.hands.retreat()
    assert any_rig.world.tip_at(any_rig.clock.now_ns())[2] == pytest.approx(-25.0, abs=0.01)
    assert any_rig.cnc.health.level is not Level.ERROR
    assert '$I' not in any_rig.cnc.description.get('options', '')


# A controller that says nothing.


@pytest.mark.parametrize('fault', ['mute', 'hung'])
def test_a_silent_controller_is_noticed_within_half_a_second_and_stopped_if_it_hears(
    any_rig: PressRig, fault: str
) -> None:
    since_ns: list[int] = []

    def fall_silent() -> None:
        since_ns.append(any_rig.clock.now_ns())
        setattr(any_rig.faults if fault == 'mute' else any_rig.device.faults, fault, True)

    with pytest.raises((DeviceError, TrippedError)):
        any_rig.press(fall_silent)
    assert any_rig.clock.now_ns() - since_ns[0] < 0.55e9  # with the time that a cancelled jog needs
    assert any_rig.cnc.health.level is Level.ERROR
    if fault == 'hung':
        return
    assert 'silent' in any_rig.cnc.health.message
    assert any_rig.cnc.health.silent
    assert any_rig.rest() < 0.3 + 0.1 + 0.5 + 0.1  # seen late, noticed late, braked late


@pytest.mark.parametrize('kind', ['marlin', 'marlin without M503', 'grbl'])
@pytest.mark.parametrize(('word', 'times'), [(rb'M400', 1), (rb'G1 |\$J=', 9)], ids=['end of motion', 'ninth jog'])
def test_a_controller_that_falls_mute_at_any_line_is_noticed_within_half_a_second(
    kind: str, word: bytes, times: int
) -> None:
    """What a Marlin answers late by its nature, has an end as well: that of the motion before it."""
    if (kind, times) == ('grbl', 1):
        pytest.skip('a Grbl reports the end of motion in its reports')
    rig = press_rig(kind)
    rig.cnc.home()
    for height_mm in (-25.0, -29.0):
        rig.go(-60.0, -60.0, height_mm)
    write, sent_ns, errors = rig.port.write, [], []

    def write_or_fall_mute(data: bytes) -> None:
        if re.search(word, data):
            sent_ns.append(rig.clock.now_ns())
            rig.faults.mute = rig.faults.mute or len(sent_ns) == times
        write(data)

    rig.port.write = write_or_fall_mute
    watch = rig.clock.watch

    def look() -> None:
        watch()
        if rig.cnc.health.level is Level.ERROR:
            errors.append(rig.clock.now_ns())

    rig.clock.watch = look
    with pytest.raises((DeviceError, TrippedError)):
        rig.hands.perform(Go(z=rig.at(0.0, 0.0, -31.5)[2], feed_mm_min=60.0))  # ten jogs of a quarter of a second
    noticed_ns = min([*errors, rig.clock.now_ns()])
    assert noticed_ns - sent_ns[times - 1] < 0.5e9


@pytest.mark.parametrize('kind', ['grbl', 'marlin'])
def test_a_computer_that_stands_still_is_no_controller_that_hangs(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """An answer may take 2 s; the computer stands still for 3 s before it reads what has long come."""
    rig = direct_rig(kind)
    rig.cnc.connect()
    rig.cnc.home()
    read, paused = rig.port.read, []

    def late(timeout_s: float) -> bytes:
        if paused:
            return read(timeout_s)
        rig.clock.advance(3.0)
        paused.append(timeout_s)
        return b''

    monkeypatch.setattr(rig.port, 'read', late)
    switched = rig.cnc.set_line(True)
    assert switched.latest_ns - switched.earliest_ns >= 3_000_000_000


@pytest.mark.parametrize('kind', ['grbl', 'marlin'])
def test_a_motion_that_ends_while_the_computer_stands_still_has_ended(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A way of 0.5 s may take 2.8 s; after the first report the computer stands still for 10 s."""
    rig = homed_rig(kind)
    below = rig.tip[2] - 0.5
    rig.cnc.jog(dz=-0.5, feed=60.0)
    read, reads = rig.port.read, []

    def late(timeout_s: float) -> bytes:
        reads.append(timeout_s)
        if len(reads) != 3:
            return read(timeout_s)
        rig.clock.advance(10.0)
        return b''

    monkeypatch.setattr(rig.port, 'read', late)
    rig.cnc.wait_idle()
    assert rig.tip[2] == pytest.approx(below)
    assert len(reads) > 3
