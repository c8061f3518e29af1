"""Whole runs of a plan of eight presses in simulated time, undisturbed and with faults in the midst of them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from rehearsing import ALL, SAFE_Z_MM, TABLE, WORLD, Dots, Run, changed, reject

from tactile_nodes.collection.machine_record import MachineRecord
from tactile_nodes.collection.plan.journal import Journal
from tactile_nodes.collection.plan.plan import PlanSettings
from tactile_nodes.emulators.world import Wrench
from tactile_nodes.errors import BusError, ConfigurationError, DeviceError, DeviceFaultError, TactileError


@dataclass
class Undisturbed:
    """A run on a tilted gel in which nothing goes wrong, how it ended, and how far the machine would have gone on by
    itself at any time, beyond two jogs."""

    run: Run
    ended: str
    owed_mm: list[float]


@pytest.fixture(scope='module')
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Undisturbed:
    settings = dataclasses.replace(changed(), reference_every=3)
    tilted = dataclasses.replace(WORLD, slope_x=0.01, slope_y=-0.005)
    run = Run(tmp_path_factory.mktemp('run'), settings, world=tilted, rate_hz=100.0)
    now_ns, jogs_ns = run.rig.clock.now_ns, 520_000_000  # two of a quarter of a second, and the time to brake
    owed: list[float] = []

    def look() -> None:
        if run.published:
            soon, later = (run.world.motor_at(now_ns() + wait_ns) for wait_ns in (jogs_ns, 100 * jogs_ns))
            owed.append(math.dist(soon, later))

    run.rig.clock.every(0.05, look)
    return Undisturbed(run, run.campaign.run(), owed)


def test_each_press_of_a_plan_is_recorded_once(undisturbed: Undisturbed) -> None:
    run = undisturbed.run
    assert '8 of 8 presses recorded' in undisturbed.ended
    assert sorted(run.recorded) == ALL
    assert run.height_mm == pytest.approx(SAFE_Z_MM, abs=0.01)


def test_recorded_force_is_that_of_the_depth_on_a_tilted_gel(undisturbed: Undisturbed) -> None:
    for record in undisturbed.run.published:
        # The surface is found to about 0.02 mm, which is 0.012 N on the steepest part of the table.
        assert -record.wrench[2] == pytest.approx(TABLE.force_at(record.point.depth_mm), abs=0.015)


def test_images_and_samples_lie_within_the_window_and_rest_images_before_it(undisturbed: Undisturbed) -> None:
    for record in undisturbed.run.published:
        assert len(record.frames) == 5
        assert all(record.start_ns <= frame.stamp_ns <= record.end_ns for frame in record.frames)
        assert all(frame.stamp_ns < record.start_ns for frame in record.rest) and record.rest


def test_line_is_high_during_each_window_only(undisturbed: Undisturbed) -> None:
    run = undisturbed.run
    edges = run.world.line_edges()
    assert len(edges) == 2 + 16 + 2  # a pattern before the first press, and one after the last
    edges = edges[2:-2]
    for record, rise, fall in zip(run.published, edges[::2], edges[1::2], strict=True):
        assert rise.level and not fall.level
        assert rise.stamp_ns <= record.start_ns < record.end_ns <= fall.stamp_ns


def test_presses_that_no_bag_holds_are_made_again_before_the_run_ends(tmp_path: Path) -> None:
    run = Run(tmp_path)
    run.unrecorded = {4, 7}
    assert '8 of 8 presses recorded' in run.campaign.run()
    assert sorted(run.recorded) == sorted([*ALL, 4, 7])
    assert [record.attempt for record in run.published if record.point.press in {4, 7}][-2:] == [2, 2]
    assert any('presses in no bag: 2,' in line for line in run.printed)


def test_a_press_that_never_comes_into_a_bag_is_not_made_for_ever(tmp_path: Path) -> None:
    """The recorder writes to another folder than the one that is searched, or its disk is too slow."""
    run = Run(tmp_path)
    run.unrecorded = {5}
    for presses in (9, 10, 11):  # each time it was made again
        run.at(presses, lambda: run.unrecorded.add(5))
    with pytest.raises(BusError, match=r'no bag of the folder holds 1 presses, although they were made 3 times more'):
        run.campaign.run()
    assert run.recorded.count(5) == 4  # and `limits.attempts` is 3
    assert run.height_mm == pytest.approx(SAFE_Z_MM, abs=0.01)


def test_fast_rise_of_the_force_ends_the_press(tmp_path: Path) -> None:
    limits: dict[str, object] = {'bearable_n': 9.0, 'force_rate_n_s': 3.0, 'attempts': 1, 'rejects_in_a_row': 20}
    run = Run(tmp_path, changed(limits=limits, motion={'press_mm_min': 600.0}))
    run.campaign.run()  # 10 mm/s and half a newton a millimetre are 5 N/s
    assert any('N/s' in record.reason for record in run.published)


@pytest.mark.parametrize(
    ('fault', 'reason'),
    [('silent_sensor', 'has been silent'), ('silent_camera', 'the camera has sent no image')],
)
def test_silence_stops_the_tip_and_the_run_goes_on_when_it_is_over(tmp_path: Path, fault: str, reason: str) -> None:
    run = Run(tmp_path)

    def fall_silent() -> None:
        setattr(run.rig, fault, True)
        run.after(5.0, lambda: setattr(run.rig, fault, False))

    run.at(3, run.in_the_gel(fall_silent))
    run.campaign.run()
    assert reason in run.published[3].reason
    assert sorted(run.recorded) == ALL


def test_a_sensor_that_falls_silent_again_as_the_run_would_go_on_is_waited_for_again(tmp_path: Path) -> None:
    """It is well from 5 s on, believed from 7 s on, and fails as the run looks whether the tip is free."""
    run = Run(tmp_path)

    def fall_silent() -> None:
        run.rig.silent_sensor = True
        for after_s, silent in ((5.0, False), (6.99, True), (8.0, False)):
            run.after(after_s, lambda silent=silent: setattr(run.rig, 'silent_sensor', silent))

    run.at(3, run.in_the_gel(fall_silent))
    run.campaign.run()
    assert sum('waiting until it has recovered' in line for line in run.printed) == 2
    assert sorted(run.recorded) == ALL


def test_sensor_that_stays_silent_ends_the_run_with_the_tip_up(tmp_path: Path) -> None:
    run = Run(tmp_path)
    run.at(3, run.in_the_gel(lambda: setattr(run.rig, 'silent_sensor', True)))
    with pytest.raises(DeviceError, match='did not recover within 30 s'):
        run.campaign.run()
    assert run.height_mm == pytest.approx(SAFE_Z_MM, abs=0.01)


def test_axis_that_sticks_in_the_gel_ends_the_run_before_anything_moves_sideways(tmp_path: Path) -> None:
    run = Run(tmp_path)
    run.at(3, run.in_the_gel(lambda: run.world.stick(2, run.rig.clock.now_ns())))
    with pytest.raises(DeviceFaultError, match='remain after the tip went up'):
        run.campaign.run()
    press = run.published[3].point
    pressed = run.world.press_at(run.rig.clock.now_ns())
    assert (pressed.x_mm, pressed.y_mm) == pytest.approx((press.x_mm, press.y_mm), abs=0.01)


def test_axis_that_sticks_above_the_gel_ends_the_run_on_the_next_way_down(tmp_path: Path) -> None:
    run = Run(tmp_path, rate_hz=100.0)
    run.at(3, lambda: run.world.stick(2, run.rig.clock.now_ns()))
    with pytest.raises(DeviceFaultError, match='does z move'):
        run.campaign.run()
    assert len(run.published) == 4


def test_stop_in_the_gel_goes_up_and_the_next_run_does_the_rest_beginning_with_another_attempt(tmp_path: Path) -> None:
    first = Run(tmp_path)
    first.at(4, first.in_the_gel(lambda: setattr(first.rig.hands, 'asked_to_stop', True)))
    assert 'stopped on request' in first.campaign.run()
    assert first.height_mm == pytest.approx(SAFE_Z_MM, abs=0.01)
    first.journal.close()
    second = Run(tmp_path)
    second.campaign.run()
    assert second.published[0].attempt == 2
    assert sorted(first.recorded + second.recorded) == ALL


@pytest.mark.parametrize('silent', ['silent_camera', 'silent_sensor'])
def test_stop_of_a_whole_launch_leaves_no_tip_in_the_gel(tmp_path: Path, silent: str) -> None:
    """Camera and sensor end with the run; the guard, which finds them silent, stops the way up."""
    run = Run(tmp_path)

    def end_all() -> None:
        run.rig.hands.asked_to_stop = True
        setattr(run.rig, silent, True)

    run.at(4, run.in_the_gel(end_all))
    assert 'stopped on request' in run.campaign.run()
    assert run.rig.safety.trip is not None
    assert run.height_mm == pytest.approx(SAFE_Z_MM, abs=0.01)
    assert not any('may not be up' in line for line in run.printed)


def test_a_press_that_was_rejected_each_time_is_not_counted_as_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Run(tmp_path)
    reject(monkeypatch, lambda point: point.press == 5, 'the camera sees a fly')
    assert run.campaign.run() == (
        'the plan is done except for presses that were set aside or rejected each time: 7 of 8 presses '
        'recorded, 7 of them now; 3 attempts rejected (3 x the camera sees a fly)'
    )


def test_a_paused_run_waits_at_the_safe_height_and_counts_as_paused_only_while_nothing_moves(tmp_path: Path) -> None:
    """Who sees that the rig is paused may reach into it."""
    run = Run(tmp_path)
    places: set[tuple[float, float, float]] = set()

    def look() -> None:
        if run.campaign.stands:
            places.add(run.world.tip_at(run.rig.clock.now_ns()))

    run.at(5, run.in_the_gel(lambda: run.pause(20.0)))
    run.rig.clock.every(0.1, look)
    run.campaign.run()
    assert [z for _, _, z in places] == [pytest.approx(SAFE_Z_MM, abs=0.01)]
    assert not run.campaign.stands
    assert sorted(run.recorded) == ALL


def test_a_run_that_begins_paused_moves_nothing_until_it_may_go_on(tmp_path: Path) -> None:
    """Somebody works at the rig; its node was killed meanwhile, and `after_kill` lets the next one go on."""
    run = Run(tmp_path)
    run.campaign.paused = True
    start_mm = run.world.tip_at(run.rig.clock.now_ns())
    found_mm: list[tuple[float, float, float]] = []

    def resume() -> None:
        found_mm.append(run.world.tip_at(run.rig.clock.now_ns()))
        run.campaign.paused = False

    run.after(40.0, resume)  # longer than homing, the search for the surface and the first press
    run.campaign.run()
    assert found_mm == [pytest.approx(start_mm, abs=1e-9)]
    assert sorted(run.recorded) == ALL


@pytest.mark.parametrize('anchors', [0, 50])
def test_a_run_that_is_paused_at_its_last_press_waits_before_it_ends(anchors: int, tmp_path: Path) -> None:
    run = Run(tmp_path, changed(anchor={'every': anchors}), dots=Dots())
    deepest_mm: list[float] = []

    def pause() -> None:
        run.campaign.paused = True
        run.rig.clock.every(0.1, lambda: deepest_mm.append(run.world.press_at(run.rig.clock.now_ns()).depth_mm))
        run.after(20.0, lambda: (deepest_mm.append(math.inf), setattr(run.campaign, 'paused', False)))

    run.at(8, pause)
    run.campaign.run()
    assert math.inf in deepest_mm  # it was still there to be resumed
    assert max(deepest_mm[: deepest_mm.index(math.inf)]) <= 0


def test_rest_image_is_renewed(undisturbed: Undisturbed) -> None:
    assert len(undisturbed.run.rests) == 3  # at the start, after 3 and after 6


def test_recorder_that_goes_away_ends_the_run(tmp_path: Path) -> None:
    run = Run(tmp_path)

    def nobody() -> None:
        raise TactileError('nobody records')

    outlet = run.campaign._outlet
    run.at(2, lambda: object.__setattr__(outlet, 'require_recorder', nobody))
    with pytest.raises(TactileError, match='nobody records'):
        run.campaign.run()
    assert len(run.published) == 2
    assert run.height_mm == pytest.approx(SAFE_Z_MM, abs=0.01)


def test_safe_height_below_the_start_of_the_search_is_refused_before_anything_moves(tmp_path: Path) -> None:
    """For a thicker gel only the heights of the search were raised: the tip would go sideways through the gel."""
    with pytest.raises(ConfigurationError, match=r'safe_z_mm is -8 mm, below surface\.top_mm, -6 mm'):
        Run(tmp_path, changed(surface={'top_mm': -6.0, 'bottom_mm': -9.0}))


def test_plan_that_is_too_deep_is_refused_before_anything_moves(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r'limits\.depth_mm allows 1'):
        Run(tmp_path, changed(limits={'depth_mm': 1.0}))


@pytest.mark.parametrize('beyond', [3, 4])
def test_search_that_is_too_deep_is_refused_before_anything_moves(tmp_path: Path, beyond: int) -> None:
    """A step of 0.1 mm to contact and three more are 0.4 mm."""
    plan = PlanSettings(columns=2, rows=1, pitch_mm=2.0, depths_mm=(0.3,))
    settings = changed(limits={'depth_mm': 0.4}, surface={'beyond': beyond})
    if beyond == 3:
        Run(tmp_path, settings, plan)
        return
    with pytest.raises(ConfigurationError, match=r'search goes 0\.5 mm deep .*, limits\.depth_mm allows 0\.4'):
        Run(tmp_path, settings, plan)


def test_feed_that_cannot_be_stopped_in_time_is_refused_before_anything_moves(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r'motion\.approach_mm_min of 1200'):
        Run(tmp_path, changed(motion={'approach_mm_min': 1200.0}))


def test_gel_that_is_not_there_ends_the_run(tmp_path: Path) -> None:
    run = Run(tmp_path, world=dataclasses.replace(WORLD, gel_z_mm=-20.0))
    with pytest.raises(DeviceFaultError, match='met no surface'):
        run.campaign.run()
    assert not run.published


def test_two_runs_cannot_share_a_journal(tmp_path: Path) -> None:
    run = Run(tmp_path)
    with pytest.raises(ConfigurationError, match='in use'):
        Journal(run.journal.path, run.plan)


def test_machine_that_loses_its_master_comes_to_rest_within_two_jogs(undisturbed: Undisturbed) -> None:
    assert len(undisturbed.owed_mm) > 100
    assert max(undisturbed.owed_mm) == 0.0


@pytest.mark.parametrize(('silent', 'waiting'), [('silent_sensor', 'paused'), ('silent_camera', 'without a recorder')])
def test_a_device_that_falls_silent_while_the_run_waits_with_the_tip_up_is_waited_for(
    silent: str, waiting: str, tmp_path: Path
) -> None:
    run = Run(tmp_path)

    def wait(waits: bool) -> None:
        if waiting == 'paused':
            run.campaign.paused = waits
        else:
            run.recorder = not waits

    def begin() -> None:
        wait(True)
        run.after(5.0, lambda: setattr(run.rig, silent, True))
        run.after(7.0, lambda: setattr(run.rig, silent, False))
        run.after(12.0, lambda: wait(False))

    run.at(3, begin)
    assert run.campaign.run().startswith('the plan is done: 8 of 8')
    assert all(not record.reason for record in run.published)
    (line,) = [line for line in run.printed if 'waiting until it has recovered' in line]
    assert ('sensor' if silent == 'silent_sensor' else 'camera') in line


def test_a_sensor_that_drifts_during_a_long_pause_does_not_end_the_run(tmp_path: Path) -> None:
    """By 0.2 N in a minute. Then the camera is silent for a moment, after which nothing may touch: 0.05 N."""
    run = Run(tmp_path)
    felt = run.world.wrench_at

    def drifted(time_ns: int) -> Wrench:
        fx, fy, fz, *torque = felt(time_ns)
        minutes = min((time_ns - begun_ns[0]) / 60e9, 1.0)
        return (fx, fy, fz + 0.2 * minutes, *torque)  # type: ignore[return-value]

    begun_ns: list[int] = []

    def pause() -> None:
        run.pause(65.0)
        begun_ns.append(run.rig.clock.now_ns())
        run.world.wrench_at = drifted  # type: ignore[method-assign]
        run.after(60.0, lambda: setattr(run.rig, 'silent_camera', True))
        run.after(61.0, lambda: setattr(run.rig, 'silent_camera', False))

    run.at(3, pause)
    assert run.campaign.run().startswith('the plan is done: 8 of 8')
    assert all(not record.reason for record in run.published)


@pytest.mark.parametrize('waiting', ['paused', 'rest image', 'pattern'])
def test_a_bearable_force_while_the_tip_is_up_does_not_end_the_run(waiting: str, tmp_path: Path) -> None:
    """Somebody leans on the tool for two seconds: 4 N, above the limit of 3 N, but bearable."""
    settings = dataclasses.replace(changed(sync={'every': 3 if waiting == 'pattern' else 0}), reference_every=3)
    run = Run(tmp_path, settings)

    def begin() -> None:
        if waiting == 'paused':
            run.pause(10.0)
        after_s = {'paused': 0.6, 'rest image': 0.2, 'pattern': 1.0}[waiting]
        run.after(after_s, lambda: run.push(2.0, (0.0, 0.0, 4.0, 0.0, 0.0, 0.0)))

    run.at(3, begin)
    assert run.campaign.run().startswith('the plan is done: 8 of 8')
    assert all(not record.reason for record in run.published)
    assert run.rig.hands.safety.greatest_n == pytest.approx(4.0, abs=0.1)  # it was felt


@pytest.mark.parametrize('also', ['', 'silent_camera', 'silent_sensor'])
def test_a_hand_that_stays_on_the_tool_during_a_pause_does_not_end_the_run(also: str, tmp_path: Path) -> None:
    """It leans with 4 N, above the limit of 3 N, for two seconds, and then cleans the tip with 1 N for ten.

    Or a cable is pulled, the hand comes, and the cable is plugged in again.
    """
    run = Run(tmp_path)
    felt = run.world.wrench_at

    def lean(newton: float) -> Callable[[], None]:
        return lambda: setattr(run.world, 'wrench_at', lambda _: (0.0, 0.0, newton, 0.0, 0.0, 0.0))

    def pause() -> None:
        run.pause(20.0)
        for after_s, act in (
            (2.0, lean(4.0) if not also else lambda: setattr(run.rig, also, True)),
            (4.0, lean(1.0)),
            (5.0, lambda: setattr(run.rig, also, False) if also else None),
            (14.0, lambda: setattr(run.world, 'wrench_at', felt)),
        ):
            run.after(after_s, act)

    run.at(3, pause)
    assert run.campaign.run().startswith('the plan is done: 8 of 8')
    assert all(not record.reason for record in run.published)


def test_an_unbearable_force_during_a_pause_halts_the_run(tmp_path: Path) -> None:
    """Somebody leans on the tool and stays: 6 N, more than the bearable 5."""
    run = Run(tmp_path)

    def pause() -> None:
        run.campaign.paused = True
        run.after(5.0, lambda: run.push(3600.0))

    run.at(3, pause)
    with pytest.raises(DeviceFaultError, match='remain although the machine reports the tip up'):
        run.campaign.run()
    question = MachineRecord(tmp_path / 'machine.record').question(unasked=True)  # of the next one, first
    assert 'more than the bearable 5 N' in question
