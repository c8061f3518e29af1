"""A machine that lost its position with the tip in the gel: straight up, once, and nothing counts as up after that."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

import pytest
from cnc_rigs import direct_rig
from test_cnc_faults import SURFACE_MM, PressRig, press_rig

from tactile_nodes.collection.hands import TrippedError
from tactile_nodes.drivers.cnc.dead_man import Step
from tactile_nodes.drivers.cnc.grbl import GrblCnc
from tactile_nodes.drivers.health import Level
from tactile_nodes.errors import DeviceError, DeviceFaultError

SAFE_MM, JOGS_MM = -25.0, 0.5  # of the world; two jogs that were sent and perhaps not made


def fall_silent(rig: PressRig, how: str, seconds: float) -> None:
    """In the gel; over after so many seconds, whatever anybody waits for."""
    watch, over_ns = rig.clock.watch, []

    def switch(on: bool) -> None:
        if how == 'hung':
            rig.device.faults.hung = on
        else:
            rig.faults.mute, rig.faults.deaf = on, on and how == 'cut'

    def begin() -> None:
        switch(True)
        over_ns.append(rig.clock.now_ns() + round(seconds * 1e9))

    def look() -> None:
        watch()
        if over_ns and rig.clock.now_ns() >= over_ns[0]:
            over_ns.clear()
            switch(False)

    rig.clock.watch = look
    with pytest.raises((DeviceError, TrippedError)):
        rig.press(begin)


def height_mm(rig: PressRig) -> float:
    return rig.world.tip_at(rig.clock.now_ns())[2]


@pytest.mark.parametrize(
    ('kind', 'how'),
    [
        *((kind, how) for kind in ('grbl', 'marlin') for how in ('mute', 'hung', 'cut')),
        ('grblhal', 'mute'),
        ('marlin without M503', 'hung'),
    ],
)
def test_a_machine_that_answers_again_after_long_is_sent_up_but_not_believed(kind: str, how: str) -> None:
    rig = press_rig(kind)
    fall_silent(rig, how, 14.0)
    with pytest.raises(DeviceFaultError, match=r'its position is unknown; .* it was sent \d\.\d\d mm up'):
        rig.hands.retreat()
    assert SAFE_MM - 0.01 < height_mm(rig) < SAFE_MM + JOGS_MM + 0.01
    assert rig.deepest_mm < 1.0
    for _ in range(2):  # a second way up of that length could end at the frame
        with pytest.raises(DeviceFaultError, match='position is unknown'):
            rig.hands.retreat()
    assert height_mm(rig) < SAFE_MM + JOGS_MM + 0.01
    with pytest.raises(DeviceFaultError):
        rig.cnc.jog(dz=-0.1, feed=60.0)


@pytest.mark.parametrize(
    ('kind', 'how', 'seconds'),
    [
        *(('marlin', how, seconds) for how, seconds in (('mute', 0.4), ('cut', 0.4), ('mute', 2.0), ('hung', 2.0))),
        ('marlin without M503', 'cut', 0.4),
        ('marlin realtime', 'mute', 2.0),
    ],
)
def test_a_marlin_of_which_some_answers_were_lost_goes_up_and_knows_its_place(
    kind: str, how: str, seconds: float
) -> None:
    """One lost ok of a Marlin was waited for for ever, with the tip in the gel."""
    rig = press_rig(kind)
    fall_silent(rig, how, seconds)
    rig.hands.retreat()
    assert height_mm(rig) == pytest.approx(SAFE_MM, abs=0.01)
    assert rig.cnc.status().homed
    rig.cnc.jog(dz=-1.0, feed=60.0)
    rig.cnc.wait_idle()
    assert height_mm(rig) == pytest.approx(SAFE_MM - 1.0, abs=0.01)


def test_a_grbl_of_which_one_ok_is_lost_is_sent_up() -> None:
    """It reports its place all the while, but the line may have been lost as well as its answer."""
    rig = press_rig('grbl')
    with pytest.raises(DeviceError, match='did not respond'):
        rig.press(lambda: rig.faults.change('<', b'ok', b'k'))
    with pytest.raises(DeviceFaultError, match=r'its position is unknown; .* it was sent \d\.\d\d mm up'):
        rig.hands.retreat()
    assert SAFE_MM - 0.01 < height_mm(rig) < SAFE_MM + JOGS_MM + 0.01


@pytest.mark.parametrize('kind', ['grbl', 'marlin'])
def test_a_machine_that_stays_silent_is_waited_for_as_long_as_any_device(kind: str) -> None:
    rig = press_rig(kind)
    fall_silent(rig, 'hung', 1000.0)
    begin = rig.seconds()
    with pytest.raises(DeviceError, match='respon'):
        rig.hands.retreat()
    assert 30.0 <= rig.seconds() - begin < 45.0  # limits.recover_s, and the last attempt


@pytest.mark.parametrize('kind', ['grbl', 'grblhal', 'marlin'])
def test_a_machine_that_restarts_in_mid_press_is_sent_up_from_where_it_is_unless_it_is_locked(kind: str) -> None:
    """Its banner says so, also that of a board that showed none when its port was opened."""
    rig = press_rig(kind)
    with pytest.raises(DeviceFaultError, match='restarted by itself, so its position is unknown'):
        rig.press(rig.device.power_cycle)
    assert rig.rest() < 0.5
    with contextlib.suppress(DeviceFaultError):  # a Marlin answers nothing more
        assert not rig.cnc.status().homed
    assert (rig.cnc.health.level, rig.cnc.health.silent) == (Level.ERROR, False)
    low_mm, sent = height_mm(rig), r'.* it was sent \d\.\d\d mm up' if kind == 'marlin' else ''
    with pytest.raises(DeviceFaultError, match=f'restarted by itself, so its position is unknown{sent}'):
        rig.hands.retreat()
    if kind == 'marlin':
        assert SAFE_MM - 0.01 < height_mm(rig) < SAFE_MM + JOGS_MM + 0.01
    else:
        assert height_mm(rig) == low_mm < SURFACE_MM


# The watchdog program.


def watched(rig: PressRig) -> list[Step]:
    """What the watchdog program of this machine would send, and when; homes it."""
    kept: list[Step] = []

    def keep(steps: Sequence[Step]) -> None:
        kept.extend(steps)

    rig.cnc._keep_watch = keep
    rig.cnc.home()
    return kept


@pytest.mark.parametrize('kind', ['grbl', 'grblhal'])
def test_the_watchdog_lifts_the_tip_also_out_of_a_hold(kind: str) -> None:
    """A process that is killed between the hold and the reset of a stop leaves a machine that refuses each jog."""
    rig = press_rig(kind)
    steps = watched(rig)
    rig.go(-60.0, -60.0, -25.0)
    rig.go(-60.0, -60.0, -31.0)
    for wait_s, data in [(0.0, b'!'), *steps, (5.0, b'')]:  # the driver is dead, and reads nothing any more
        rig.clock.sleep_until(rig.clock.now_ns() + round(wait_s * 1e9))
        rig.device.run()
        rig.device.receive(data)
    assert height_mm(rig) == pytest.approx(SAFE_MM, abs=0.01)
    assert rig.deepest_mm == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    ('kind', 'more', 'stays'),
    [
        ('grbl', {}, True),
        ('grbl', {'changes': ('$22=0',), 'accept': ('no homing',)}, False),  # would obey after a restart, from 0
        ('marlin', {}, False),
    ],
)
def test_the_watchdog_stays_on_watch_over_a_silent_machine_that_locks_itself(
    kind: str, more: dict[str, tuple[str, ...]], stays: bool
) -> None:
    farewells: list[str] = []

    class Watch:
        on_watch = True

        def say_farewell(self) -> None:
            farewells.append('farewell')

        def dismiss(self) -> None:
            """Nothing to end."""

    rig = direct_rig(kind, **more)  # type: ignore[arg-type]
    rig.cnc.connect()
    rig.cnc.home()
    rig.cnc._dead_man = Watch()
    rig.device.faults.hung = True
    with contextlib.suppress(DeviceError):
        rig.cnc.set_line(True)
    assert 'stopped responding' in rig.cnc.health.message
    assert farewells == ([] if stays else ['farewell'])
    if isinstance(rig.cnc, GrblCnc) and stays:
        rig.cnc._dialogue.lose_place('was restarted', obeys_upwards=True)
        assert farewells == ['farewell']
