"""Collecting into a bag, killed by SIGKILL at the worst moments: no press is lost, none is there twice."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from rehearsing import ALL, PLAN, TABLE

from tactile_nodes import conversions, messages
from tactile_nodes.bag.metadata import FILE_NAME, BagTopic
from tactile_nodes.bag.writer import BagWriter
from tactile_nodes.collection.plan.audit import attempts_below, audit, bags_below, presses_in
from tactile_nodes.collection.plan.journal import Entry, Journal
from tactile_nodes.collection.plan.plan import make_plan
from tactile_nodes.collection.run.recall import recalled
from tactile_nodes.collection.run.run_messages import suspect_message
from tactile_nodes.messages import types

PROGRAM = Path(__file__).with_name('collecting.py')
ONCE = dict.fromkeys(ALL, 1)


def collect(folder: Path, *runs: str) -> list[int]:
    """How each run ended."""
    command = [sys.executable, str(PROGRAM), str(folder), *runs]
    environment = {**os.environ, 'PYTHONPATH': os.pathsep.join(str(PROGRAM.parents[up]) for up in (1, 3))}
    ended = subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE, text=True)
    return [int(line) for line in ended.stdout.split()]


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plan done by a run that was killed again and again."""
    folder = tmp_path_factory.mktemp('collected')
    killed = [f'killed_{where}:{where}:3' for where in ('started', 'bag', 'journal')]
    assert collect(folder, *killed, 'last') == [*[-signal.SIGKILL] * 3, 0]
    return folder


def held(folder: Path) -> dict[int, int]:
    """How often each press is in the bags as recorded."""
    found = Counter(press for bag in bags_below(folder) for press, _ in presses_in(bag, make_plan(PLAN).plan_id)[0])
    return dict(sorted(found.items()))


def test_run_that_is_killed_again_and_again_loses_and_repeats_nothing(folder: Path) -> None:
    assert held(folder) == ONCE


def test_press_that_was_recorded_is_found_again_with_its_images(folder: Path) -> None:
    plan = make_plan(PLAN)
    with Journal(folder / 'journal.jsonl', plan) as journal:
        entry = journal.last(plan.points[0].press)
    assert entry is not None
    record = recalled(folder, plan.plan_id, entry)
    assert record is not None
    assert record.point == pytest.approx(plan.points[0])
    assert len(record.rest) == 1 and len(record.frames) == 5
    assert -record.wrench[2] == pytest.approx(TABLE.force_at(record.point.depth_mm), abs=0.015)


def test_press_that_the_bag_calls_suspect_later_is_not_held(folder: Path, tmp_path: Path) -> None:
    plan = make_plan(PLAN)
    held = attempts_below(folder, plan.plan_id)
    doubted = Entry(*max(held), 'suspect', 0)
    writer = BagWriter(tmp_path / 'doubts')
    writer.add_topic(BagTopic.of_type('/press', 'tactile_nodes/msg/Press'))
    message = suspect_message(doubted, plan.plan_id, 'an axis sticks', 1, 'gel_surface')
    writer.write('/press', messages.encode(message), 1, 1)
    writer.close()
    for bag in bags_below(folder):
        (tmp_path / bag.name).symlink_to(bag)
    assert held - attempts_below(tmp_path, plan.plan_id) == {max(held)}


@pytest.mark.parametrize('left', [None, '', '\0' * 400])
def test_presses_of_a_bag_whose_metadata_a_power_cut_took_are_held(
    folder: Path, tmp_path: Path, left: str | None
) -> None:
    plan_id = make_plan(PLAN).plan_id
    shutil.copytree(folder / 'last', tmp_path / 'last')
    held = presses_in(tmp_path / 'last', plan_id)
    (tmp_path / 'last' / FILE_NAME).unlink()
    if left is not None:
        (tmp_path / 'last' / FILE_NAME).write_text(left, encoding='utf-8')
    assert presses_in(tmp_path / 'last', plan_id) == held
    assert held[0]


def two_rigs_in_a_bag(folder: Path, left_ns: list[int]) -> None:
    """A press of two images each. The left window is from 20 to 30 ns; left images are 1 grey, right ones 2."""
    writer = BagWriter(folder / 'bag')
    for side in ('left', 'right'):
        writer.add_topic(BagTopic.of_type(f'/{side}/press', 'tactile_nodes/msg/Press'))
        writer.add_topic(BagTopic.of_type(f'/{side}/press_image', 'sensor_msgs/msg/Image'))
    for side, stamps_ns, grey in (('left', left_ns, 1), ('right', [12, 22, 24], 2)):
        for stamp_ns in stamps_ns:
            image = conversions.image_message(np.full((16, 16), grey, np.uint8), conversions.header(stamp_ns, 'camera'))
            writer.write(f'/{side}/press_image', messages.encode(image), stamp_ns, stamp_ns)
    for side, plan_id, start_ns in (('left', 'a', 20), ('right', 'b', 15)):
        start, end = messages.time_from_ns(start_ns), messages.time_from_ns(30)
        press = types.Press(
            plan_id=plan_id, press=1, attempt=1, frames=2, window_start=start, window_end=end,
            status=types.Press.STATUS_RECORDED,
        )  # fmt: skip
        writer.write(f'/{side}/press', messages.encode(press), start_ns, start_ns)
    writer.close()


def test_a_press_whose_images_were_lost_is_not_complete_with_those_of_another_rig(tmp_path: Path) -> None:
    two_rigs_in_a_bag(tmp_path, [10, 21])
    assert attempts_below(tmp_path, 'a') == set()
    assert attempts_below(tmp_path, 'b') == {(1, 1)}


def test_a_press_is_found_again_with_the_images_of_its_own_rig(tmp_path: Path) -> None:
    two_rigs_in_a_bag(tmp_path, [10, 21, 23])
    record = recalled(tmp_path, 'a', Entry(1, 1, 'verified', 0))
    assert record is not None
    assert [(frame.stamp_ns, frame.image.max()) for frame in (*record.rest, *record.frames)] == [
        (10, 1), (21, 1), (23, 1),
    ]  # fmt: skip


def test_the_bag_decides_what_is_done(folder: Path, tmp_path: Path) -> None:
    plan = make_plan(PLAN)
    lines = (folder / 'journal.jsonl').read_text(encoding='utf-8').splitlines(keepends=True)
    last = [line for line in lines if 'verified' not in line]  # as it stood before anything was looked for
    for name in ('whole', 'lost'):
        (tmp_path / f'{name}.jsonl').write_text(''.join(last), encoding='utf-8')
    with Journal(tmp_path / 'lost.jsonl', plan) as journal:  # the bags were lost
        # One was killed before it could be noted as recorded, so nobody misses it.
        assert audit(journal, plan.plan_id, tmp_path / 'elsewhere', 0) == (0, 7)
        assert len(journal.left(plan.points, 3)) == 8
    with Journal(tmp_path / 'whole.jsonl', plan) as journal:
        assert audit(journal, plan.plan_id, folder, 0) == (8, 0)
        assert audit(journal, plan.plan_id, folder, 0) == (0, 0)
        assert not journal.left(plan.points, 3)
