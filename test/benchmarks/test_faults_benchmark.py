"""The bench of faults judges rightly: its audit on a real bag, and how it reads a trace."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from benchmarks.collection import Collection, Session
from benchmarks.faults import CASES, is_good, markdown
from benchmarks.faults.audit import Ledger, Trace, ledger
from tactile_nodes.clock import NS_PER_S
from tactile_nodes.collection.plan.plan import PlanSettings, make_plan
from tactile_nodes.emulators.world import WorldSettings
from tactile_nodes.nodes.emulated_rig import EmulatedRigParams
from tactile_nodes.params import from_mapping

PLAN = PlanSettings(columns=2, rows=1, pitch_mm=5.0, depths_mm=(0.8,))
MS = 1_000_000


class Rehearsed:
    """A run in simulated time, whose tip is traced as on the emulated rig; `act` comes with the tip in the gel."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.collection = Collection(Session(folder, PLAN, rate_hz=100.0, fps=10.0, compression='none'))
        self.rig = self.collection._rig
        self.lines: list[str] = []
        self.rig.clock.every(0.02, self._look)
        self._acts: list[Callable[[], None]] = []

    def in_the_gel_of_a_press(self, act: Callable[[], None]) -> None:
        self._acts.append(act)

    def after(self, seconds: float, act: Callable[[], None]) -> None:
        due_ns = self.rig.clock.now_ns() + round(seconds * NS_PER_S)
        done: list[bool] = []

        def look() -> None:
            if not done and self.rig.clock.now_ns() >= due_ns:
                done.append(True)
                act()

        self.rig.clock.every(0.01, look)

    def run(self) -> Ledger:
        self.collection.run()
        (self.folder / 'trace').write_text('\n'.join(self.lines))
        return audited(self.folder)

    def _look(self) -> None:
        now_ns, world = self.rig.clock.now_ns(), self.rig.world
        self.lines.append(json.dumps({'at': now_ns, 'tip': world.tip_at(now_ns), 'force': world.force_at(now_ns)}))
        pressing = self.collection._campaign.now is not None and world.press_at(now_ns).depth_mm > 0.3
        if self._acts and pressing:
            self._acts.pop()()


@pytest.fixture(scope='module')
def silenced(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Ledger]:
    """What a run leaves whose sensor fell silent in the gel, for 2.5 s."""
    folder = tmp_path_factory.mktemp('silenced')
    run = Rehearsed(folder)

    def fall_silent() -> None:
        run.rig.silent_sensor = True
        run.after(2.5, lambda: setattr(run.rig, 'silent_sensor', False))

    run.in_the_gel_of_a_press(fall_silent)
    return folder, run.run()


def audited(folder: Path) -> Ledger:
    plan, world = make_plan(PLAN), WorldSettings()
    trace = Trace(folder / 'trace', (world.gel_x_mm, world.gel_y_mm, world.gel_z_mm))
    return ledger(folder, plan.points, plan.plan_id, trace)


def test_sensor_that_falls_silent_in_the_gel_costs_no_point(silenced: tuple[Path, Ledger]) -> None:
    folder, kept = silenced
    assert kept == Ledger(2, (), (), (), (), ())
    assert 'silent' in (folder / f'{make_plan(PLAN).plan_id}.jsonl').read_text()


def test_audit_finds_a_bag_that_is_there_twice(silenced: tuple[Path, Ledger], tmp_path: Path) -> None:
    shutil.copytree(silenced[0], tmp_path / 'run')
    shutil.copytree(tmp_path / 'run' / 'collected_1', tmp_path / 'run' / 'collected_2')
    assert audited(tmp_path / 'run').doubled == (1, 2)


def test_audit_finds_a_bag_that_is_gone(silenced: tuple[Path, Ledger], tmp_path: Path) -> None:
    shutil.copytree(silenced[0], tmp_path / 'run')
    shutil.rmtree(tmp_path / 'run' / 'collected_1')
    assert audited(tmp_path / 'run').lost == (1, 2)


def traced(folder: Path, heights: list[float]) -> Trace:
    lines = [
        json.dumps({'at': 10 * MS * number, 'tip': [1.0, 2.0, z], 'force': -z}) for number, z in enumerate(heights)
    ]
    (folder / 'trace').write_text('\n'.join([*lines, '{"at": 99']))  # cut off by a kill
    return Trace(folder / 'trace', (1.0, 1.0, 0.0))


def test_stop_is_when_the_tip_goes_no_deeper(tmp_path: Path) -> None:
    down, rest, up = list(np.linspace(0, -0.3, 31)), [-0.3] * 20, list(np.linspace(-0.3, 2.0, 24))
    stop = traced(tmp_path, [*down, *rest, *up]).stop(100 * MS, 2000 * MS, safe_mm=2.0)
    assert stop is not None
    assert stop.rest_s == pytest.approx(0.2)  # from 0.1 s to the end of the descent at 0.3 s
    assert stop.way_mm == pytest.approx(0.2)
    assert stop.up_s == pytest.approx(0.64)  # 10 ms a line: the 75th is the first within 0.02 mm of the height
    assert stop.force_n == pytest.approx(0.3)


def test_tip_that_stays_in_the_gel_is_reported(tmp_path: Path) -> None:
    stop = traced(tmp_path, [*np.linspace(0, -0.3, 31), *[-0.3] * 20]).stop(0, 2000 * MS, safe_mm=2.0)
    assert stop is not None
    assert stop.up_s is None
    assert stop.left_mm == pytest.approx(0.3)


def test_every_fault_is_one_that_the_emulated_rig_knows() -> None:
    for case in CASES:
        faults = {f'faults.{name}': value for name, value in case.switch.items()}
        from_mapping(EmulatedRigParams, faults, source=case.name)


def test_run_with_a_wrong_point_is_not_good() -> None:
    row = {'problem': '', 'stop': None, 'statuses': [0], 'told': ['all | well'], 'ledger': {'lost': (), 'wrong': ()}}
    row['ledger'] |= {'left': (), 'doubled': (), 'faint': ()}
    assert is_good(row)
    row['ledger'] |= {'wrong': (3,)}
    assert not is_good(row)
    assert ' all / well |' in markdown({'faults': {'none': row}})
