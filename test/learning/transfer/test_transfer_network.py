"""The paper's layer: it begins as the identity, leaves the network alone, and serves a gel that answers otherwise."""

from __future__ import annotations

import dataclasses
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from tiny_training import tiny_config, tiny_presses

from tactile_nodes.errors import ConfigurationError, DatasetError, ModelError
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.network.fit import fit_network
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.transfer.layer import (
    FittedLayer,
    LayerConfig,
    LayerTraining,
    fit_layer,
    load_layer_config,
)
from tactile_nodes.learning.transfer.network import NetworkTransfer, shuffled_parts, transfer_network
from tactile_nodes.model_file import LoadedModel, load_model, save_model
from tactile_nodes.sensing.explain.model import FeatureLayout, ForceModel
from tactile_nodes.sensing.explain.network import NetworkReadout
from tactile_nodes.sensing.explain.reading import Readout

pytestmark = pytest.mark.skipif(find_spec('torch') is None, reason='torch is not installed')

CARD = {
    'flow': {'name': 'dis', 'options': {}}, 'encoding': {'name': 'polar_mean', 'options': {}},
    'gel': {'id': 'first'}, 'crop_px': 440, 'source': {'model_id': 'abc123'},
}  # fmt: skip
QUICK = LayerConfig(learning_rate=1e-3, patience=20, epochs=60)


def polar(dataset: Dataset, motion_gain: float = 1.0) -> Dataset:
    """Magnitude and angle in [0, 2 pi) of every region's motion, which may be weaker than in the first gel."""
    dx, dy = np.moveaxis(dataset.features.astype(np.float64), -1, 0)
    features = np.stack([motion_gain * np.hypot(dx, dy), np.arctan2(dy, dx) % (2 * np.pi)], axis=-1)
    return dataclasses.replace(dataset, features=features.astype(np.float16))


@pytest.fixture(scope='module')
def source() -> NetworkReadout:
    dataset, held_out = polar(tiny_presses(600)), np.arange(600) % 5 == 1
    config = tiny_config({'hidden': (40,)}, epochs=40, learning_rate=0.01, rest_repeats=0)
    return fit_network(dataset, held_out, config, Progress())[0]


@pytest.fixture(scope='module')
def harder() -> Dataset:
    """Another gel: the same press moves its markers by a half."""
    return polar(tiny_presses(300, seed=7), motion_gain=0.5)


def fresh_presses(count: int, seed: int) -> Dataset:
    """Others on the harder gel, with contact."""
    fresh = polar(tiny_presses(count, seed=seed), motion_gain=0.5)
    return fresh.take(np.flatnonzero(fresh.presses[:, 3] > 0))


def as_model(readout: NetworkReadout, encoding: str = 'polar_mean') -> LoadedModel:
    return LoadedModel(ForceModel(FeatureLayout(encoding, 6, 6, 2), readout.bins, readout, model_id='tiny'), CARD)


@pytest.fixture(scope='module')
def made(source: NetworkReadout, harder: Dataset) -> NetworkTransfer:
    return transfer_network(as_model(source), harder, QUICK)


def answers(readout: NetworkReadout, dataset: Dataset) -> np.ndarray:
    pairs = zip(dataset.features, dataset.rest, strict=True)
    return np.stack([readout.read(v.astype(np.float32), dataset.confidence[i]).normal_force_n for v, i in pairs])


@pytest.mark.parametrize('centred', [False, True])
def test_the_layer_begins_as_the_identity_to_the_bit(source: NetworkReadout, harder: Dataset, centred: bool) -> None:
    config = dataclasses.replace(QUICK, centred=centred)
    layer = LayerTraining.begin(source, harder, np.arange(len(harder.presses)), config).layer()
    few = harder.take(np.arange(50))
    before, after = (answers(each, few) for each in (source, dataclasses.replace(source, layer=layer)))
    assert after.tobytes() == before.tobytes()


@pytest.mark.parametrize('centred', [False, True])
def test_the_layer_in_training_is_the_one_that_is_read_live(
    source: NetworkReadout, harder: Dataset, centred: bool
) -> None:
    import torch

    every = np.arange(64)
    training = LayerTraining.begin(source, harder, every, dataclasses.replace(QUICK, centred=centred))
    for _ in range(3):
        training.step(torch.from_numpy(every))
    live = dataclasses.replace(source, layer=training.layer())
    with torch.no_grad():
        trained = training.answers(torch.from_numpy(every)).numpy() * source.output_scale_n
    assert np.abs(trained - answers(source, harder.take(every)).reshape(64, -1)).max() > 1e-2
    np.testing.assert_allclose(trained, answers(live, harder.take(every)).reshape(64, -1), atol=2e-4)


def test_a_centred_layer_takes_smaller_steps_at_the_same_rate(source: NetworkReadout, harder: Dataset) -> None:
    """One step of Nadam moves every weight by about the rate; of features that are never negative that adds up."""
    import torch

    every, moved = torch.arange(64), []
    for centred in (False, True):
        training = LayerTraining.begin(source, harder, every.numpy(), dataclasses.replace(QUICK, centred=centred))
        before = training.adjusted(every)
        training.step(every)
        moved.append(float((training.adjusted(every) - before).detach().square().mean().sqrt()))
    assert moved[1] < 0.5 * moved[0]


def test_the_network_behind_the_layer_and_its_scaling_stay(source: NetworkReadout, made: NetworkTransfer) -> None:
    assert made.readout.network is source.network
    assert made.readout.scaling is source.scaling
    assert np.abs(made.readout.layer.change).max() > 0


def test_units_of_regions_without_markers_are_never_moved(made: NetworkTransfer) -> None:
    """The corner region of these presses holds none."""
    assert not made.readout.layer.change[:2].any()
    assert made.readout.layer.bias[:2].tolist() == [0.0, 0.0]


def test_a_harder_gel_is_read_better_at_places_that_nothing_was_learned_at(
    source: NetworkReadout, made: NetworkTransfer
) -> None:
    assert made.after_paper.armse_n < 0.8 * made.before_paper.armse_n
    fresh = fresh_presses(100, seed=8)
    found = [answers(each, fresh).sum(axis=(1, 2)) for each in (source, made.readout)]
    before, after = (np.sqrt(np.mean((each - fresh.presses[:, 3]) ** 2)) for each in found)
    assert after < 0.7 * before


def test_stated_uncertainty_is_that_of_the_new_gel(source: NetworkReadout, made: NetworkTransfer) -> None:
    fresh = fresh_presses(150, seed=9)
    total_n = answers(made.readout, fresh).reshape(len(fresh.presses), -1).sum(axis=1)
    sigma = np.array([made.readout.spread.sigma_n(float(each)) for each in total_n])
    assert 0.75 < (np.abs(total_n - fresh.presses[:, 3]) <= 1.645 * sigma).mean() <= 1.0
    assert made.readout.spread != source.spread


def test_the_novelty_check_is_one_of_the_new_gel(source: NetworkReadout, made: NetworkTransfer) -> None:
    """It reads presses of that gel, to a tenth of their mean of 0.6 N; the other gel's takes half of the force."""
    fresh = fresh_presses(60, seed=11)
    assert made.readout.novelty_check is not None
    assert source.novelty_check is not None
    own, other = (_median_error_n(each, fresh) for each in (made.readout.novelty_check, source.novelty_check))
    assert own < 0.06
    assert other > 0.2


def _median_error_n(readout: Readout, data: Dataset) -> float:
    found = [readout.read(each.astype(np.float32), data.confidence[0]).contacts[0].force_n for each in data.features]
    return float(np.median(np.abs(np.array(found) - data.presses[:, 3])))


def test_a_calibrated_model_comes_back_from_its_file_with_the_same_answers(
    tmp_path: Path, made: NetworkTransfer, harder: Dataset
) -> None:
    # Half floats hold the network of the source as well, so that it is the model from a file that is compared.
    save_model(tmp_path / 'one.safetensors', as_model(made.readout).model, CARD)
    one = load_model(tmp_path / 'one.safetensors')
    save_model(tmp_path / 'two.safetensors', one.model, one.card)
    two = load_model(tmp_path / 'two.safetensors')
    assert one.model.readout.layer.weight.tobytes() == made.readout.layer.weight.tobytes()
    few = harder.take(np.arange(50))
    assert answers(two.model.readout, few).tobytes() == answers(one.model.readout, few).tobytes()


def test_the_best_epoch_is_kept(source: NetworkReadout, harder: Dataset) -> None:
    """At a rate that ruins the network with its first steps the best is what it was before them."""
    learned, stops = shuffled_parts(np.arange(200), QUICK)
    wild = dataclasses.replace(QUICK, learning_rate=5.0, patience=3)
    fitted = fit_layer(source, harder, learned, stops, wild)
    assert (fitted.best_epoch, fitted.epochs_run) == (0, 3)
    assert fitted.ended == '3 epochs without a better validation loss'
    assert not fitted.layer.change.any()


def test_what_is_kept_has_the_validation_loss_that_is_stated(source: NetworkReadout, harder: Dataset) -> None:
    learned, stops = shuffled_parts(np.arange(200), QUICK)
    fitted = fit_layer(source, harder, learned, stops, QUICK)
    restored = answers(dataclasses.replace(source, layer=fitted.layer), harder.take(stops)).reshape(len(stops), -1)
    off = restored - harder.take(stops).labels(source.bins)
    assert np.sqrt((off**2).mean(axis=0)).mean() == pytest.approx(fitted.best_armse_n, rel=1e-3)
    assert 0 < fitted.best_epoch <= fitted.epochs_run
    assert fitted.best_armse_n < fitted.start_armse_n


def test_without_the_start_the_first_epoch_is_the_best_so_far(source: NetworkReadout, harder: Dataset) -> None:
    learned, stops = shuffled_parts(np.arange(200), QUICK)
    letter = dataclasses.replace(QUICK, learning_rate=5.0, epochs=1, keep_start=False)
    fitted: FittedLayer = fit_layer(source, harder, learned, stops, letter)
    assert (fitted.best_epoch, fitted.ended) == (1, 'most epochs')
    assert fitted.best_armse_n > fitted.start_armse_n


def test_the_same_presses_give_the_same_layer(source: NetworkReadout, harder: Dataset) -> None:
    learned, stops = shuffled_parts(np.arange(100), QUICK)
    brief = dataclasses.replace(QUICK, epochs=3)
    one, other = (fit_layer(source, harder, learned, stops, brief).layer for _ in range(2))
    assert one.weight.tobytes() == other.weight.tobytes()


def test_cartesian_motion_is_refused_with_what_to_do(source: NetworkReadout, harder: Dataset) -> None:
    with pytest.raises(ModelError, match=r'cut off negative values.*polar_mean, such as paper, or start from portable'):
        transfer_network(as_model(source, 'cartesian_mean'), harder, QUICK)


def test_a_model_that_has_a_layer_names_the_one_to_calibrate(made: NetworkTransfer, harder: Dataset) -> None:
    with pytest.raises(ModelError, match=r'already has a calibration layer; calibrate the model .* abc123'):
        transfer_network(as_model(made.readout), harder, QUICK)


def test_few_presses_are_refused_with_what_to_do(source: NetworkReadout, harder: Dataset) -> None:
    with pytest.raises(DatasetError, match=r'needs at least 40 presses .*record more, or calibrate a response'):
        transfer_network(as_model(source), harder.take(np.arange(30)), QUICK)


def test_presses_in_one_corner_are_refused(source: NetworkReadout, harder: Dataset) -> None:
    corner = np.flatnonzero(harder.presses[:, 0] > 6)
    with pytest.raises(DatasetError, match=r'span .* mm along x of the 32.0 mm'):
        transfer_network(as_model(source), harder.take(corner), QUICK)


def test_a_calibration_that_does_not_pay_is_refused(source: NetworkReadout, harder: Dataset) -> None:
    ruinous = dataclasses.replace(QUICK, learning_rate=5.0, epochs=2, keep_start=False)
    with pytest.raises(DatasetError, match='would not help: at held-out places the aRMSE is'):
        transfer_network(as_model(source), harder, ruinous)


def test_the_card_says_how_the_layer_came_about(made: NetworkTransfer) -> None:
    said = made.as_dict()
    assert said['form'] == 'layer'
    assert said['fit']['best_epoch'] == made.fitted.best_epoch
    assert said['settings']['dropout'] == 0.05
    assert said['presses'] == 270  # a tenth of the 300 frames holds no contact
    assert said['after_paper']['armse_n'] < said['before_paper']['armse_n']


def test_the_published_settings_are_those_of_the_papers_table() -> None:
    letter = load_layer_config(Path(__file__).parents[3] / 'config' / 'transfer' / 'paper_letter.yaml')
    assert (letter.batch, letter.learning_rate, letter.patience, letter.dropout) == (64, 0.0001, 200, 0.05)
    assert (letter.centred, letter.keep_start) == (False, False)


def test_the_settings_that_ship_are_the_defaults() -> None:
    folder = Path(__file__).parents[3] / 'config' / 'transfer'
    assert load_layer_config(folder / 'paper.yaml') == LayerConfig()
    letter = load_layer_config(folder / 'paper_letter.yaml')
    ours = {name: getattr(LayerConfig(), name) for name in ('learning_rate', 'patience', 'centred', 'keep_start')}
    assert dataclasses.replace(letter, **ours) == LayerConfig()


def test_an_unknown_setting_is_an_error_that_names_it(tmp_path: Path) -> None:
    (tmp_path / 'layer.yaml').write_text('learning_rat: 0.1\n')
    with pytest.raises(ConfigurationError, match='learning_rat'):
        load_layer_config(tmp_path / 'layer.yaml')
