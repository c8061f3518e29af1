from __future__ import annotations

import dataclasses
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.config import Choice, DataConfig, NetworkConfig, TrainConfig, TrainingConfig
from tactile_nodes.learning.datasets import simulated as datasets
from tactile_nodes.learning.datasets.simulated import Dataset, simulate
from tactile_nodes.learning.evaluation.evaluate import put_aside
from tactile_nodes.learning.network import layers as network_layers
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.run.folder import read_run
from tactile_nodes.learning.training import train as training
from tactile_nodes.learning.training.source import training_data
from tactile_nodes.model_file import load_model

pytestmark = [
    pytest.mark.usefixtures('own_cache'),
    pytest.mark.skipif(find_spec('torch') is None, reason='torch is not installed'),
]


def small_config(folder: Path, **training_options: object) -> TrainConfig:
    options = {'batch': 10, 'epochs': 4, 'warm_up_epochs': 2, 'threads': 1, 'device': 'cpu', **training_options}
    return TrainConfig(
        output=folder / 'small.safetensors',
        data=DataConfig(presses=40, presses_per_rest_image=20, frames_per_rest_image=2, processes=1, seed=3),
        network=NetworkConfig(hidden=(8,), dropout=0.1),
        training=TrainingConfig(**options),  # type: ignore[arg-type]
    )


@pytest.fixture(scope='module')
def data(tmp_path_factory: pytest.TempPathFactory, own_cache: Path) -> Dataset:
    return simulate(small_config(tmp_path_factory.mktemp('data')), Progress())


@pytest.fixture(scope='module')
def trained(data: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The model of a training with `small_config`."""
    return training.train(small_config(tmp_path_factory.mktemp('trained')), command='tactile train x.yaml')


def test_a_data_set_has_the_papers_features(data: Dataset):
    assert data.features.shape == (40, 40, 40, 2)
    assert data.confidence.shape == (2, 40, 40)
    assert data.rest.tolist() == [0] * 20 + [1] * 20


def test_a_data_set_is_made_once(data: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def refuse(*_: object) -> None:
        raise AssertionError('rendered again')

    monkeypatch.setattr(datasets, '_render_block', refuse)
    assert simulate(small_config(tmp_path), Progress()).fingerprint == data.fingerprint


def test_other_flow_options_name_another_data_set_and_the_number_of_processes_does_not(tmp_path: Path):
    config = small_config(tmp_path)
    processes = dataclasses.replace(config, data=dataclasses.replace(config.data, processes=7))
    flow = dataclasses.replace(config, flow=dataclasses.replace(config.flow, options={'preset': 'medium'}))
    assert datasets.recipe_id(config) == datasets.recipe_id(processes) != datasets.recipe_id(flow)


def test_a_model_says_how_it_was_made(data: Dataset, trained: Path):
    card = load_model(trained).card
    assert card['command'] == 'tactile train x.yaml'
    assert card['data']['fingerprint'] == data.fingerprint
    assert card['flow']['options']['preset'] == 'ultrafast'
    assert card['training']['epochs_run'] == 4
    assert card['training']['device'] == 'cpu, 1 threads'
    assert card['validation']['armse_n'] > 0


def test_without_torch_the_extra_to_install_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, 'torch', None)
    with pytest.raises(ConfigurationError, match=r"pip install 'tactile_nodes\[train\]'"):
        network_layers.import_torch()


def test_training_gives_the_same_readout_twice(trained: Path, tmp_path: Path):
    again = training.train(small_config(tmp_path))
    weights = [load_model(file).model.readout.network.weights for file in (trained, again)]
    assert all(mine.tobytes() == theirs.tobytes() for mine, theirs in zip(*weights, strict=True))


def test_a_run_keeps_settings_curves_and_result(data: Dataset, tmp_path: Path):
    config = small_config(tmp_path)
    model = load_model(training.train(config, runs=tmp_path / 'runs'))
    (folder,) = (tmp_path / 'runs').iterdir()
    stored = read_run(folder)
    assert folder.name.startswith('small-')
    assert stored.settings['training.epochs'] == 4
    assert [each['epoch'] for each in stored.epochs] == [1, 2, 3, 4]
    assert stored.result['model_id'] == model.model_id


def test_a_grid_of_presses_is_split_in_three_and_the_test_found_again(tmp_path: Path):
    """Of 40 presses 8 (a fifth) are put aside; of the others nine tenths, rounded down, train: 28."""
    config = small_config(tmp_path)
    grid = dataclasses.replace(config, data=dataclasses.replace(config.data, plan='paper', without_contact=0.1))
    data = training_data(grid, Progress())
    touched = data.dataset.presses[:, 2] > 0
    assert (touched.sum(), (touched & ~data.held_out).sum()) == (32, 28)
    loaded = load_model(training.train(grid))
    test, words = put_aside(loaded, loaded, Progress())
    assert (test.presses[:, 2] > 0).sum() == 8
    trained = {tuple(each) for each in data.dataset.presses[touched].tolist()}
    assert not trained & {tuple(each) for each in test.presses.tolist()}
    assert words.endswith('put aside by sample of the paper plan')
    loaded.card['data']['fingerprint'] = '0' * 16  # as on a processor that adds in another order
    again, words = put_aside(loaded, loaded, Progress())
    assert 'not bit-identical' in words
    np.testing.assert_array_equal(again.presses, test.presses)


def test_a_flow_that_judges_each_frame_has_its_confidence_kept(tmp_path: Path):
    """As the live node sees it: where the tip pulls markers apart a region counts less, in that frame alone."""
    config = small_config(tmp_path)
    options = {'rows': 10, 'cols': 10, 'finest_scale': 1}
    config = dataclasses.replace(
        config,
        data=dataclasses.replace(config.data, presses=10, presses_per_rest_image=5),
        flow=Choice('inverse_compositional', options),
        encoding=Choice('cartesian_mean', {'rows': 10, 'cols': 10}),
    )
    made = simulate(config, Progress())
    assert made.confidence.shape == (10, 10, 10)
    assert made.rest.tolist() == list(range(10))


def test_a_region_is_trusted_that_is_seldom_lost():
    confidence = np.ones((20, 1, 3), np.float32)
    confidence[0, 0, 1] = confidence[:3, 0, 2] = 0.2
    presses, features = np.zeros((20, 4), np.float32), np.zeros((20, 1, 3, 2), np.float16)
    data = Dataset(features, presses, np.arange(20), confidence, '')
    assert data.trusted(0.5).tolist() == [[1.0, 1.0, 0.0]]
