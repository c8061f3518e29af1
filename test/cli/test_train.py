from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

import numpy as np
import pytest
from test_calibrate import pressed, recorded

from tactile_nodes.cli import train as verb
from tactile_nodes.cli.main import main
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.datasets.file import save_dataset

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


def test_the_plan_and_its_split_may_be_others_than_the_files(grid: str):
    assert verb.chosen_config(asked(grid, '--plan', 'random')).data.plan == 'random'
    assert verb.chosen_config(asked(grid, '--split', 'position')).data.split == 'position'


def test_the_command_line_changes_what_it_names(grid: str):
    config = verb.chosen_config(asked(grid, '-o', 'x.safetensors', '--seed', '7', '--presses', '30', '--device', 'cpu'))
    assert config.output == Path('x.safetensors')
    assert (config.data.seed, config.training.seed, config.data.presses) == (7, 7, 30)
    assert (config.response.seed, config.axisymmetric.seed) == (7, 7)
    assert config.training.device == 'cpu'


@pytest.mark.parametrize('command', [['train'], ['evaluate', 'fast']])
def test_a_cluster_is_refused_where_nothing_is_simulated(command: list[str], capsys: pytest.CaptureFixture[str]):
    assert main([*command, '--dataset', 'presses.npz', '--on', 'tcp://127.0.0.1:1']) == 1
    assert '--on simulates presses on a cluster; it cannot be used with a data set' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('run', 'words', 'refusal'),
    [
        ('readout: response', ('--device', 'cuda'), '--device is for networks; the readout response is fitted on the'),
        ('data: {plan: random}', ('--split', 'position'), 'random presses have no held-out set'),
        ('', ('--dataset', 'presses.npz', '--plan', 'random'), 'cannot be used with a data set'),
        (GRID, ('--presses', '30', '--dataset', 'x.npz'), '--presses'),
        (GRID, ('--presses', '3'), '--presses'),
    ],
)
def test_what_does_not_go_with_a_run_is_refused(tmp_path: Path, run: str, words: tuple[str, ...], refusal: str):
    (tmp_path / 'run.yaml').write_text(run)
    with pytest.raises(ConfigurationError, match=refusal):
        verb.chosen_config(asked(*([str(tmp_path / 'run.yaml')] if run else []), *words))


def test_runs_that_are_none_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(['train', '--compare', str(tmp_path)]) == 1
    assert 'does not hold a training run' in capsys.readouterr().err


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


def words_of(folder: Path, noise_px: float, presses: int = 150) -> list[str]:
    """Presses of a gel whose motion is seen with noise, and what trains on them."""
    dataset = pressed(presses, 2, 1.0, 0.0)
    noise = noise_px * np.random.default_rng(1).normal(size=dataset.features.shape)
    noisy = dataclasses.replace(dataset, features=(dataset.features + noise).astype(np.float16))
    save_dataset(folder / 'presses.npz', recorded(noisy, 'mine'))
    (folder / 'run.yaml').write_text('readout: response\nresponse: {components: 12, spacing_mm: 3.0, levels: 3}\n')
    named = ['--dataset', str(folder / 'presses.npz'), '-o', str(folder / 'mine.safetensors')]
    return ['train', str(folder / 'run.yaml'), *named, '--runs', str(folder / 'runs')]


@pytest.mark.parametrize(('noise_px', 'warned'), [(0.15, True), (0.0, False)], ids=['too few', 'enough'])
def test_a_model_of_too_few_presses_says_so_and_what_to_do(
    noise_px: float, warned: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert main(words_of(tmp_path, noise_px)) == 0
    printed = ' '.join(capsys.readouterr().out.split())
    assert ('warning: held-out presses are read' in printed) is warned
    assert ('presses to train on are too few: record 200 or more in all, or calibrate' in printed) is warned
    assert ('tactile calibrate --dataset presses.npz --model portable' in printed) is warned


def test_as_many_presses_as_tactile_press_advises_are_not_called_too_few(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert main(words_of(tmp_path, 0.15, presses=235)) == 0  # some show the untouched gel
    assert 'presses to train on usually do better: check places and forces' in ' '.join(capsys.readouterr().out.split())


def few(folder: Path, presses: int, untouched: int) -> str:
    """A data set of so many of each."""
    dataset = pressed(200, 2, 1.0, 0.0)
    touched = dataset.presses[:, 3] > 0
    rows = np.concatenate([np.flatnonzero(touched)[:presses], np.flatnonzero(~touched)[:untouched]])
    save_dataset(folder / 'few.npz', recorded(dataset.take(rows), 'mine'))
    return str(folder / 'few.npz')


@pytest.mark.parametrize(
    ('run', 'presses', 'untouched', 'missing'),
    [
        # Of 64 samples a fifth, 13, is put aside for the test and a tenth of the others, 6, for validation.
        (
            'readout: response\nresponse: {components: 12, spacing_mm: 3.0, levels: 3}\n', 64, 0,
            'but without the test set there are 0 and 45: 12 images of the untouched gel are missing; record more '
            '(if simulated: --presses), or take more of the untouched gel: into the table, or from the same bags '
            '(tactile dataset build … '
            '--without-contact 0.2); or ',
        ),
        (
            'readout: axisymmetric\n', 64, 0,
            'there are 0 and 45: 12 images of the untouched gel and 55 presses are missing; record more',
        ),
        (
            'readout: response\n', 2, 0,
            '2 presses or positions are too few for a test share of 0.2 and a validation share of 0.1; record more',
        ),
    ],
)  # fmt: skip
def test_what_is_missing_to_train_is_reported_and_that_a_calibration_needs_less(
    run: str, presses: int, untouched: int, missing: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / 'run.yaml').write_text(run)
    named = ['--dataset', few(tmp_path, presses, untouched), '-o', str(tmp_path / 'mine.safetensors')]
    assert main(['train', str(tmp_path / 'run.yaml'), *named, '--runs', str(tmp_path / 'runs')]) == 1
    printed = capsys.readouterr().err
    assert missing in printed
    assert printed.endswith('tactile calibrate --dataset presses.npz --model portable -o FILE\n')
    assert not (tmp_path / 'mine.safetensors').exists()


@pytest.mark.parametrize(
    ('presses', 'untouched', 'refusal'),
    [
        (0, 20, 'a network needs presses with a force to train on, but there is none; record some; or calibrate'),
        # Of 12 samples 3 are put aside for the test and of the others one for validation, whose mean is itself.
        (12, 0, 'the quality of the model is unknown: the held-out presses (1) are too few'),
    ],
)
def test_a_network_that_no_press_could_judge_is_not_written(
    presses: int, untouched: int, refusal: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    pytest.importorskip('torch')
    (tmp_path / 'run.yaml').write_text(
        'readout: network\nnetwork: {hidden: [4], dropout: 0.0}\n'
        'training: {batch: 10, epochs: 2, threads: 1, device: cpu}\n'
    )
    output = tmp_path / 'mine.safetensors'
    words = ['train', str(tmp_path / 'run.yaml'), '--dataset', few(tmp_path, presses, untouched), '-o', str(output)]
    assert main([*words, '--runs', str(tmp_path / 'runs')]) == 1
    assert refusal in capsys.readouterr().err
    assert not output.exists()


def test_a_model_that_is_no_better_than_the_mean_is_written_only_if_forced(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    words = words_of(tmp_path, noise_px=5.0)
    assert main(words) == 1
    printed = capsys.readouterr().err
    assert 'the model would not help: held-out presses are read' in printed
    assert 'tactile train … --force writes it all the same' in printed
    assert not (tmp_path / 'mine.safetensors').exists()
    assert main([*words, '--force']) == 0
    assert (tmp_path / 'mine.safetensors').exists()


def test_too_few_simulated_presses_name_the_option_that_simulates_more(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    words = ['train', 'fast', '--presses', '20', '--plan', 'spread', '-o', str(tmp_path / 'few.safetensors')]
    assert main([*words, '--runs', str(tmp_path / 'runs')]) == 1
    assert 'are missing; record more (if simulated: --presses)' in capsys.readouterr().err
