from __future__ import annotations

from pathlib import Path

import pytest

from tactile_nodes import paths
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.config import load_train_config
from tactile_nodes.learning.transfer.layer import load_layer_config


def written(folder: Path, text: str) -> Path:
    path = folder / 'run.yaml'
    path.write_text(text, encoding='utf-8')
    return path


def test_the_papers_run_has_the_papers_network_and_numbers():
    config = load_train_config(paths.share_directory() / 'config' / 'train' / 'paper.yaml')
    assert config.network.hidden == (800, 400, 400)
    assert config.encoding.options == {'rows': 40, 'cols': 40}
    assert (config.training.batch, config.training.learning_rate, config.training.patience) == (200, 0.001, 50)
    assert config.encoding.name == 'polar_mean'
    assert config.bins.count == 81


def test_runs_that_ship_are_found_in_any_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """By name, and by the path that the documents give; a file of one's own by its path."""
    monkeypatch.chdir(tmp_path)
    assert load_train_config('paper') == load_train_config('config/train/paper.yaml')
    assert load_layer_config('paper') == load_layer_config('config/transfer/paper.yaml')
    written(tmp_path, 'data: {presses: 7}')
    own = load_train_config('run.yaml')
    assert (own.data.presses, own.data.seed, own.flow.name) == (7, 1, 'dis')  # what is not said keeps its default
    with pytest.raises(ConfigurationError, match=r"there is no training run 'papr'; .* paper, "):
        load_train_config('papr')


def test_options_reach_the_method_they_are_for(tmp_path: Path):
    config = load_train_config(written(tmp_path, 'flow: {name: dis, options: {preset: medium}}'))
    assert config.make_flow().options['preset'] == 'medium'


@pytest.mark.parametrize(
    'text',
    [
        'data: {pressses: 7}',
        'flow: {nam: dis}',
        'gel: {sead: 3}',
        'network: {dropout: 2.0}',
        'training: {loss: l1}',
        'data: {seed: -1}',
        'data: {split_seed: -1}',
        'training: {seed: -1}',
        'response: {seed: -1}',
    ],
)
def test_a_wrong_key_or_value_is_an_error(tmp_path: Path, text: str):
    with pytest.raises(ConfigurationError):
        load_train_config(written(tmp_path, text))


def test_an_unknown_key_is_named_with_file_and_line(tmp_path: Path):
    with pytest.raises(ConfigurationError, match=r'run\.yaml:3: .*pressses'):
        load_train_config(written(tmp_path, 'output: x\ndata:\n  pressses: 7\n'))
