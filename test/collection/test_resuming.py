"""Collecting into a bag, killed by SIGKILL at the worst moments: no press is lost, none is there twice."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path

from rehearsing import PLAN

from tactile_nodes.collection.audit import audit, bags_below, presses_in
from tactile_nodes.collection.journal import Journal
from tactile_nodes.collection.plan import make_plan

PROGRAM = Path(__file__).with_name('collecting.py')
ONCE = dict.fromkeys(range(1, 13), 1)


def collect(folder: Path, name: str, *where: str) -> int:
    command = [sys.executable, str(PROGRAM), str(folder), name, *where]
    ended = subprocess.run(command, env={**os.environ, 'PYTHONPATH': str(PROGRAM.parents[2])}, check=False)
    return ended.returncode


def held(folder: Path) -> dict[int, int]:
    """How often each press is in the bags as recorded."""
    found = Counter(press for bag in bags_below(folder) for press, _ in presses_in(bag, make_plan(PLAN).plan_id)[0])
    return dict(sorted(found.items()))


def test_run_that_is_killed_again_and_again_loses_and_repeats_nothing(tmp_path: Path) -> None:
    for where in ('started', 'bag', 'journal'):
        assert collect(tmp_path, f'killed {where}', where, '3') == -signal.SIGKILL
    assert collect(tmp_path, 'last') == 0
    assert held(tmp_path) == ONCE


def test_the_bag_decides_what_is_done(tmp_path: Path) -> None:
    assert collect(tmp_path, 'bag') == 0
    plan = make_plan(PLAN)
    shutil.copy(tmp_path / 'journal.jsonl', tmp_path / 'copy.jsonl')
    with Journal(tmp_path / 'copy.jsonl', plan) as journal:  # the bag was lost
        assert audit(journal, plan.plan_id, tmp_path / 'elsewhere', 0) == (0, 12)
        assert len(journal.left(plan.points, 3)) == 12
    with Journal(tmp_path / 'journal.jsonl', plan) as journal:
        assert audit(journal, plan.plan_id, tmp_path, 0) == (12, 0)
        assert audit(journal, plan.plan_id, tmp_path, 0) == (0, 0)
        assert not journal.left(plan.points, 3)
