from __future__ import annotations

import argparse
from pathlib import Path

import pytest

from tactile_nodes.cli import train as verb
from tactile_nodes.cli.main import main
from tactile_nodes.errors import ConfigurationError

GRID = 'data: {plan: paper}\n'


def asked(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    verb.add_arguments(parser)
    return parser.parse_args(words)


@pytest.fixture
def grid(tmp_path: Path) -> str:
    (tmp_path / 'grid.yaml').write_text(GRID)
    return str(tmp_path / 'grid.yaml')


def test_without_a_file_the_papers_run_is_made():
    assert verb.chosen_config(asked()).output == Path('models/paper.safetensors')


def test_the_plan_may_be_another_than_the_files(grid: str):
    assert verb.chosen_config(asked(grid, '--plan', 'random')).data.plan == 'random'


def test_a_data_set_has_the_plan_that_it_was_recorded_by():
    with pytest.raises(ConfigurationError, match='a data set holds what it holds'):
        verb.chosen_config(asked('--dataset', 'presses.npz', '--plan', 'random'))


def test_the_command_line_changes_what_it_names(grid: str):
    config = verb.chosen_config(asked(grid, '-o', 'x.safetensors', '--seed', '7', '--presses', '30', '--device', 'cpu'))
    assert config.output == Path('x.safetensors')
    assert (config.data.seed, config.training.seed, config.data.presses) == (7, 7, 30)
    assert config.training.device == 'cpu'


def test_a_grid_can_be_split_by_position(grid: str):
    assert verb.chosen_config(asked(grid, '--split', 'position')).data.split == 'position'


def test_random_presses_are_not_split(tmp_path: Path):
    (tmp_path / 'run.yaml').write_text('data: {plan: random}\n')
    with pytest.raises(ConfigurationError, match='of random ones nothing is put aside'):
        verb.chosen_config(asked(str(tmp_path / 'run.yaml'), '--split', 'position'))


@pytest.mark.parametrize('words', [('--presses', '30', '--dataset', 'x.npz'), ('--presses', '3')])
def test_a_number_of_presses_that_cannot_be_is_refused(grid: str, words: tuple[str, ...]):
    with pytest.raises(ConfigurationError, match='--presses'):
        verb.chosen_config(asked(grid, *words))


def test_runs_that_are_none_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(['train', '--compare', str(tmp_path)]) == 1
    assert 'holds no training run' in capsys.readouterr().err


def test_the_help_has_examples(capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit):
        main(['train', '--help'])
    assert 'tactile train --compare' in capsys.readouterr().out


def test_a_run_is_trained_kept_and_compared(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    pytest.importorskip('torch')
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'run.yaml').write_text(
        'output: tiny.safetensors\n'
        'data: {presses: 30, presses_per_rest_image: 30, frames_per_rest_image: 2, processes: 1}\n'
        'encoding: {name: cartesian_mean, options: {rows: 10, cols: 10}}\n'
        'network: {hidden: [4], dropout: 0.0}\n'
        'training: {batch: 10, epochs: 2, threads: 1, device: cpu}\n'
    )
    assert main(['train', 'run.yaml']) == 0
    assert main(['train', 'run.yaml', '--seed', '2']) == 0
    runs = sorted(str(path) for path in (tmp_path / 'runs').iterdir())
    assert len(runs) == 2
    assert main(['train', '--compare', *runs]) == 0
    assert 'training.seed' in capsys.readouterr().out
