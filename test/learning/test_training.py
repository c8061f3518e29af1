from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip('torch')

from tactile_nodes.errors import ConfigurationError, ModelError  # noqa: E402
from tactile_nodes.learning import dataset as datasets  # noqa: E402
from tactile_nodes.learning import train as training  # noqa: E402
from tactile_nodes.learning.config import DataConfig, NetworkConfig, TrainConfig, TrainingConfig  # noqa: E402
from tactile_nodes.learning.dataset import Dataset, simulate  # noqa: E402
from tactile_nodes.learning.evaluate import evaluate, predict, table  # noqa: E402
from tactile_nodes.learning.progress import Progress  # noqa: E402
from tactile_nodes.model_file import load_model  # noqa: E402


@pytest.fixture(scope='module', autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory):
    folder = tmp_path_factory.mktemp('cache')
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('XDG_CACHE_HOME', str(folder))
        yield folder


def small_config(folder: Path, **training_options: object) -> TrainConfig:
    options = {'batch': 10, 'epochs': 4, 'warm_up_epochs': 2, 'threads': 1, **training_options}
    return TrainConfig(
        output=folder / 'small.safetensors',
        data=DataConfig(presses=40, presses_per_rest_image=20, frames_per_rest_image=2, processes=1, seed=3),
        network=NetworkConfig(hidden=(8,), dropout=0.1),
        training=TrainingConfig(**options),  # type: ignore[arg-type]
    )


@pytest.fixture(scope='module')
def data(tmp_path_factory: pytest.TempPathFactory, cache: Path) -> Dataset:
    return simulate(small_config(tmp_path_factory.mktemp('data')), Progress())


def test_a_data_set_has_the_papers_features(data: Dataset):
    assert data.features.shape == (40, 40, 40, 2)
    assert data.confidence.shape == (2, 40, 40)
    assert data.rest.tolist() == [0] * 20 + [1] * 20


def test_labels_hold_the_whole_force_in_one_bin(data: Dataset, tmp_path: Path):
    labels = data.labels(small_config(tmp_path).bins)
    np.testing.assert_allclose(labels.sum(axis=1), data.presses[:, 3], rtol=1e-6)
    assert (np.count_nonzero(labels, axis=1) == (data.presses[:, 3] > 0)).all()


def test_a_data_set_is_made_once(data: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def refuse(*_: object) -> None:
        raise AssertionError('rendered again')

    monkeypatch.setattr(datasets, '_render_block', refuse)
    assert simulate(small_config(tmp_path), Progress()).fingerprint == data.fingerprint


def test_the_number_of_processes_does_not_name_another_data_set(tmp_path: Path):
    config = small_config(tmp_path)
    other = dataclasses.replace(config, data=dataclasses.replace(config.data, processes=7))
    assert datasets.recipe_id(config) == datasets.recipe_id(other)


def test_other_flow_options_name_another_data_set(tmp_path: Path):
    config = small_config(tmp_path)
    flow = dataclasses.replace(config.flow, options={'preset': 'medium'})
    assert datasets.recipe_id(config) != datasets.recipe_id(dataclasses.replace(config, flow=flow))


def test_training_gives_the_same_file_twice(data: Dataset, tmp_path: Path):
    ids = set()
    for name in ('one', 'two'):
        config = dataclasses.replace(small_config(tmp_path), output=tmp_path / f'{name}.safetensors')
        ids.add(load_model(training.train(config)).model_id)
    assert len(ids) == 1


def test_a_model_says_how_it_was_made(data: Dataset, tmp_path: Path):
    card = load_model(training.train(small_config(tmp_path), command='tactile train x.yaml')).card
    assert card['command'] == 'tactile train x.yaml'
    assert card['data']['fingerprint'] == data.fingerprint
    assert card['flow']['options']['preset'] == 'ultrafast'
    assert card['training']['epochs_run'] == 4


def test_the_live_network_computes_what_torch_does(data: Dataset, tmp_path: Path):
    config = small_config(tmp_path)
    scaling = training.fit_scaling(data, np.ones(40, bool), config)
    inputs = training.prepare(data, scaling)
    network = training.build_network(config, inputs.shape[1]).eval()
    with torch.no_grad():
        expected = network(torch.from_numpy(inputs)).numpy()
    mlp = training.as_mlp(network, None)
    np.testing.assert_allclose([mlp(each) for each in inputs], expected, atol=1e-5)


def test_predictions_go_through_the_live_estimator(data: Dataset, tmp_path: Path):
    predictions = predict(load_model(training.train(small_config(tmp_path))), data)
    assert len(predictions) == 40
    assert predictions[0].normal_force_n.shape == (9, 9)


def test_ctrl_c_keeps_the_best_network_so_far(data: Dataset, tmp_path: Path):
    class Impatient(Progress):
        def bar(self, title: str, steps: int):  # type: ignore[no-untyped-def]
            class Bar:
                def advance(self, steps: int = 1, text: str = '') -> None:
                    raise KeyboardInterrupt

            import contextlib

            return contextlib.nullcontext(Bar())

    card = load_model(training.train(small_config(tmp_path), progress=Impatient())).card
    assert card['training']['epochs_run'] == 1


def test_training_stops_when_the_loss_no_longer_falls(data: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(training, 'SILENT_SHARE', -1.0)  # so small a network says nothing, which is another matter
    config = small_config(tmp_path, learning_rate=0.0, epochs=50, patience=3)
    assert load_model(training.train(config)).card['training']['epochs_run'] == 4  # the best is the first


def test_armse_in_torch_is_the_papers():
    true, predicted = torch.tensor([[3.0, 0.0], [4.0, 0.0]]), torch.zeros(2, 2)
    assert training.armse(predicted, true).item() == pytest.approx(np.sqrt(12.5) / 2, rel=1e-5)


def test_a_network_starts_balanced(tmp_path: Path):
    """Logistic units start around a half, so that neither the next layer nor the gradient begins in a corner."""
    torch.manual_seed(0)
    network = training.build_network(TrainConfig(), 3200).eval()
    with torch.no_grad():
        hidden = network[:5](torch.randn(50, 3200))  # up to the second layer's units
    assert hidden.mean().item() == pytest.approx(0.5, abs=0.02)
    assert 0.1 < hidden.std().item() < 0.4


def test_without_torch_the_extra_to_install_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, 'torch', None)
    with pytest.raises(ConfigurationError, match=r'pip install tactile_nodes\[train\]'):
        training.import_torch()


def test_evaluation_scores_presses_that_training_never_saw(data: Dataset, tmp_path: Path):
    scores = evaluate(training.train(small_config(tmp_path)), presses=16, seed=77)
    assert scores.fingerprint != data.fingerprint
    assert scores.groups['all presses'].presses + scores.rest.frames == 20
    near, away = scores.groups['within 0.3 mm of a bin border'], scores.groups['away from bin borders']
    assert near.presses + away.presses == scores.groups['all presses'].presses
    assert 'RMSE_mc' in table(scores)


def test_evaluation_on_the_training_presses_is_refused(data: Dataset, tmp_path: Path):
    with pytest.raises(ModelError, match='trained on presses of seed 3'):
        evaluate(training.train(small_config(tmp_path)), presses=16, seed=3)


def test_frames_without_contact_are_shown_as_often_as_said(data: Dataset, tmp_path: Path):
    held_out = np.zeros(40, bool)
    held_out[:10] = True
    shown = training.shown_samples(data, held_out, small_config(tmp_path, rest_repeats=3))
    untouched = data.presses[:, 3] == 0
    counts = np.bincount(shown, minlength=40)
    assert (counts[:10] == 0).all()
    assert (counts[10:] == np.where(untouched[10:], 3, 1)).all()


def test_channels_are_weighted_as_said(data: Dataset, tmp_path: Path):
    config = small_config(tmp_path)
    weighted = dataclasses.replace(config, network=dataclasses.replace(config.network, channel_gains=(1.0, 0.2)))
    every = np.ones(40, bool)
    plain, other = (training.fit_scaling(data, every, each).gain for each in (config, weighted))
    np.testing.assert_allclose(other[..., 0], plain[..., 0])
    np.testing.assert_allclose(other[..., 1], 0.2 * plain[..., 1], rtol=1e-6)


def test_a_weight_for_each_channel_is_demanded(data: Dataset, tmp_path: Path):
    config = small_config(tmp_path)
    config = dataclasses.replace(config, network=dataclasses.replace(config.network, channel_gains=(1.0,)))
    with pytest.raises(ConfigurationError, match='channel_gains has 1 values, but polar_mean has 2 channels'):
        training.fit_scaling(data, np.ones(40, bool), config)


def test_a_network_that_says_nothing_is_noticed():
    true = np.zeros((5, 9), np.float32)
    true[:, 3] = 1.0
    assert training.Validation.of(true, 0.01 * true).silent
    assert not training.Validation.of(true, 0.5 * true).silent


def test_waiting_on_the_all_zero_answer_is_no_reason_to_stop(data: Dataset, tmp_path: Path):
    """With a vanishing step the network stays silent, and 6 epochs pass although 3 without progress are the limit."""
    config = small_config(tmp_path, learning_rate=1e-9, epochs=6, patience=3)
    assert load_model(training.train(config)).card['training']['epochs_run'] == 6
