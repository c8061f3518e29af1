"""A guarded approach on the simulated rig, with the world itself as a perfect sensor of the force."""

from __future__ import annotations

import dataclasses
import json
import re
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import pytest
from quick_clock import QuickClock

from tactile_nodes.clock import NS_PER_S, SystemClock
from tactile_nodes.collection import readings
from tactile_nodes.collection.actions import Go, Look, Observation
from tactile_nodes.collection.machine_record import BEGUN, MachineRecord
from tactile_nodes.collection.press.guarded import Felt, GuardSettings
from tactile_nodes.collection.run import guarded_run
from tactile_nodes.collection.run.guarded_run import GuardedRun, GuardedRunSettings
from tactile_nodes.collection.run.person import Person
from tactile_nodes.collection.safety import OVERLOAD
from tactile_nodes.collection.settings import LimitSettings, PressSettings, SurfaceSettings
from tactile_nodes.drivers.cnc.contract import CncSettings, CncStatus
from tactile_nodes.drivers.force_torque.contract import ForceTorqueSettings, Sample
from tactile_nodes.emulators.world import WorldSettings
from tactile_nodes.errors import ConfigurationError, DeviceError, DeviceFaultError, DeviceTimeoutError
from tactile_nodes.messages import types

SAFE_Z_MM = -4.0
INVALID = types.ForceDistribution.STATUS_INVALID
QUICK = 5
RATE_HZ = 200.0
# Everything near the end switches, so that a run takes two seconds, of a clock that is five times as fast.
SETTINGS = GuardedRunSettings(
    guard=GuardSettings(hold_s=0.2, stale_ms=5000.0, seconds=300.0),
    limits=LimitSettings(force_silence_ms=10_000.0),
    press=PressSettings(tare_s=0.1),
    surface=SurfaceSettings(gel_x_mm=-3.0, gel_y_mm=-3.0, top_mm=-5.9),
    cnc=CncSettings(safe_z_mm=SAFE_Z_MM),
    force_torque=ForceTorqueSettings(rate_hz=RATE_HZ),
    world=WorldSettings(start_mm=(-3.0, -3.0, -1.0), gel_x_mm=-3.0, gel_y_mm=-3.0, gel_z_mm=-6.0),
    wait_s=0.5,
)


@contextmanager
def opened(
    feel: Callable[[GuardedRun, int], Felt | None], settings: GuardedRunSettings = SETTINGS
) -> Iterator[GuardedRun]:
    clock = QuickClock(QUICK)
    run = GuardedRun(settings, clock, lambda: feel(run, clock.now_ns()), Person('answer', print, clock))
    try:
        yield run
    finally:
        run.close()


def truth(run: GuardedRun, now_ns: int) -> Felt:
    assert run.station.world is not None
    return Felt(now_ns, run.station.world.wrench_at(now_ns)[2])


def slipping() -> Callable[[GuardedRun, int], Felt]:
    """The truth; z slips while the force is held, so the motor goes up alone, and the machine reports that it is up."""
    slipped: list[int] = []

    def feel(run: GuardedRun, now_ns: int) -> Felt:
        felt = truth(run, now_ns)
        if not slipped and abs(felt.force_n - SETTINGS.guard.target_n) <= SETTINGS.guard.band_n:
            assert run.station.world is not None
            run.station.world.stick(2, now_ns)
            slipped.append(now_ns)
        return felt

    return feel


def height_mm(run: GuardedRun) -> float:
    return run.station.cnc.status().position_mm[2]


def test_the_force_is_reached_held_reported_and_left() -> None:
    with opened(truth) as run:
        outcome = run.run()
        assert height_mm(run) == pytest.approx(SAFE_Z_MM, abs=0.01)
    guard = SETTINGS.guard
    assert outcome is not None
    for force_n in (outcome.gel_n, outcome.sensor_n):
        # It rests within the band as the sensor reported it then; noise of the sensor comes on top.
        assert force_n.mean() == pytest.approx(guard.target_n, abs=1.5 * guard.band_n)
    assert outcome.seconds >= guard.hold_s
    assert outcome.greatest_n <= guard.target_n + guard.band_n


def test_a_force_that_came_while_the_run_had_to_wait_is_not_from_the_future() -> None:
    calls = count()

    def feel(run: GuardedRun, now_ns: int) -> Felt:
        if next(calls) == 5:
            threading.Event().wait(1.0 / QUICK)
            now_ns += NS_PER_S
        return truth(run, now_ns)

    with opened(feel) as run:
        assert run.run() is not None


def test_a_force_that_is_not_held_is_reported_once_the_late_samples_of_the_force_sensor_have_come(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """From the hold on 0.5 s after they were measured, as on a busy computer."""
    felt_for = guarded_run.felt_for

    def then_late(*given: object) -> Iterator[Look]:
        yield from felt_for(*given)
        monkeypatch.setattr(run.station.readings, 'samples', late)

    monkeypatch.setattr(guarded_run, 'felt_for', then_late)
    with opened(truth, dataclasses.replace(SETTINGS, guard=dataclasses.replace(SETTINGS.guard, hold_s=0.0))) as run:
        come, clock = run.station.readings.samples, run._clock

        def late(since_ns: int) -> Sequence[Sample]:
            return [sample for sample in come(since_ns) if sample.stamp_ns < clock.now_ns() - NS_PER_S // 2]

        outcome = run.run()
        assert height_mm(run) == pytest.approx(SAFE_Z_MM, abs=0.01)
    assert outcome is not None
    assert (len(outcome.gel_n), len(outcome.sensor_n), outcome.seconds) == (1, 1, 0.0)
    assert outcome.sensor_n[0] == pytest.approx(SETTINGS.guard.target_n, abs=SETTINGS.guard.band_n + 0.03)


def test_the_force_sensor_tells_of_the_whole_hold_however_long_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    """Readings keep some seconds only; here as many as pass while a busy machine looks at them two seconds late."""
    kept_s = 2.0 * QUICK
    monkeypatch.setattr(readings, 'KEPT_NS', round(kept_s * NS_PER_S))
    guard = dataclasses.replace(SETTINGS.guard, hold_s=1.5 * kept_s)
    with opened(truth, dataclasses.replace(SETTINGS, guard=guard)) as run:
        outcome = run.run()
    assert outcome is not None
    # From the first to the last frame of the hold.
    assert len(outcome.sensor_n) == pytest.approx(RATE_HZ * outcome.seconds, abs=3)


def test_a_safe_height_that_may_be_in_the_gel_is_refused() -> None:
    surface = dataclasses.replace(SETTINGS.surface, top_mm=SAFE_Z_MM + 0.5)
    with pytest.raises(ConfigurationError, match=r'safe_z_mm is -4 mm, below surface\.top_mm, -3\.5 mm'):
        opened(truth, dataclasses.replace(SETTINGS, surface=surface)).__enter__()


def test_a_feed_that_could_not_be_stopped_in_time_is_refused() -> None:
    """5 mm/s and 77 ms to the stop are 0.4 mm, which on a stiff gel of 20 N/mm are 8 N."""
    limits = dataclasses.replace(SETTINGS.limits, stiffness_n_mm=20.0)
    with pytest.raises(ConfigurationError, match=r'approach_mm_min of 300 is too fast'):
        opened(truth, dataclasses.replace(SETTINGS, limits=limits)).__enter__()


def test_the_way_down_to_the_safe_height_could_be_stopped_in_time() -> None:
    """2 N/mm, 75 ms to the stop, 200 mm/s² and 2 N to spare allow 10 mm/s: a clamp may be in the way."""
    procedure = guarded_run.above_gel(SETTINGS, lambda: None)
    next(procedure)
    at_the_top = Observation(0, 0, (0.0, 0.0, SAFE_Z_MM + 3.0))
    up, sideways, down = (procedure.send(at_the_top) for _ in range(3))
    assert isinstance(up, Go) and isinstance(sideways, Go)
    assert (up.x, up.y, up.z, sideways.z) == (None, None, SAFE_Z_MM + 3.0, None)
    assert isinstance(down, Go)
    assert down.z == SAFE_Z_MM + 1.0
    assert down.feed_mm_min <= 600


def test_a_tip_that_was_left_low_goes_up_before_it_goes_sideways() -> None:
    """A machine without homing stays where somebody has left it."""
    procedure = guarded_run.above_gel(SETTINGS, lambda: None)
    next(procedure)
    up = procedure.send(Observation(0, 0, (0.0, 0.0, SAFE_Z_MM - 2.0)))
    assert isinstance(up, Go)
    assert (up.x, up.y, up.z) == (None, None, SAFE_Z_MM)


def test_it_stays_up_while_no_force_comes() -> None:
    with opened(lambda run, now_ns: None) as run:
        with pytest.raises(DeviceError, match=r'no valid force within 0\.5 s'):
            run.run()
        assert height_mm(run) == pytest.approx(SAFE_Z_MM, abs=0.01)


def test_the_rigs_own_limit_ends_it_where_the_gel_says_nothing() -> None:
    limits = dataclasses.replace(SETTINGS.limits, force_n=0.3)
    with opened(lambda run, now_ns: Felt(now_ns, 0.0), dataclasses.replace(SETTINGS, limits=limits)) as run:
        with pytest.raises(DeviceFaultError, match=r'gave up: the force is 0\.3\d N, above the limit of 0\.3 N'):
            run.run()
        assert height_mm(run) == pytest.approx(SAFE_Z_MM, abs=0.01)


def at_tenth(act: Callable[[GuardedRun], object]) -> Callable[[GuardedRun, int], Felt]:
    """True forces; with the tenth, something happens."""
    turn = count()

    def feel(run: GuardedRun, now_ns: int) -> Felt:
        if next(turn) == 10:
            act(run)
        return truth(run, now_ns)

    return feel


def test_stopped_it_goes_up_without_an_outcome() -> None:
    with opened(at_tenth(GuardedRun.stop)) as run:
        assert run.run() is None
        assert height_mm(run) == pytest.approx(SAFE_Z_MM, abs=0.01)


def test_a_report_that_is_lost_at_the_end_leaves_no_tip_down(monkeypatch: pytest.MonkeyPatch) -> None:
    turn = count()

    def failing(run: GuardedRun, now_ns: int) -> Felt:
        if next(turn) < 10:
            return truth(run, now_ns)
        status = run.station.cnc.status

        def lost() -> CncStatus:
            monkeypatch.setattr(run.station.cnc, 'status', status)
            raise DeviceTimeoutError('the machine does not answer')

        monkeypatch.setattr(run.station.cnc, 'status', lost)
        return Felt(now_ns, 0.0, INVALID, 2)

    with opened(failing) as run:
        with pytest.raises(DeviceFaultError, match='invalid for reasons 2'):
            run.run()
        assert height_mm(run) == pytest.approx(SAFE_Z_MM, abs=0.01)


def test_a_machine_that_lost_its_position_on_the_way_is_sent_up_or_told_of() -> None:
    """It says itself that it does not know its place: nothing was tried, and nothing said of a tip in the gel."""
    lost = at_tenth(lambda run: setattr(run.station.cnc, '_homed', False))
    with opened(lost) as run, pytest.raises(DeviceFaultError, match=r'the tip may not be up: .*before that: '):
        run.run()


def test_a_tip_that_is_still_felt_is_not_believed_to_be_up() -> None:
    with opened(slipping()) as run, pytest.raises(DeviceFaultError) as caught:
        run.run()
    # 0.2 N within the band of 0.005 N and the noise of the sensor.
    assert re.search(r': 0\.(19|20|21) N remain although the machine reports the tip up', str(caught.value))
    assert 'nothing lifts it when this program has ended' in str(caught.value)


def test_a_tip_is_not_believed_to_be_up_because_forces_come_late(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a busy computer none may come in the tenth of a second after the way up."""
    looks = count()
    with opened(slipping()) as run:
        hands = run.station.hands
        come, retreat = hands.readings.samples, hands.retreat

        def late(since_ns: int) -> Sequence[Sample]:
            return come(since_ns) if next(looks) >= 3 else []

        def up() -> None:
            retreat()
            monkeypatch.setattr(hands.readings, 'samples', late)

        monkeypatch.setattr(hands, 'retreat', up)
        with pytest.raises(DeviceFaultError, match='N remain although the machine reports the tip up'):
            run.run()


def test_what_ended_the_approach_is_reported_beside_a_tip_that_is_still_down() -> None:
    turn = count()

    def failing(run: GuardedRun, now_ns: int) -> Felt:
        felt = truth(run, now_ns)
        if felt.force_n < 0.1:
            return felt
        if next(turn) == 0:
            assert run.station.world is not None
            run.station.world.stick(2, now_ns)
        return Felt(now_ns, 0.0, INVALID, 2)

    with opened(failing) as run, pytest.raises(DeviceFaultError, match='N remain') as caught:
        run.run()
    assert re.search(r'\(before that: the force is invalid for reasons 2; .*\)$', str(caught.value))


def test_a_machine_that_failed_is_not_believed_to_be_up_without_a_force(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(run: GuardedRun) -> None:
        monkeypatch.setattr(run.station.readings, 'samples', lambda *_: [])
        monkeypatch.setattr(run.station.cnc, 'jog', refused(run, monkeypatch))

    with opened(at_tenth(fail)) as run:
        with pytest.raises(DeviceFaultError, match=r'unknown whether the tip is up.*before that: lines were lost'):
            run.run()
        assert height_mm(run) == pytest.approx(SAFE_Z_MM, abs=0.01)


def refused(run: GuardedRun, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """A jog that fails, once."""
    jog = run.station.cnc.jog

    def refuse(*_: float, **__: float) -> None:
        monkeypatch.setattr(run.station.cnc, 'jog', jog)
        raise DeviceFaultError('lines were lost')

    return refuse


def test_a_silent_force_sensor_raises_no_doubt_of_a_machine_that_did_all_it_was_asked(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    turn = count()

    def failing(run: GuardedRun, now_ns: int) -> Felt:
        if next(turn) < 10:
            return truth(run, now_ns)
        monkeypatch.setattr(run.station.readings, 'samples', lambda *_: [])
        return Felt(now_ns, 0.0, INVALID, 2)

    with opened(failing) as run, pytest.raises(DeviceFaultError, match=r'^the force is invalid for reasons 2'):
        run.run()


@pytest.fixture
def record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The record of the machine, as one that is not simulated has it."""
    monkeypatch.setattr(guarded_run, 'record_file', lambda *_: tmp_path / 'record')
    return tmp_path / 'record'


def wait_until(done: Callable[[], bool]) -> None:
    clock = SystemClock()
    deadline_ns = clock.now_ns() + 60 * NS_PER_S
    while not done():
        assert clock.now_ns() < deadline_ns
        clock.sleep_until(clock.now_ns() + NS_PER_S // 100)


def last_step(record: Path) -> str:
    return str(json.loads(record.read_text(encoding='ascii').splitlines()[-1])['step'])


@pytest.mark.parametrize('homed', [False, True])
def test_after_a_kill_nothing_moves_before_a_person_has_looked(record: Path, homed: bool) -> None:
    MachineRecord(record).note(BEGUN, 1, 'plan 0f3a in /data')
    with opened(truth) as run:
        if homed:
            run.station.cnc.home()  # a controller that the kill did not reach still knows where it is
        start = run.station.cnc.status().position_mm
        thread = threading.Thread(target=run.run)
        thread.start()
        wait_until(lambda: 'plan 0f3a in /data' in run._person.question)
        run.stop()
        thread.join()
        assert run.station.cnc.status().position_mm == start
    assert last_step(record) == 'begun'


def test_after_a_kill_it_goes_on_once_a_person_has_looked(record: Path) -> None:
    MachineRecord(record).note(BEGUN, 1)
    with opened(truth) as run:
        thread = threading.Thread(target=run.run)
        thread.start()
        wait_until(lambda: bool(run._person.question))
        assert run._person.acknowledge() == 'continuing'
        thread.join()
        assert height_mm(run) == pytest.approx(SAFE_Z_MM, abs=0.01)
    assert last_step(record) == 'ended'


def test_a_force_that_was_not_bearable_halts_whatever_is_started_next(record: Path) -> None:
    turn = count()

    def hit(run: GuardedRun, now_ns: int) -> Felt:
        if next(turn) == 10:
            assert run.station.world is not None
            run.station.world.wrench_at = lambda _: (0.0, 0.0, 6.0, 0.0, 0.0, 0.0)  # type: ignore[method-assign]
            return Felt(now_ns, 0.0)  # the gel does not feel it
        return truth(run, now_ns)

    with opened(hit) as run, pytest.raises(DeviceFaultError):
        run.run()
    with opened(truth, dataclasses.replace(SETTINGS, after_kill='go_on')) as run:
        thread = threading.Thread(target=run.run)
        thread.start()
        wait_until(lambda: 'more than the bearable 5 N' in run._person.question)
        run.stop()
        thread.join()


def test_a_force_that_was_not_bearable_on_the_way_up_after_a_stop_halts_as_well(record: Path) -> None:
    with opened(at_tenth(GuardedRun.stop)) as run:
        retreat = run.station.hands.retreat

        def up() -> None:
            run.station.safety.fail(OVERLOAD, 'saturated', run._clock.now_ns())
            retreat()

        run.station.hands.retreat = up  # type: ignore[method-assign]
        assert run.run() is None
    assert 'saturated' in MachineRecord(record).question(unasked=True)


def test_an_approach_that_a_person_need_not_be_asked_about_is_not(record: Path) -> None:
    MachineRecord(record).note(BEGUN, 1)
    with opened(truth, dataclasses.replace(SETTINGS, after_kill='go_on')) as run:
        assert run.run() is not None
    assert last_step(record) == 'ended'
