"""The journal: nothing lost, nothing twice, whatever becomes of its end."""

from __future__ import annotations

import os
import resource
import signal
from pathlib import Path

import pytest

from tactile_nodes.collection.plan.audit import settle
from tactile_nodes.collection.plan.journal import (
    ASIDE,
    MISSING,
    RECORDED,
    REJECTED,
    STARTED,
    VERIFIED,
    Entry,
    Journal,
)
from tactile_nodes.collection.plan.plan import numbered
from tactile_nodes.errors import ConfigurationError, TactileError

PLAN = numbered([(float(x), 0.0, 1.0) for x in range(5)])


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / 'journal.jsonl'


def numbers(journal: Journal) -> list[int]:
    return [point.press for point in journal.left(PLAN.points, 3)]


def test_recorded_press_is_not_done_again(file: Path) -> None:
    with Journal(file, PLAN) as journal:
        journal.note(2, 1, STARTED, 10)
        journal.note(2, 1, RECORDED, 20)
    with Journal(file, PLAN) as journal:
        assert numbers(journal) == [1, 3, 4, 5]
        assert journal.done == 1


def test_press_that_was_only_started_is_done_again_under_another_number(file: Path) -> None:
    with Journal(file, PLAN) as journal:
        journal.note(3, 1, STARTED, 10)
    with Journal(file, PLAN) as journal:
        assert 3 in numbers(journal)
        assert journal.next_attempt(3) == 2


def test_a_plan_that_is_begun_anew_is_done_whole_again_under_other_numbers(file: Path) -> None:
    with Journal(file, PLAN) as journal:
        for press, step in ((1, RECORDED), (2, VERIFIED), (3, STARTED)):
            journal.note(press, 1, STARTED, 10)
            journal.note(press, 1, step, 20)
    with Journal(file, PLAN) as journal:
        assert journal.begin_anew(30) == 2
        assert numbers(journal) == [1, 2, 3, 4, 5]
        assert [journal.next_attempt(press) for press in (1, 2, 3, 4)] == [2, 2, 2, 1]
    with Journal(file, PLAN) as journal:
        assert journal.done == 0


def test_a_plan_that_is_begun_anew_leaves_out_nothing_that_a_killed_run_had_set_aside(file: Path) -> None:
    with Journal(file, PLAN) as journal:
        for step in (STARTED, ASIDE):
            journal.note(2, 1, step, 10)
    with Journal(file, PLAN) as journal:
        assert numbers(journal) == [1, 3, 4, 5]
        assert journal.begin_anew(30) == 0
        assert numbers(journal) == [1, 2, 3, 4, 5]
        assert journal.aside == []
    with Journal(file, PLAN) as journal:
        assert numbers(journal) == [1, 2, 3, 4, 5]


def test_what_a_search_of_the_bags_finds_waits_for_the_disk_once(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A disk takes some milliseconds each time: minutes for the presses of a large plan."""
    with Journal(file, PLAN) as journal:
        for press in (1, 2, 3):
            journal.note(press, 1, STARTED, 10)
            journal.note(press, 1, RECORDED, 20)
        waits, fsync = [], os.fsync
        monkeypatch.setattr(os, 'fsync', lambda opened: waits.append(fsync(opened)))
        assert settle(journal, {(1, 1), (3, 1)}, 30) == (2, 1)
        assert len(waits) == 1
        assert journal.begin_anew(40) == 2
        assert len(waits) == 2
    with Journal(file, PLAN) as journal:
        assert [journal.last(press) for press in (1, 2, 3)] == [
            Entry(1, 1, MISSING, 40, 'the plan was started anew'),
            Entry(2, 1, MISSING, 30, 'not found in any bag of the folder'),
            Entry(3, 1, MISSING, 40, 'the plan was started anew'),
        ]


def test_press_is_given_up_after_so_many_rejections_until_the_next_run(file: Path) -> None:
    with Journal(file, PLAN) as journal:
        for attempt in (1, 2, 3):
            journal.note(4, attempt, STARTED, 10)
            journal.note(4, attempt, REJECTED, 20, 'not steady')
        assert numbers(journal) == [1, 2, 3, 5]
    with Journal(file, PLAN) as journal:  # who starts again has set right what was wrong
        assert numbers(journal) == [1, 2, 3, 4, 5]
        assert journal.next_attempt(4) == 4


def test_journal_that_was_cut_at_any_byte_of_its_last_line_reads_as_without_it(file: Path) -> None:
    with Journal(file, PLAN) as journal:
        journal.note(1, 1, STARTED, 10)
        journal.note(1, 1, RECORDED, 20)
    complete = file.read_bytes()
    start = complete.rfind(b'\n', 0, -1) + 1
    for cut in range(start + 1, len(complete)):
        file.write_bytes(complete[:cut])
        with Journal(file, PLAN) as journal:
            assert journal.repaired
            assert numbers(journal) == [1, 2, 3, 4, 5]
            assert journal.next_attempt(1) == 2
        assert file.read_bytes() == complete[:start]


def test_damage_before_the_end_is_refused_with_its_line(file: Path) -> None:
    with Journal(file, PLAN) as journal:
        journal.note(1, 1, STARTED, 10)
    file.write_bytes(file.read_bytes().replace(b'"press": 1', b'"press": x') + b'{}\n')
    with pytest.raises(ConfigurationError, match=r'jsonl:2: .* damaged'):
        Journal(file, PLAN)


def test_journal_of_another_plan_is_refused(file: Path) -> None:
    Journal(file, PLAN).close()
    with pytest.raises(ConfigurationError, match='another folder'):
        Journal(file, numbered([(0.0, 0.0, 1.0)]))


def test_folder_that_cannot_be_made_is_reported(tmp_path: Path) -> None:
    (tmp_path / 'taken').write_text('')
    with pytest.raises(ConfigurationError, match=r'cannot open the journal .*taken.deeper.j\.jsonl'):
        Journal(tmp_path / 'taken' / 'deeper' / 'j.jsonl', PLAN)


def test_verified_press_is_not_looked_for_again(file: Path) -> None:
    with Journal(file, PLAN) as journal:
        for press in (1, 2):
            journal.note(press, 1, RECORDED, 20)
        journal.note(1, 1, VERIFIED, 30)
        assert [entry.press for entry in journal.unverified()] == [2]


def test_full_disk_that_takes_half_an_entry_leaves_a_journal_that_can_be_gone_on_with(file: Path) -> None:
    with Journal(file, PLAN) as journal:
        journal.note(1, 1, STARTED, 10)
        size, before = file.stat().st_size, resource.getrlimit(resource.RLIMIT_FSIZE)
        heed = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size + 20, before[1]))
        try:
            with pytest.raises(TactileError, match='cannot write the journal'):
                journal.note(1, 1, RECORDED, 20)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
            signal.signal(signal.SIGXFSZ, heed)
        assert file.stat().st_size == size
        assert not journal.is_done(1)
        journal.note(2, 1, STARTED, 30)
    with Journal(file, PLAN) as journal:
        assert not journal.repaired
        assert numbers(journal) == [1, 2, 3, 4, 5]
