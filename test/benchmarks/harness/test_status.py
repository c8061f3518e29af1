"""`tactile bench status`, on a small repository whose history is written by hand."""

from __future__ import annotations

import argparse
import dataclasses
import json
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from benchmarks.catalogue import BENCHMARKS
from benchmarks.harness import status
from benchmarks.harness.declaration import Benchmark
from benchmarks.harness.history import describe
from tactile_nodes.paths import share_directory


def page(result: Mapping[str, Any]) -> str:
    return f'# Counted to {result["to"]}'


COUNTING = Benchmark(
    name='counting', about='Counts.', sources=('package/counting/**', 'models/**'), page=page,
    measure=lambda *_: {}, files=('counting.json', 'counting.md'),
)  # fmt: skip


class Repository:
    """A checkout with one source, one other file, and one result of a benchmark."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.git('init', '-q')
        self.write('package/counting/deep/source.py', '1')
        self.write('models/model', '1')
        self.write('README', '1')
        self.first = self.commit()
        self.keep({'commit': self.first[:12], 'to': 3})
        self.write('docs/results/counting.md', '# Counted to 3\n')
        self.commit()

    def git(self, *words: str) -> str:
        who = ('-c', 'user.name=a', '-c', 'user.email=a@b')
        command = ['git', '-C', str(self.root), *who, *words]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    def write(self, file: str, text: str) -> None:
        (self.root / file).parent.mkdir(parents=True, exist_ok=True)
        (self.root / file).write_text(text)

    def keep(self, result: Mapping[str, Any]) -> None:
        self.write('docs/results/counting.json', json.dumps(result))

    def commit(self) -> str:
        self.git('add', '-A')
        self.git('commit', '-qm', 'change')
        return self.git('rev-parse', 'HEAD')

    def row(self, benchmark: Benchmark = COUNTING) -> list[str]:
        """The words of the line of the result."""
        lines = status.listing(self.root, [benchmark]).splitlines()
        return next(line for line in lines if line.startswith('counting')).split()

    def problems(self, benchmark: Benchmark = COUNTING) -> list[str]:
        return list(status.check(self.root, [benchmark]))


@pytest.fixture
def repository(tmp_path: Path) -> Repository:
    (tmp_path / 'root').mkdir()
    return Repository(tmp_path / 'root')


def test_a_result_is_fresh_until_one_of_its_sources_changes(repository: Repository) -> None:
    repository.write('README', '2')
    repository.commit()
    assert repository.row() == ['counting.json', repository.first[:12], '0', 'fresh']
    for text in ('2', '3'):
        repository.write('package/counting/deep/source.py', text)
        repository.commit()
    assert repository.row()[2:] == ['2', 'stale', 'package/counting/**']


def test_a_result_that_was_measured_with_changes_counts_from_their_commit(repository: Repository) -> None:
    repository.keep({'commit': f'{repository.first[:12]}-dirty'})
    assert repository.row()[1:4] == [f'{repository.first[:12]}-dirty', '0', 'fresh']


def test_of_parts_the_oldest_counts(repository: Repository) -> None:
    repository.write('models/model', '2')
    second = repository.commit()
    repository.keep({'new': {'commit': second}, 'old': {'commit': repository.first}})
    assert repository.row() == ['counting.json', repository.first, '1', 'stale', 'models/**']


@pytest.mark.parametrize('result', [{}, {'commit': '0.1.0'}, {'commit': 'c0ffee012345'}])
def test_without_a_commit_that_git_knows_it_is_unknown(repository: Repository, result: Mapping[str, Any]) -> None:
    repository.keep(result)
    assert repository.row()[1:] == [result.get('commit', 'unknown'), '–', 'unknown']


def test_a_page_without_numbers_is_unknown(repository: Repository) -> None:
    repository.write('docs/results/counting.md', 'By hand.')
    assert repository.row(dataclasses.replace(COUNTING, files=('counting.md',))) == [
        'counting.md', 'unknown', '–', 'unknown',
    ]  # fmt: skip


def test_a_shallow_clone_says_what_is_missing(repository: Repository, tmp_path: Path) -> None:
    clone = tmp_path / 'clone'
    subprocess.run(['git', 'clone', '-q', '--depth', '1', f'file://{repository.root}', str(clone)], check=True)
    text = status.listing(clone, [COUNTING])
    assert text.startswith('this clone is shallow, so older commits are unknown; get them with: git fetch --unshallow')
    assert text.rstrip().endswith('unknown')


def test_without_history_nothing_is_reported_of_changes(repository: Repository) -> None:
    shutil.rmtree(repository.root / '.git')
    assert status.listing(repository.root, [COUNTING]).startswith('no history: ')
    assert repository.row()[3] == 'unknown'


def test_being_stale_is_no_fault_and_what_is_broken_is(
    repository: Repository, capsys: pytest.CaptureFixture[str]
) -> None:
    repository.write('models/model', '2')
    repository.commit()
    asked = argparse.Namespace(check=True)
    assert status.run(asked, [COUNTING], repository.root) == 0
    assert capsys.readouterr().out.endswith('nothing is wrong\n')
    (repository.root / 'docs/results/counting.md').unlink()
    assert status.run(argparse.Namespace(check=False), [COUNTING], repository.root) == 0
    assert 'wrong' not in capsys.readouterr().out
    assert status.run(asked, [COUNTING], repository.root) == 1
    assert 'wrong: docs/results/counting.md of counting is missing' in capsys.readouterr().out


def test_a_source_that_does_not_exist_is_reported(repository: Repository) -> None:
    benchmark = dataclasses.replace(COUNTING, sources=('package/counted/**',))
    assert repository.problems(benchmark) == ['counting names package/counted/** as a source, and there is none']


def test_a_page_that_is_not_that_of_its_numbers_is_reported(repository: Repository) -> None:
    repository.keep({'commit': repository.first, 'to': 4})
    (problem,) = repository.problems()
    assert problem == (
        'docs/results/counting.md says another thing than counting.json; renew it with: '
        'tactile bench counting --redraw docs/results/counting.json'
    )
    repository.write('docs/results/counting.md', '# Counted to 4\n\n## Notes\n\nBy a person.\n')
    assert repository.problems() == []


def test_a_page_that_a_person_writes_names_the_commit(repository: Repository) -> None:
    benchmark = dataclasses.replace(COUNTING, by_hand=True)
    (problem,) = repository.problems(benchmark)
    assert problem.startswith('docs/results/counting.md names none of the commits of counting.json')
    repository.write('docs/results/counting.md', f'Counted at commit {repository.first[:7]}.')
    assert repository.problems(benchmark) == []


@pytest.mark.parametrize('text', ['{', '{}'])
def test_numbers_that_cannot_be_read_are_reported(repository: Repository, text: str) -> None:
    repository.write('docs/results/counting.json', text)
    (problem,) = repository.problems()
    assert problem.startswith('docs/results/counting.md cannot be compared with counting.json')


def test_a_file_of_no_benchmark_is_reported(repository: Repository) -> None:
    repository.write('docs/results/README.md', 'Which page answers which question.')
    repository.write('docs/results/deep/other.png', '')
    (problem,) = repository.problems()
    assert problem.startswith('docs/results/deep/other.png is of no benchmark that is known')


def test_nothing_is_wrong_with_the_results_of_this_repository() -> None:
    assert list(status.check(share_directory(), list(BENCHMARKS.values()))) == []


@pytest.mark.parametrize(
    ('file', 'dirty'), [('docs/results/counting.json', False), ('package/counting/deep/source.py', True)]
)
def test_a_commit_is_dirty_by_changed_sources_and_not_by_what_was_measured(
    repository: Repository, file: str, dirty: bool
) -> None:
    repository.write(file, '2')
    assert describe(repository.root) == repository.git('rev-parse', 'HEAD')[:12] + '-dirty' * dirty
