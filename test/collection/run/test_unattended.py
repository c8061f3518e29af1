"""What a rig does unasked when nobody stands by, and what it does not."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest
from collecting import in_a_process
from rehearsing import ALL, SAFE_Z_MM, Run, changed

from tactile_nodes.collection.machine_record import BEGUN, MachineRecord
from tactile_nodes.collection.plan.plan import PlanSettings
from tactile_nodes.collection.press.up import bring_up
from tactile_nodes.collection.safety import MACHINE, OVERLOAD
from tactile_nodes.collection.wrench import Tare
from tactile_nodes.drivers.cnc.contract import CncState, CncStatus
from tactile_nodes.emulators.world import Wrench
from tactile_nodes.errors import DeviceFaultError

DEEP = [press for press in ALL if press % 2 == 0]  # 1.5 mm, which is more than 0.5 N
SOFT = {'force_n': 0.5, 'rejects_in_a_row': 20}


def steps(run: Run) -> list[tuple[int, str]]:
    lines = run.journal.path.read_text(encoding='ascii').splitlines()[1:]
    return [(entry['press'], entry['step']) for entry in map(json.loads, lines)]


def test_a_press_above_the_limit_ends_within_one_sample_and_its_point_is_put_aside_until_the_next_run(
    tmp_path: Path,
) -> None:
    run = Run(tmp_path, changed(limits=SOFT))
    ended = run.campaign.run()
    assert sorted(record.point.press for record in run.published) == ALL  # each once, attempts is 3
    assert sorted(run.recorded) == [press for press in ALL if press not in DEEP]
    deep = [record for record in run.published if record.point.press in DEEP]
    assert all('above the limit of 0.5 N' in record.reason for record in deep)
    # 100 samples a second and 1 mm/s: a sample is 0.01 mm, braking from 1 mm/s at 200 mm/s² 0.0025 mm.
    assert run.rig.safety.greatest_n < 0.5 + 0.05
    assert [press for press, step in steps(run) if step == 'aside'] == [
        r.point.press for r in run.published if r.reason
    ]
    assert ended.startswith('the plan is done except for presses that were set aside or rejected each time: 4 of 8 ')
    assert f'4 set aside until the next run (press {", ".join(map(str, DEEP))})' in ended
    assert run.height_mm == pytest.approx(SAFE_Z_MM, abs=0.01)


@pytest.mark.parametrize('killed', [False, True], ids=['ended', 'killed just before its end'])
def test_the_next_run_tries_what_was_put_aside_and_a_process_that_goes_on_after_a_kill_does_not(
    tmp_path: Path, killed: bool
) -> None:
    first = Run(tmp_path, changed(limits=SOFT))
    first.campaign.run()
    first.journal.close()
    if killed:
        lines = first.journal.path.read_text(encoding='ascii').splitlines(keepends=True)
        assert '"ended"' in lines[-1]
        first.journal.path.write_text(''.join(lines[:-1]), encoding='ascii')
    second = Run(tmp_path)
    second.campaign.run()
    assert sorted(second.recorded) == ([] if killed else DEEP)


def test_what_was_hit_is_written_down_before_the_tip_goes_up(tmp_path: Path) -> None:
    """A process that is killed on the way up must not press there again, nor go on unasked."""
    run, notes = Run(tmp_path), []

    def hit() -> None:
        run.push(0.05)
        run.after(0.2, lambda: notes.append((steps(run)[-2:], run.machine_steps)))
        run.after(5.0, lambda: setattr(run.rig.hands, 'asked_to_stop', True))

    run.at(3, run.in_the_gel(hit))
    run.campaign.run()
    assert notes == [([(3, 'started'), (3, 'aside')], ['begun', 'halted'])]
    assert [step for step in steps(run) if step[1] == 'aside'] == [(3, 'aside')]  # once
    assert run.machine_steps == ['begun', 'halted', 'ended']


def test_an_unbearable_force_that_ends_the_run_halts_the_machine_as_well(tmp_path: Path) -> None:
    """With a single attempt nothing is repeated; the run ends, but who starts the next one must look first."""
    run, notes = Run(tmp_path, changed(limits={'rejects_in_a_row': 1})), []
    retreat = run.rig.hands.retreat

    def up() -> None:
        notes.append(run.machine_steps)
        retreat()

    run.rig.hands.retreat = up  # type: ignore[method-assign]
    run.after(12.0, lambda: run.push(0.05))  # in the search for the surface
    with pytest.raises(DeviceFaultError, match='more than the bearable 5 N'):
        run.campaign.run()
    assert notes == [['begun', 'halted']]  # before the tip goes up
    assert run.machine_steps == ['begun', 'halted', 'ended']


def test_an_unbearable_force_while_homing_halts_the_machine(tmp_path: Path) -> None:
    run = Run(tmp_path)
    run.after(2.5, lambda: run.push(0.05))
    with pytest.raises(DeviceFaultError, match='more than the bearable 5 N'):
        run.campaign.run()
    assert run.printed[0] == 'homing' and not run.published
    assert run.machine_steps == ['begun', 'halted']


def test_an_unbearable_force_on_the_way_up_at_the_end_halts_the_machine(tmp_path: Path) -> None:
    run = Run(tmp_path)

    def stop() -> None:
        run.rig.hands.asked_to_stop = True
        run.after(0.1, lambda: run.push(0.3))

    run.at(3, run.in_the_gel(stop))
    assert 'stopped on request' in run.campaign.run()
    assert run.machine_steps == ['begun', 'halted', 'ended']
    assert run.height_mm == pytest.approx(SAFE_Z_MM, abs=0.01)


@pytest.mark.parametrize('saturated', [False, True], ids=['sensor silent', 'sensor saturated'])
def test_a_doubt_about_the_machine_lasts_until_a_force_says_that_nothing_touches(
    tmp_path: Path, saturated: bool
) -> None:
    """A jog fails, z sticks, and the sensor fails with it: the run's end says nothing of a tip that is up."""
    run = Run(tmp_path)

    def fault() -> None:
        jog = run.rig.cnc.jog

        def refuse(*_: object, **__: object) -> None:
            run.rig.cnc.jog = jog  # type: ignore[method-assign]
            run.world.stick(2, run.rig.clock.now_ns())
            if saturated:
                run.rig.safety.fail(MACHINE, 'it is elsewhere', run.rig.clock.now_ns())
                run.rig.safety.fail(OVERLOAD, 'saturated', run.rig.clock.now_ns())
            run.rig.silent_sensor = True
            raise DeviceFaultError('it came to rest elsewhere')

        run.rig.cnc.jog = refuse  # type: ignore[method-assign,assignment]

    run.at(3, run.in_the_gel(fault))
    with pytest.raises(DeviceFaultError):
        run.campaign.run()
    assert run.world.press_at(run.rig.clock.now_ns()).depth_mm > 0.3
    assert 'ended' not in run.machine_steps
    assert any('the tip may not be up' in said for said in run.printed)


def test_after_an_unbearable_force_nothing_moves_until_a_person_has_looked(tmp_path: Path) -> None:
    run = Run(tmp_path)
    places: list[tuple[float, float, float]] = []

    def look() -> None:
        if run.person.question:
            places.append(run.world.motor_at(run.rig.clock.now_ns()))

    def hit() -> None:
        run.push(0.05)
        run.after(15.0, run.person.acknowledge)

    run.at(3, run.in_the_gel(hit))
    run.rig.clock.every(1.0, look)
    run.campaign.run()
    question = next(
        line for line in run.printed if 'more than the bearable 5 N' in line and 'then type: answer' in line
    )
    assert 'check machine, tip and gel' in question
    assert len(places) > 13 and len(set(places)) == 1
    assert places[0][2] == pytest.approx(SAFE_Z_MM, abs=0.01)
    assert run.machine_steps == ['begun', 'halted', 'acknowledged', 'ended']
    assert len(run.recorded) == 7  # one is aside


def test_a_person_who_answers_much_later_finds_a_sensor_that_has_drifted(tmp_path: Path) -> None:
    """By 0.2 N, more than counts as nothing (0.05 N), while nothing moved and nothing touched."""
    run = Run(tmp_path)
    felt = run.world.wrench_at

    def drifted(time_ns: int) -> Wrench:
        fx, fy, fz, *torque = felt(time_ns)
        return (fx, fy, fz + 0.2, *torque)  # type: ignore[return-value]

    def hit() -> None:
        run.push(0.05)
        run.after(20.0, lambda: setattr(run.world, 'wrench_at', drifted))
        run.after(40.0, run.person.acknowledge)

    run.at(3, run.in_the_gel(hit))
    assert ': 7 of 8 presses recorded' in run.campaign.run()  # one is aside


def test_a_run_that_was_halted_and_stopped_is_asked_about_again_whatever_was_said(tmp_path: Path) -> None:
    first = Run(tmp_path)
    first.at(3, first.in_the_gel(lambda: first.push(0.05)))
    first.at(4, lambda: first.after(5.0, lambda: setattr(first.rig.hands, 'asked_to_stop', True)))
    assert 'stopped on request' in first.campaign.run()
    first.journal.close()
    second = Run(tmp_path, unasked=True)
    second.after(10.0, lambda: setattr(second.rig.hands, 'asked_to_stop', True))
    assert 'stopped on request' in second.campaign.run()
    assert any('the run was halted: the force is 6.' in line for line in second.printed)
    assert 'homing' not in second.printed


@pytest.fixture(scope='module')
def cut_off(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run that was killed at its third press."""
    folder = tmp_path_factory.mktemp('one')
    assert in_a_process(folder, 'killed', 'started', '3') == -9
    return folder


@pytest.fixture
def killed(cut_off: Path, tmp_path: Path) -> Path:
    """The same for a test alone."""
    return Path(shutil.copytree(cut_off, tmp_path / 'one'))


def test_after_a_kill_a_run_asks_before_it_homes_or_moves(killed: Path) -> None:
    run = Run(killed, unasked=False)
    start = run.world.motor_at(run.rig.clock.now_ns())
    places = []
    run.rig.clock.every(1.0, lambda: places.append(run.world.motor_at(run.rig.clock.now_ns())))
    run.after(20.0, lambda: places.append('answered') or run.person.acknowledge())
    run.campaign.run()
    assert 'cut off' in run.printed[0] and run.printed[0].endswith('then type: answer')
    assert set(places[: places.index('answered')]) == {start}
    assert run.journal.done == 8


def test_the_hours_of_a_run_begin_when_a_person_has_looked(tmp_path: Path) -> None:
    """Killed on a Friday evening, and looked at on Monday."""
    MachineRecord(tmp_path / 'machine.record').note(BEGUN, 1)
    run = Run(tmp_path, changed(limits={'hours': 0.03}), unasked=False)
    run.after(120.0, run.person.acknowledge)
    assert run.campaign.run().startswith('the plan is done: 8 of 8')


def test_the_hours_of_a_run_do_not_count_while_it_waits_for_a_person(tmp_path: Path) -> None:
    """Paused for 150 s and halted for 150 s, with 108 s for the presses, which take less."""
    run = Run(tmp_path, changed(limits={'hours': 0.03}))

    def hit() -> None:
        run.push(0.05)
        run.after(150.0, run.person.acknowledge)

    run.at(2, lambda: run.pause(150.0))
    run.at(4, run.in_the_gel(hit))
    assert ': 7 of 8 presses recorded' in run.campaign.run()  # one is aside


def test_after_a_kill_the_next_plan_in_another_folder_asks_as_well(killed: Path, tmp_path: Path) -> None:
    """What was cut off is a matter of the machine: nobody knows where its tip is, whatever is pressed next."""
    plan = PlanSettings(columns=2, rows=1, pitch_mm=2.0, depths_mm=(0.5,))
    run = Run(tmp_path / 'two', plan=plan, unasked=False, machine=killed / 'machine.record')
    start = run.world.motor_at(run.rig.clock.now_ns())
    run.after(10.0, lambda: setattr(run.rig.hands, 'asked_to_stop', True))
    assert 'stopped on request' in run.campaign.run()
    assert run.world.motor_at(run.rig.clock.now_ns()) == start
    assert re.fullmatch(
        r'the run before this one \(plan \w+ in .*/one0\) was cut off, so the position of the tip is unknown; .*',
        run.printed[0],
    )


def test_a_run_may_go_on_after_a_kill_where_a_person_said_so_beforehand(killed: Path) -> None:
    run = Run(killed, unasked=True)
    run.at(1, lambda: setattr(run.rig.hands, 'asked_to_stop', True))
    run.campaign.run()
    assert run.printed[0] == 'homing'
    assert run.recorded


def test_a_run_that_ended_with_the_tip_up_is_not_asked_about(tmp_path: Path) -> None:
    first = Run(tmp_path, unasked=False)
    first.at(4, first.in_the_gel(lambda: setattr(first.rig.hands, 'asked_to_stop', True)))
    first.campaign.run()
    first.journal.close()
    second = Run(tmp_path, unasked=False)
    second.at(1, lambda: setattr(second.rig.hands, 'asked_to_stop', True))
    second.campaign.run()
    assert second.printed[0] == 'homing'


def test_a_tip_that_did_not_come_up_is_asked_about(tmp_path: Path) -> None:
    first = Run(tmp_path)
    first.at(3, first.in_the_gel(lambda: first.world.stick(2, first.rig.clock.now_ns())))
    with pytest.raises(DeviceFaultError, match='remain after the tip went up'):
        first.campaign.run()
    assert any('the tip may not be up' in line and 'N remain' in line for line in first.printed)
    first.journal.close()
    second = Run(tmp_path, unasked=False)
    second.after(10.0, lambda: setattr(second.rig.hands, 'asked_to_stop', True))
    second.campaign.run()
    assert 'cut off' in second.printed[0]


def test_a_run_that_was_stopped_with_the_tip_in_the_gel_did_not_end_well(tmp_path: Path) -> None:
    """z sticks while the run is stopped. Nobody may read "stopped on request" and walk to the gel."""
    run = Run(tmp_path)

    def stop() -> None:
        run.world.stick(2, run.rig.clock.now_ns())
        run.rig.hands.asked_to_stop = True

    run.at(3, run.in_the_gel(stop))
    with pytest.raises(DeviceFaultError, match=r'the tip may not be up: .* N remain .*; nothing lifts it'):
        run.campaign.run()
    assert 'ended' not in run.machine_steps
    assert run.machine.question(unasked=False)


def test_torque_is_limited_where_nobody_set_a_limit(tmp_path: Path) -> None:
    run = Run(tmp_path)
    run.at(3, run.in_the_gel(lambda: run.push(0.05, (0.0, 0.0, 0.2, 0.25, 0.0, 0.0))))
    run.campaign.run()
    # 3 N across the end of a tool of 60 mm.
    assert run.published[3].reason == 'the torque is 0.250 N m, above the limit of 0.18 N m'


def test_a_board_that_restarted_and_says_idle_is_not_believed_to_be_up(tmp_path: Path) -> None:
    run = Run(tmp_path)
    machine = run.rig.cnc
    machine.retract = lambda: None  # type: ignore[method-assign]
    machine.status = lambda: CncStatus(CncState.IDLE, (0.0, 0.0, 0.0), False, 0, 0)  # type: ignore[method-assign]
    with pytest.raises(DeviceFaultError, match='unknown whether the tip is up'):
        run.rig.hands.retreat()


def test_a_machine_that_says_it_is_up_is_not_believed_against_the_force(tmp_path: Path) -> None:
    run = Run(tmp_path)
    nothing = (0.0,) * 6
    tare = Tare(nothing, nothing, 50, 0)
    run.rig.cnc.home()
    bring_up(run.rig.hands, tare, changed(), doubted=True)  # the force is none
    run.world.wrench_at = lambda _: (0.0, 0.0, 0.7, 0.0, 0.0, 0.0)  # type: ignore[method-assign]
    with pytest.raises(DeviceFaultError, match=r'0\.70 N remain although the machine reports the tip up'):
        bring_up(run.rig.hands, tare, changed())


def test_after_a_fault_of_the_machine_nothing_counts_as_up_that_no_force_confirms(tmp_path: Path) -> None:
    run = Run(tmp_path)
    nothing = (0.0,) * 6
    run.rig.cnc.home()
    run.rig.silent_sensor = True
    bring_up(run.rig.hands, Tare(nothing, nothing, 50, 0), changed())  # its word is enough while nothing is in doubt
    with pytest.raises(DeviceFaultError, match='no force sample shows it free'):
        bring_up(run.rig.hands, Tare(nothing, nothing, 50, 0), changed(), doubted=True)
