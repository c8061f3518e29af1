"""What every CNC does: Grbl, grblHAL and Marlin as emulated controllers, and the twin."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from cnc_rigs import KINDS, START_NS, Rig, device_of, direct_rig, pty_rig, settings_of
from coarse_table import coarse_table
from jumping_clock import JumpingClock

from benchmarks.devices.direct_port import DirectPort
from tactile_nodes.clock import SystemClock
from tactile_nodes.drivers.cnc.contract import CncSettings, CncState, Envelope
from tactile_nodes.drivers.cnc.grbl import GrblCnc
from tactile_nodes.drivers.cnc.marlin import MarlinCnc
from tactile_nodes.drivers.cnc.opening import open_cnc
from tactile_nodes.drivers.health import Level
from tactile_nodes.emulators.world import World
from tactile_nodes.errors import (
    ConfigurationError,
    DeviceError,
    DeviceFaultError,
    DeviceTimeoutError,
    TactileError,
)
from tactile_nodes.params import describe, from_mapping


@pytest.fixture(params=KINDS)
def rig(request: pytest.FixtureRequest) -> Rig:
    """Connected, not homed."""
    connected = direct_rig(request.param)
    connected.cnc.connect()
    return connected


@pytest.fixture
def homed(rig: Rig) -> Rig:
    """Homed, and over the gel's middle at the safe height."""
    rig.cnc.home()
    rig.go(-60, -60, -5)
    return rig


def test_it_says_what_it_is(rig: Rig) -> None:
    assert re.fullmatch(r'CNC, (Grbl|grblHAL|Marlin) \S+|simulated CNC', rig.cnc.description['kind'])
    assert rig.cnc.description['source']


@pytest.mark.parametrize('kind', ['grbl', 'marlin'])
def test_the_feed_along_a_way_is_limited_by_its_slowest_axis(kind: str) -> None:
    """Along a diagonal of x and z, z goes by 1/√2 of the feed: 1200 mm/min of it are 1697 mm/min along the way."""
    cnc = direct_rig(kind).cnc
    cnc.connect()
    assert cnc.feed_along((1.0, 0.0, -1.0), 2000.0) == pytest.approx(1697.06, abs=0.01)
    assert cnc.feed_along((1.0, -1.0, 0.0), 2000.0) == 2000.0


def test_its_deceleration_is_known(rig: Rig) -> None:
    assert rig.cnc.deceleration_mm_s2 == 200.0


def test_nothing_moves_by_connecting(rig: Rig) -> None:
    assert rig.world.tip_at(rig.clock.now_ns()) == rig.world.settings.start_mm
    assert not rig.cnc.status().homed


def test_before_homing_no_move_is_made(rig: Rig) -> None:
    with pytest.raises(DeviceFaultError, match='home it'):
        rig.cnc.move(*rig.at(-60, -60, -5), feed=100.0)
    assert rig.world.tip_at(rig.clock.now_ns()) == rig.world.settings.start_mm


@pytest.mark.parametrize('way', [{'dz': -0.01}, {'dx': 0.01, 'dz': 0.01}, {'dy': 0.01}])
def test_from_an_unknown_place_it_goes_nowhere_but_up(rig: Rig, way: dict[str, float]) -> None:
    with pytest.raises(TactileError, match=r'only go straight up|home'):
        rig.cnc.jog(**way, feed=100.0)
    assert rig.world.tip_at(rig.clock.now_ns()) == rig.world.settings.start_mm


def test_homing_gives_a_place_within_the_limits(rig: Rig) -> None:
    rig.cnc.home()
    status, limits = rig.cnc.status(), rig.cnc.limits
    assert status.homed
    assert status.state is CncState.IDLE
    assert status.position_mm == pytest.approx(rig.tip, abs=0.005)
    for value, low, high in zip(status.position_mm, limits.lowest_mm, limits.highest_mm, strict=True):
        assert low <= value <= high
    assert rig.cnc.health.level == Level.OK


def test_homing_again_that_is_broken_off_leaves_no_known_place(homed: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """Marlin sets its coordinates while it homes, so those of before are no longer true."""

    def stopped(*_: object, **__: object) -> None:
        raise DeviceFaultError('aborted by a stop')

    dialogue = getattr(homed.cnc, '_dialogue', None)
    monkeypatch.setattr(*(homed.cnc, '_wait_until_arrived') if dialogue is None else (dialogue, 'ask'), stopped)
    with pytest.raises(DeviceFaultError):
        homed.cnc.home()
    monkeypatch.undo()
    assert not homed.cnc.status().homed
    with pytest.raises(DeviceFaultError, match='home it'):
        homed.cnc.move(*homed.at(-60, -60, -6), feed=100.0)


def test_it_goes_where_it_is_sent_and_says_so(homed: Rig) -> None:
    homed.go(-50.125, -61, -4.5)
    assert homed.tip == pytest.approx(homed.at(-50.125, -61, -4.5), abs=0.001)
    assert homed.cnc.status().position_mm == pytest.approx(homed.tip, abs=0.006)  # Marlin reports hundredths


def test_a_move_takes_the_time_of_its_feed(homed: Rig) -> None:
    """20 mm at 600 mm/min with 200 mm/s²: 2 s and 0.05 s for the ramps; and the last question."""
    begin = homed.seconds()
    homed.go(-40, -60, -5, feed=600.0)
    assert homed.seconds() - begin == pytest.approx(2.05, abs=0.06)


def test_a_queued_move_is_not_done_yet(homed: Rig) -> None:
    homed.cnc.move(x=homed.at(-40, 0, 0)[0], feed=600.0)
    assert homed.cnc.status().state is CncState.RUN
    assert homed.tip[0] < homed.at(-55, 0, 0)[0]


@pytest.mark.parametrize(('place', 'text'), [((-60, -60, -61), 'to z'), ((-60, 1, -5), 'to y'), ((-121, -60, -5), 'x')])
def test_a_target_outside_the_box_is_refused_before_anything_is_sent(homed: Rig, place: tuple, text: str) -> None:
    before, sent_bytes = homed.tip, len(homed.sent())
    with pytest.raises(ConfigurationError, match=rf'{text} -?\d+ mm; the range is') as raised:
        homed.cnc.move(*homed.at(*place), feed=100.0)
    assert '\n' not in str(raised.value)
    assert (homed.tip, len(homed.sent())) == (before, sent_bytes)


def test_a_jog_out_of_the_box_is_refused_too(homed: Rig) -> None:
    homed.go(-60, -60, -0.01)
    with pytest.raises(ConfigurationError, match='the range is'):
        homed.cnc.jog(dz=0.04, feed=100.0)


@pytest.mark.parametrize('feed', [0.0, -5.0, 2001.0, float('nan')])
def test_a_senseless_feed_is_refused(homed: Rig, feed: float) -> None:
    with pytest.raises(ConfigurationError, match='feed must be above 0'):
        homed.cnc.move(z=homed.at(0, 0, -6)[2], feed=feed)


def test_nothing_goes_sideways_below_the_safe_height(homed: Rig) -> None:
    homed.go(-60, -60, -20)
    with pytest.raises(ConfigurationError, match='sideways'):
        homed.cnc.move(x=homed.at(-59, 0, 0)[0], feed=100.0)
    with pytest.raises(ConfigurationError, match='sideways'):
        homed.cnc.jog(dy=0.04, feed=100.0)


def test_a_jog_goes_on_by_a_distance(homed: Rig) -> None:
    homed.cnc.jog(dz=-2.0, feed=600.0)
    homed.cnc.wait_idle()
    homed.cnc.jog(dz=0.5, feed=600.0)
    homed.cnc.wait_idle()
    assert homed.tip == pytest.approx(homed.at(-60, -60, -6.5), abs=0.002)


def test_jogs_and_moves_may_follow_each_other(homed: Rig) -> None:
    homed.cnc.move(x=homed.at(-50, 0, 0)[0], feed=2000.0)
    homed.cnc.jog(dz=-1.0, feed=600.0)
    homed.cnc.move(z=homed.at(0, 0, -5)[2], feed=600.0)
    homed.cnc.wait_idle()
    assert homed.tip == pytest.approx(homed.at(-50, -60, -5), abs=0.002)


def test_a_stopped_jog_rests_within_a_tenth_of_a_millimetre_and_knows_where(homed: Rig) -> None:
    """At 60 mm/min the firmware needed 0.044 mm, with a round trip."""
    homed.cnc.jog(dz=-5.0, feed=60.0)
    homed.pass_time(1.0)
    before = homed.tip[2]
    homed.cnc.stop()
    assert 0 <= before - homed.tip[2] < 0.1
    still = homed.tip
    homed.pass_time(1.0)
    assert homed.tip == still
    status = homed.cnc.status()
    assert status.homed
    assert status.state is CncState.IDLE
    assert status.position_mm == pytest.approx(homed.tip, abs=0.006)


def test_a_stopped_move_keeps_the_place_and_forgets_the_queue(homed: Rig) -> None:
    for z in (-10, -15, -20):
        homed.cnc.move(z=homed.at(0, 0, z)[2], feed=300.0)
    homed.pass_time(0.5)
    homed.cnc.stop()
    assert homed.tip[2] > homed.at(0, 0, -10)[2]
    assert homed.cnc.status().homed
    homed.go(-60, -60, -12)
    assert homed.tip == pytest.approx(homed.at(-60, -60, -12), abs=0.01)


def test_a_stop_at_rest_does_no_harm(homed: Rig) -> None:
    homed.cnc.stop()
    assert homed.cnc.status().homed
    homed.go(-50, -60, -5)


def test_a_retract_goes_straight_up_to_the_safe_height(homed: Rig) -> None:
    homed.go(-60, -60, -30.5)
    homed.cnc.jog(dz=-1.5, feed=60.0)
    homed.cnc.retract()
    assert homed.tip == pytest.approx(homed.at(-60, -60, -5), abs=0.01)


@pytest.mark.parametrize('beyond_mm', [0.006, 1.0])
def test_a_retract_is_not_refused_because_the_tip_rests_at_the_edge_of_the_workspace_or_beyond(
    homed: Rig, beyond_mm: float
) -> None:
    """A stop, or rounding to steps, leaves the tip a little outside; a person may have moved it there."""
    homed.go(-60, -60, -20)
    x, y, _ = homed.at(-60 + beyond_mm, -60, 0)
    guard = homed.cnc._guard  # type: ignore[attr-defined]
    low, high = guard.envelope.lowest_mm, guard.envelope.highest_mm
    box = Envelope((x, low[1], low[2]), (high[0], y - beyond_mm, high[2]))
    homed.cnc._guard = replace(guard, envelope=box)  # type: ignore[attr-defined]
    homed.cnc.retract()
    assert homed.tip == pytest.approx(homed.at(-60, -60, -5), abs=0.01)
    with pytest.raises(ConfigurationError, match='the range is'):
        homed.cnc.move(x=homed.at(-60.1, 0, 0)[0], feed=100.0)


def test_grbl_lifts_a_tip_that_rests_beyond_its_own_travel_by_less_than_a_step() -> None:
    """It refuses a jog to such a place even straight up (error 15)."""
    rig = direct_rig('grbl')
    rig.cnc.connect()
    rig.cnc.home()
    rig.go(-60.006, -60, -5)
    rig.go(-60.006, -60, -20)
    rig.device.machine.memory[130] = '60.000'
    guard = rig.cnc._guard  # type: ignore[attr-defined]
    box = replace(guard.envelope, lowest_mm=(-60.0, *guard.envelope.lowest_mm[1:]))
    rig.cnc._guard = replace(guard, envelope=box)  # type: ignore[attr-defined]
    rig.cnc.retract()
    assert rig.tip == pytest.approx((-60.0, -60.0, -5.0), abs=0.001)


def test_a_retract_from_above_the_safe_height_stays(homed: Rig) -> None:
    homed.go(-60, -60, -2)
    homed.cnc.retract()
    assert homed.tip[2] == pytest.approx(homed.at(0, 0, -2)[2], abs=0.001)


def test_the_line_switches_at_rest_and_the_edge_lies_where_it_is_reported(homed: Rig) -> None:
    homed.cnc.move(x=homed.at(-50, 0, 0)[0], feed=1200.0)
    switched = homed.cnc.set_line(True)
    homed.cnc.set_line(False)
    rise, fall = homed.world.line_edges()
    assert (rise.level, fall.level) == (True, False)
    assert switched.earliest_ns <= rise.stamp_ns <= switched.latest_ns
    assert switched.latest_ns - switched.earliest_ns < 10_000_000
    assert homed.world.tip_at(rise.stamp_ns)[0] == pytest.approx(-50, abs=0.001)


def test_status_is_of_now(homed: Rig) -> None:
    begin_ns = homed.clock.now_ns()
    status = homed.cnc.status()
    assert begin_ns <= status.stamp_ns - status.uncertainty_ns
    assert status.stamp_ns + status.uncertainty_ns <= homed.clock.now_ns() + 1


def test_a_closed_machine_says_so(homed: Rig) -> None:
    homed.cnc.close()
    homed.cnc.close()
    assert homed.cnc.health.level == Level.STALE
    with pytest.raises(DeviceError, match='not connected'):
        homed.cnc.status()


@pytest.mark.parametrize('kind', ['grbl', 'marlin', 'simulated'])
def test_a_stop_from_another_thread_breaks_off_who_waits(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Through the operating system's serial layer, in real time."""
    begun = threading.Event()
    with pty_rig(kind, tmp_path, home_s=20.0) as rig:
        rig.cnc.home()
        rig.cnc.move(x=rig.at(-60, 0, 0)[0], feed=600.0)
        caught: list[BaseException] = []
        where, name = (rig.clock, 'sleep_until') if kind == 'simulated' else (rig.cnc, '_require_ready')
        monkeypatch.setattr(where, name, noting(begun, getattr(where, name)))
        waiter = threading.Thread(target=lambda: caught.append(raised_by(rig.cnc.wait_idle)))
        waiter.start()
        assert begun.wait(30)
        monkeypatch.undo()
        rig.clock.sleep_until(rig.clock.now_ns() + 300_000_000)
        rig.cnc.stop()
        waiter.join(60)
        assert isinstance(caught[0], DeviceFaultError)
        assert 'stop' in str(caught[0])
        status = rig.cnc.status()
        assert status.homed
        assert status.position_mm == pytest.approx(rig.tip, abs=0.01)
        assert rig.at(-60, 0, 0)[0] < rig.tip[0] or kind == 'marlin'


def noting(event: threading.Event, call: Callable[..., object]) -> Callable[..., object]:
    """The same, and it is noted that it was called."""

    def noted(*args: object) -> object:
        event.set()
        return call(*args)

    return noted


def test_a_stop_just_before_the_simulated_machine_looks_whether_it_has_arrived_breaks_off_who_waits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The tip rests by then, and the time of its arrival is over."""
    rig = direct_rig('simulated')
    rig.cnc.connect()
    rig.cnc.home()
    rig.cnc.move(x=-60.0, feed=600.0)

    def stop_first() -> int:
        monkeypatch.undo()
        rig.cnc.stop()
        return rig.clock.now_ns()

    monkeypatch.setattr(rig.clock, 'now_ns', stop_first)
    with pytest.raises(DeviceFaultError, match='aborted by a stop'):
        rig.cnc.wait_idle()


def test_settings_come_from_a_parameter_file() -> None:
    values = {'source': '/dev/ttyUSB0', 'lowest_mm': [-90.0, -90.0, -40.0], 'accept': ['no homing']}
    settings = from_mapping(CncSettings, values)
    assert (settings.lowest_mm, settings.accept) == ((-90.0, -90.0, -40.0), ('no homing',))
    assert all(description.description for description in describe(CncSettings))
    for wrong in ({'accept': ['everything']}, {'lowest_mm': [1.0]}, {'kind': 'klipper'}, {'report_hz': 50.0}):
        with pytest.raises(ConfigurationError):
            from_mapping(CncSettings, wrong)


def test_a_retract_that_every_move_would_be_refused_for_is_refused_at_once() -> None:
    """Found only at the first retract, it would leave the tip in the gel: nothing else brings it up."""
    with pytest.raises(ConfigurationError, match='retract_mm_min, 600, must be at most fastest_mm_min, 500'):
        from_mapping(CncSettings, {'fastest_mm_min': 500.0})
    assert from_mapping(CncSettings, {'fastest_mm_min': 500.0, 'retract_mm_min': 500.0}).retract_mm_min == 500.0


def raised_by(call: object) -> BaseException:
    with pytest.raises(TactileError) as raised:
        call()  # type: ignore[operator]
    return raised.value


@pytest.mark.parametrize(
    ('settings', 'error', 'text'),
    [
        (CncSettings('/dev/ttyNONE'), 'DeviceNotFoundError', r'there is no serial port /dev/ttyNONE; '),
        (CncSettings('/dev/null'), 'DeviceNotFoundError', r'cannot open /dev/null as a serial port'),
        (CncSettings(), 'ConfigurationError', r'needs a simulated world; '),
        (CncSettings('/dev/null', 'marlin'), 'ConfigurationError', r'does not report its limits; set lowest_mm'),
    ],
)
def test_what_cannot_be_opened_is_one_clear_sentence(settings: CncSettings, error: str, text: str) -> None:
    with pytest.raises(TactileError, match=text) as raised:
        open_cnc(settings, SystemClock())
    assert type(raised.value).__name__ == error
    assert '\n' not in str(raised.value)
    assert re.search(r'[;,(]', str(raised.value))


@pytest.mark.parametrize(('device', 'driver'), [('marlin', GrblCnc), ('grbl', MarlinCnc)])
def test_the_wrong_protocol_is_named(device: str, driver: type[GrblCnc] | type[MarlinCnc]) -> None:
    clock = JumpingClock(START_NS)
    port = DirectPort(device_of(device, World(table=coarse_table()), clock), clock)
    settings = settings_of('marlin' if driver is MarlinCnc else 'grbl')
    with pytest.raises(DeviceTimeoutError, match=r'cnc\.kind'):
        driver(settings, clock, lambda: port, threaded=False).connect()
