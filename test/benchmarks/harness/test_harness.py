"""What all benchmarks share, tried with one that counts."""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import os
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from measured_case import measured_case

from benchmarks.catalogue import BENCHMARKS
from benchmarks.harness import parts
from benchmarks.harness.command import command_of, parser_of
from benchmarks.harness.declaration import Aim, Benchmark, argument, reached
from benchmarks.harness.parts import Parts
from benchmarks.harness.report import in_turn, opening, quartiles
from benchmarks.harness.running import Run, run
from benchmarks.harness.workers import own_bus
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.progress import Progress


def page(result: Mapping[str, Any]) -> str:
    return '\n\n'.join([*opening('Counting', result, 'How far.'), f'To {result["to"]}.'])


def draw(result: Mapping[str, Any], folder: Path, name: str) -> None:
    (folder / f'{name}.png').write_text(str(result['to']))


COUNTING = Benchmark(
    name='counting',
    about='How far it counts.',
    sources=('benchmarks/**',),
    page=page,
    measure=lambda arguments, _: {'to': arguments.to},
    draw=draw,
    failed=lambda result: result['to'] > 100,
    quick=True,
    seed=7,
    arguments=(
        argument('--to', type=int, default=3, least=0, help='how far'),
        argument('--steps', type=float, nargs='+', default=[1.0], above=0, help='by how much'),
        argument('--images', type=Path, help='of what'),
    ),
)


def counted(words: list[str], benchmark: Benchmark = COUNTING) -> int:
    return run(benchmark, parser_of(benchmark).parse_args(words))


def test_a_run_writes_numbers_page_and_chart_and_prints_the_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert counted(['--to', '5', '-o', str(tmp_path / 'new')]) == 0
    result = json.loads((tmp_path / 'new' / 'counting.json').read_text())
    assert result['to'] == 5
    assert {'command', 'machine', 'versions', 'commit'} < result.keys()
    text = (tmp_path / 'new' / 'counting.md').read_text()
    assert text.endswith('\n\nTo 5.\n')
    assert text in capsys.readouterr().out
    assert (tmp_path / 'new' / 'counting.png').read_text() == '5'


def test_what_is_wrong_is_in_the_exit_status(capsys: pytest.CaptureFixture[str]) -> None:
    assert counted(['--to', '101']) == 1
    assert 'To 101.' in capsys.readouterr().out


@pytest.mark.parametrize(
    ('words', 'refusal'),
    [
        (['--to', '-1'], '--to must be at least 0, got -1'),
        (['--steps', '1', '0'], '--steps must be above 0, got 0'),
        (['--steps', 'nan'], '--steps must be above 0, got nan'),
    ],
)
def test_numbers_that_nothing_can_be_measured_with_are_refused(words: list[str], refusal: str) -> None:
    with pytest.raises(ConfigurationError, match=refusal):
        counted(words)


def test_the_json_file_may_be_named(tmp_path: Path) -> None:
    assert counted(['-o', str(tmp_path / 'again.json')]) == 0
    assert sorted(file.name for file in tmp_path.iterdir()) == ['again.json', 'again.md', 'again.png']


def test_page_and_chart_are_drawn_again_without_measuring(tmp_path: Path) -> None:
    counted(['--to', '5', '-o', str(tmp_path)])
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    for name in ('counting.md', 'counting.png'):
        (tmp_path / name).unlink()
    never = dataclasses.replace(COUNTING, measure=lambda *_: pytest.fail('measured'))
    assert counted(['--redraw', str(tmp_path / 'counting.json')], never) == 0
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_notes_of_a_person_at_the_end_of_a_page_stay(tmp_path: Path) -> None:
    counted(['-o', str(tmp_path)])
    file = tmp_path / 'counting.md'
    file.write_text(f'{file.read_text()}\n## Notes\n\nCounted with care.\n')
    counted(['--to', '4', '-o', str(tmp_path)])
    assert file.read_text().endswith('To 4.\n\n## Notes\n\nCounted with care.\n')


@pytest.mark.parametrize(
    ('text', 'refusal'),
    [(None, 'there is no result'), ('{', 'cannot read the result'), ('[]', 'no result'), ('{}', 'of an older form')],
)
def test_what_cannot_be_drawn_again_is_one_sentence(tmp_path: Path, text: str | None, refusal: str) -> None:
    file = tmp_path / 'counting.json'
    if text is not None:
        file.write_text(text)
    with pytest.raises(ConfigurationError, match=refusal):
        counted(['--redraw', str(file)])


def test_a_result_that_cannot_be_kept_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / 'file').write_text('')
    with pytest.raises(ConfigurationError, match='choose another with -o'):
        counted(['-o', str(tmp_path / 'file' / 'folder')])


def test_the_command_tells_what_is_not_as_by_default_and_no_place_on_this_machine() -> None:
    parser = parser_of(COUNTING)
    arguments = parser.parse_args(['--quick', '--to', '3', '--images', '/home/me/speckle', '-o', 'docs/results'])
    command = command_of(parser, arguments, 'tactile bench counting')
    assert command == 'tactile bench counting --images speckle --quick -o docs/results'


def test_parts_are_measured_and_dated_each_and_the_others_stay(tmp_path: Path) -> None:
    both = Benchmark(
        name='both', about='Two parts.', sources=(), page=lambda result: ' '.join(sorted(result)),
        measure=lambda arguments, _: {'measured': arguments.only}, cases=('one', 'two'), in_parts=True,
    )  # fmt: skip
    assert counted(['-o', str(tmp_path)], both) == 0
    (tmp_path / 'both.json').write_text((tmp_path / 'both.json').read_text().replace('"one"', '"kept"'))
    assert counted(['--only', 'two', '-o', str(tmp_path)], both) == 0
    result = json.loads((tmp_path / 'both.json').read_text())
    assert result['kept']['measured'] == ['kept']
    assert result['two']['measured'] == ['two']
    assert ' --only two ' in result['two']['command']


def test_a_run_that_was_killed_goes_on_and_one_that_ended_begins_anew(tmp_path: Path) -> None:
    made: list[str] = []

    def measured(name: str) -> list[str]:
        made.append(name)
        return [name]

    killed = Parts(tmp_path / 'parts')
    assert [killed.get(name, lambda name=name: measured(name)) for name in ('a 1', 'a 2')] == [['a 1'], ['a 2']]
    going_on = Parts(tmp_path / 'parts')
    assert going_on.get('a 1', lambda: pytest.fail('measured again')) == ['a 1']
    assert going_on.get('a 3', lambda: measured('a 3')) == ['a 3']
    going_on.forget()
    assert Parts(tmp_path / 'parts').get('a 1', lambda: measured('a 1')) == ['a 1']
    assert made == ['a 1', 'a 2', 'a 3', 'a 1']


ROOTS = Benchmark(
    name='roots', about='Roots.', sources=(), page=lambda result: ' '.join(result['roots']), tasks=True,
    measure=lambda _, run: {'roots': run.parts(math.sqrt, {'four': 4.0, 'nine': 9.0}, 'roots')},
)  # fmt: skip


@pytest.mark.parametrize('processes', ['1', '2'])
def test_tasks_give_the_same_whatever_the_number_of_processes(tmp_path: Path, processes: str) -> None:
    assert counted(['--processes', processes, '-o', str(tmp_path)], ROOTS) == 0
    result = json.loads((tmp_path / 'roots.json').read_text())
    assert result['roots'] == {'four': 2.0, 'nine': 3.0}
    assert 'processes' not in result['command']


def test_tasks_that_were_done_before_a_kill_are_not_done_again(monkeypatch: pytest.MonkeyPatch) -> None:
    kept = {'four': 2.5}
    monkeypatch.setattr(Parts, 'kept', lambda _, name: kept.get(name))
    arguments = parser_of(ROOTS).parse_args([])
    assert ROOTS.measure(arguments, Run(ROOTS, arguments, Progress())) == {'roots': {'four': 2.5, 'nine': 3.0}}


def test_cases_of_a_benchmark_in_parts_are_tasks_too(tmp_path: Path) -> None:
    both = Benchmark(
        name='both', about='Two parts.', sources=(), page=json.dumps, measure=measured_case, cases=('one', 'two'),
        in_parts=True, tasks=True,
    )  # fmt: skip
    assert counted(['--processes', '2', '-o', str(tmp_path)], both) == 0
    result = json.loads((tmp_path / 'both.json').read_text())
    assert [result[name]['measured'] for name in ('one', 'two')] == [['one'], ['two']]


def test_parts_are_of_one_configuration_and_one_state_of_the_source(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'cache'))
    root = tmp_path / 'root'
    root.mkdir()
    monkeypatch.setattr(parts, 'share_directory', lambda: root)
    Parts.of('counting', {'to': 3}).get('a', lambda: 1)
    assert not (tmp_path / 'cache' / 'tactile_nodes' / 'benchmarks').exists()  # without git nobody knows the source

    git = ['git', '-C', str(root), '-c', 'user.name=a', '-c', 'user.email=a@b']
    (root / 'file').write_text('1')
    for words in (['init', '-q'], ['add', '.'], ['commit', '-qm', 'first']):
        subprocess.run([*git, *words], check=True)
    assert Parts.of('counting', {'to': 3}).get('a', lambda: 1) == 1
    assert Parts.of('counting', {'to': 3}).get('a', lambda: 2) == 1
    assert Parts.of('counting', {'to': 4}).get('a', lambda: 2) == 2
    (root / 'file').write_text('2')
    assert Parts.of('counting', {'to': 3}).get('a', lambda: 2) == 2


def test_aims_are_one_table_with_a_column_for_each_that_is_judged() -> None:
    aims = (
        Aim('error', 'at most 1 mN', lambda result: {name: f'{each} mN' for name, each in result.items()}),
        Aim('time', 'at most 2 ms', lambda _: {'fast': '1 ms'}),
        Aim('not asked for', '', lambda _: {}),
    )
    assert reached(aims, {'fast': 0.5, 'paper': 9}).splitlines() == [
        '| figure |       target |   fast | paper |',
        '| ------ | -----------: | -----: | ----: |',
        '| error  | at most 1 mN | 0.5 mN |  9 mN |',
        '| time   | at most 2 ms |   1 ms |     – |',
    ]


def test_contenders_turn_round_from_one_round_to_the_next() -> None:
    assert [list(in_turn(['a', 'b', 'c'], number)) for number in range(3)] == [
        ['a', 'b', 'c'],
        ['c', 'b', 'a'],
        ['a', 'b', 'c'],
    ]


def test_quartiles_are_the_middle_half() -> None:
    assert quartiles([4.0, 0.0, 1.0, 2.0, 3.0]) == {'median': 2.0, 'low': 1.0, 'high': 3.0}


def test_a_bus_of_ones_own_ends_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('TACTILE_RUN_DIR', 'before')
    with own_bus(tmp_path):
        assert os.environ['TACTILE_RUN_DIR'] == str(tmp_path)
    assert os.environ['TACTILE_RUN_DIR'] == 'before'


def test_every_benchmark_names_itself_in_a_line_and_what_it_depends_on() -> None:
    for benchmark in BENCHMARKS.values():
        assert benchmark.help.endswith(('.', '?')), benchmark.name
        assert benchmark.about, benchmark.name
        assert {f'benchmarks/{benchmark.name}/**', f'benchmarks/{benchmark.name}.py'} & set(benchmark.sources)


def test_a_run_has_all_cases_or_those_that_were_asked_for() -> None:
    benchmark = dataclasses.replace(COUNTING, cases=('one', 'two', 'three'))
    arguments = argparse.Namespace(to=3, images=None, quick=False, seed=7, output=None, only=None)
    assert Run(benchmark, arguments).cases == ('one', 'two', 'three')
    asked = parser_of(benchmark).parse_args(['--only', 'one', '--only', 'two'])
    assert Run(benchmark, asked).cases == ('one', 'two')
