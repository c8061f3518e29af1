from __future__ import annotations

import dataclasses
import json
import os
import resource
from pathlib import Path

import pytest
from tiny_training import tiny_config

from tactile_nodes.errors import ConfigurationError, ModelError
from tactile_nodes.learning.config import load_train_config
from tactile_nodes.learning.run import checkpoint
from tactile_nodes.learning.run.checkpoint import Counters, Snapshot
from tactile_nodes.learning.run.comparison import draw, table
from tactile_nodes.learning.run.folder import RunFolder, read_run, run_id

SCORES = {'armse_n': 0.02, 'rmse_mc_n': 0.1, 'd_loc_mm': 0.5, 'total_rmse_n': 0.05, 'right_bin': 0.9}


def some_run(parent: Path, *, epochs: int = 3, **training: object) -> Path:
    with RunFolder(parent, tiny_config(**training), 'data') as run:
        run.resume()
        for epoch in range(1, epochs + 1):
            run.record(epoch, {**SCORES, 'armse_n': 0.1 / epoch, 'loss': 1.0, 'seconds': 2.0 * epoch})
        return run.path


def test_the_same_run_on_the_same_data_has_the_same_folder(tmp_path: Path):
    config = tiny_config()
    assert run_id(config, 'data') == run_id(dataclasses.replace(config, output=Path('other')), 'data')
    assert run_id(config, 'data') != run_id(config, 'other data')
    assert run_id(config, 'data') != run_id(tiny_config(seed=2), 'data')
    assert run_id(config, 'data') == run_id(tiny_config(epochs=77, checkpoint_s=5.0), 'data')


def test_a_run_in_training_is_not_trained_twice(tmp_path: Path):
    with (
        RunFolder(tmp_path, tiny_config(), 'data'),
        pytest.raises(ConfigurationError, match='another process is training'),
    ):
        RunFolder(tmp_path, tiny_config(), 'data')
    with RunFolder(tmp_path, tiny_config(), 'data'):
        pass


def test_epochs_after_the_checkpoint_are_forgotten(tmp_path: Path):
    """There is no checkpoint yet, so all that was measured, and half a line of it, will be measured again."""
    path = some_run(tmp_path)
    with (path / 'metrics.jsonl').open('a') as file:
        file.write('{"epoch": 4, "lo')
    with RunFolder(tmp_path, tiny_config(), 'data') as run:
        assert run.resume() is None
    assert read_run(path).epochs == []


def test_a_full_disk_keeps_the_checkpoint_before_and_says_what_to_do(tmp_path: Path):
    """A limit for the size of files stands in for the disk: both end a write with an error of the system."""
    torch = pytest.importorskip('torch')
    file, before = tmp_path / 'checkpoint.safetensors', resource.getrlimit(resource.RLIMIT_FSIZE)
    checkpoint.write(file, Snapshot(Counters(epoch=1), {'weight': torch.ones(3)}))
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, before[1]))
    try:
        with pytest.raises(ModelError, match=r'cannot write the checkpoint .*make room, and the same command'):
            checkpoint.write(file, Snapshot(Counters(epoch=2), {'weight': torch.ones(10_000)}))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    kept = checkpoint.read(file)
    assert kept is not None
    assert kept.counters.epoch == 1
    assert list(tmp_path.iterdir()) == [file]


def test_fresh_forgets_what_was_reached(tmp_path: Path):
    path = some_run(tmp_path)
    with RunFolder(tmp_path, tiny_config(), 'data', fresh=True):
        assert [file.name for file in sorted(path.iterdir())] == ['.lock', 'run.yaml']


def test_the_settings_of_a_run_can_be_run(tmp_path: Path):
    path = some_run(tmp_path, loss='mse')
    again = load_train_config(path / 'run.yaml')
    assert again.resolved() == tiny_config(loss='mse').resolved()


def test_runs_are_compared_by_what_differs(tmp_path: Path):
    runs = [read_run(some_run(tmp_path, seed=seed)) for seed in (1, 2)]
    lines = table(runs).splitlines()
    assert lines[1].split() == ['training.seed', '1', '2']
    assert not any('learning_rate' in line for line in lines)
    assert '0.0333' in next(line for line in lines if 'armse_n' in line)


def test_a_finished_run_tells_its_model(tmp_path: Path):
    path = some_run(tmp_path)
    result = {'model_id': 'abc', 'parameters': 7, 'training': {'epochs_run': 3, 'seconds': 6.0}, 'validation': SCORES}
    (path / 'result.json').write_text(json.dumps(result))
    text = table([read_run(path)])
    assert 'abc' in text
    assert '0.0200' in text


def test_curves_are_drawn_and_a_run_without_epochs_is_a_point(tmp_path: Path):
    pytest.importorskip('matplotlib')
    path = some_run(tmp_path, epochs=0)
    (path / 'result.json').write_text(json.dumps({'training': {'seconds': 2.0}, 'validation': SCORES}))
    draw([read_run(path), read_run(some_run(tmp_path, seed=2))], tmp_path / 'new' / 'curves.png')
    assert (tmp_path / 'new' / 'curves.png').read_bytes().startswith(b'\x89PNG')
    assert 'armse_n' in table([read_run(path)])


def test_a_folder_without_a_run_is_refused(tmp_path: Path):
    with pytest.raises(ConfigurationError, match='does not hold a training run'):
        read_run(tmp_path)


@pytest.mark.parametrize('name', ['metrics.jsonl', 'result.json'])
def test_a_named_pipe_in_a_run_is_refused_and_not_waited_for(name: str, tmp_path: Path):
    path = some_run(tmp_path)
    (path / name).unlink(missing_ok=True)
    os.mkfifo(path / name)
    with pytest.raises(ConfigurationError, match=rf'{name} is damaged \(it is not a regular file\); name another run'):
        read_run(path)


@pytest.mark.parametrize('name', ['metrics.jsonl', 'result.json'])
def test_gigabytes_in_a_run_are_not_read(name: str, tmp_path: Path):
    path = some_run(tmp_path)
    with (path / name).open('ab') as file:
        file.truncate(20 << 30)
    with pytest.raises(ConfigurationError, match=rf'{name} is damaged \(it has 21474836480 bytes'):
        read_run(path)


def test_settings_that_refer_to_themselves_are_not_unfolded(tmp_path: Path):
    path = some_run(tmp_path)
    (path / 'run.yaml').write_text('a: &a {b: 1}\nc: {d: *a, e: *a}\n')
    with pytest.raises(ConfigurationError, match=r'does not hold a training run .*aliases'):
        read_run(path)


@pytest.mark.parametrize(
    ('name', 'text'),
    [
        ('metrics.jsonl', '[1]\n'),
        ('metrics.jsonl', '{"epoch": 1}\n'),
        ('metrics.jsonl', json.dumps({**SCORES, 'epoch': 1, 'loss': 1.0, 'seconds': '2'}) + '\n'),
        ('metrics.jsonl', '[' * 100_000 + '\n'),
        ('metrics.jsonl', '\xff\n'),
        ('result.json', '7'),
        ('result.json', '{"validation": {"armse_n": 0.02}}'),
        ('result.json', '{"training": {"seconds": 2.0}, "validation": {"armse_n": "little"}}'),
        ('result.json', '{"training": {"seconds": 1' + '0' * 400 + '}}'),
    ],
)
def test_what_a_run_cannot_have_written_is_refused_in_a_sentence(name: str, text: str, tmp_path: Path):
    path = some_run(tmp_path)
    (path / name).write_text(text, encoding='latin-1')
    with pytest.raises(
        ConfigurationError, match=rf'{name} is damaged \(.*\); name another run, or train this one again'
    ):
        read_run(path)


def test_a_run_whose_curves_are_damaged_does_not_go_on(tmp_path: Path):
    path = some_run(tmp_path)
    (path / 'metrics.jsonl').write_text('nothing\n')
    with (
        RunFolder(tmp_path, tiny_config(), 'data') as run,
        pytest.raises(ConfigurationError, match=r'metrics.jsonl is damaged .* --fresh'),
    ):
        run.resume()


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path):
    (tmp_path / 'file').write_text('')
    with pytest.raises(ConfigurationError, match='choose another place with --runs'):
        RunFolder(tmp_path / 'file', tiny_config(), 'data')


def test_tensorboard_gets_the_same_curves(tmp_path: Path):
    pytest.importorskip('tensorboard')
    path = some_run(tmp_path)
    assert list((path / 'tensorboard').glob('events.out.tfevents.*'))
