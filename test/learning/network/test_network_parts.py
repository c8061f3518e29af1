from __future__ import annotations

import dataclasses
from importlib.util import find_spec

import numpy as np
import pytest
from tiny_training import tiny_config, tiny_held_out, tiny_presses

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.config import NetworkConfig, TrainConfig
from tactile_nodes.learning.network.calibration import fit_likeness, fit_spread, principal_directions
from tactile_nodes.learning.network.inputs import (
    fit_scaling,
    judging_samples,
    output_scale_n,
    prepare,
    shown_samples,
)
from tactile_nodes.learning.network.layers import as_mlp, build_network

pytestmark = pytest.mark.skipif(find_spec('torch') is None, reason='torch is not installed')

EVERY = np.arange(120)


def test_frames_without_contact_are_shown_as_often_as_said():
    data, held_out = tiny_presses(), tiny_held_out()
    counts = np.bincount(shown_samples(data, held_out, tiny_config(rest_repeats=3)), minlength=120)
    assert (counts[held_out] == 0).all()
    assert (counts[~held_out] == np.where(data.presses[~held_out, 3] == 0, 3, 1)).all()


def test_without_frames_at_rest_only_presses_train_and_judge():
    data, config = tiny_presses(), tiny_config(rest_repeats=0)
    held_out = np.arange(120) % 10 < 2  # a frame at rest and a press of each ten
    assert (data.presses[shown_samples(data, held_out, config), 3] > 0).all()
    assert len(judging_samples(data, held_out, config)) == 12


def test_features_as_they_are_stay_so():
    """To the letter of the paper: no scaling, and no region silenced."""
    data = tiny_presses()
    scaling = fit_scaling(data, EVERY, tiny_config({'input_scaling': 'none', 'confidence_floor': 0.0}))
    np.testing.assert_array_equal(prepare(data, scaling), data.features.astype(np.float32).reshape(120, -1))


def test_regions_without_markers_are_silenced():
    data = tiny_presses()
    inputs = prepare(data, fit_scaling(data, EVERY, tiny_config())).reshape(data.features.shape)
    assert (inputs[:, 0, 0] == 0).all()
    assert (inputs[:, 1:] != 0).any()


@pytest.mark.parametrize('kind', ['channel', 'feature'])
def test_scaled_features_have_no_mean_and_a_spread_of_one(kind: str):
    data = tiny_presses()
    scaling = fit_scaling(data, EVERY, tiny_config({'input_scaling': kind, 'confidence_floor': 0.0}))
    inputs = prepare(data, scaling).reshape(data.features.shape)
    axes = (0, 1, 2) if kind == 'channel' else 0
    np.testing.assert_allclose(inputs.mean(axis=axes, dtype=float), 0, atol=1e-4)
    np.testing.assert_allclose(inputs.std(axis=axes, dtype=float), 1, atol=1e-3)


def test_channels_are_weighted_as_said():
    data = tiny_presses()
    plain = fit_scaling(data, EVERY, tiny_config()).gain
    other = fit_scaling(data, EVERY, tiny_config({'channel_gains': (1.0, 0.2)})).gain
    np.testing.assert_allclose(other[..., 0], plain[..., 0])
    np.testing.assert_allclose(other[..., 1], 0.2 * plain[..., 1], rtol=1e-6)


def test_a_weight_for_each_channel_is_demanded():
    with pytest.raises(ConfigurationError, match='channel_gains has 1 values, but cartesian_mean has 2 channels'):
        fit_scaling(tiny_presses(), EVERY, tiny_config({'channel_gains': (1.0,)}))


def test_an_output_of_one_means_a_newton_or_the_labels_size():
    labels = np.array([[3.0, 0.0], [4.0, 0.0]], np.float32)
    assert output_scale_n(labels, tiny_config({'output_unit': 'newton'})) == 1.0
    assert output_scale_n(labels, tiny_config()) == pytest.approx(2.5)  # sqrt((9 + 16) / 4)


@pytest.mark.parametrize('activation', ['logistic', 'relu'])
def test_the_live_network_computes_what_torch_does(activation: str):
    import torch

    config, data = tiny_config({'activation': activation, 'hidden': (8, 6)}), tiny_presses()
    inputs = prepare(data, fit_scaling(data, EVERY, config))
    network = build_network(config, inputs.shape[1]).eval()
    with torch.no_grad():
        expected = network(torch.from_numpy(inputs)).numpy()
    mlp = as_mlp(network.state_dict(), activation)
    np.testing.assert_allclose([mlp(each) for each in inputs], expected, atol=1e-5)


@pytest.mark.parametrize(('activation', 'mean', 'spread'), [('logistic', 0.5, (0.1, 0.4)), ('relu', 0.55, (0.5, 1.2))])
def test_a_network_starts_balanced(activation: str, mean: float, spread: tuple[float, float]):
    """Logistic units start around a half, so that neither the next layer nor the gradient begins in a corner.

    Rectified units keep the size of what comes in: of a normal distribution of spread s half is cut off, and the mean
    of the rest is 0.4 s; with He's spread (for as many outputs as inputs) s is the root of two.
    """
    import torch

    torch.manual_seed(0)
    config = TrainConfig(network=NetworkConfig(hidden=(800, 800), activation=activation))
    network = build_network(config, 800).eval()
    with torch.no_grad():
        hidden = network[:5](torch.randn(50, 800))  # up to the second layer's units
    assert hidden.mean().item() == pytest.approx(mean, abs=0.04)
    assert spread[0] < hidden.std().item() < spread[1]


def test_glorots_weights_have_glorots_limits_and_no_bias():
    network = build_network(tiny_config({'initial_weights': 'glorot'}), 72)
    limit = np.sqrt(6 / (72 + 8))
    assert 0.9 * limit < network[0].weight.abs().max().item() <= limit
    assert not network[0].bias.any()


def test_stated_uncertainty_covers_nine_of_ten():
    """Errors of 5 mN plus 4 % of the force: floor and share are found, and fresh errors fall within."""
    random = np.random.default_rng(1)
    force = random.uniform(0, 1, 4000)
    errors = np.hypot(0.005, 0.04 * force) * random.normal(size=4000)
    spread = fit_spread(force[:2000], errors[:2000])
    assert spread.floor_n == pytest.approx(0.005, rel=0.35)
    assert spread.share == pytest.approx(0.04, rel=0.25)
    within = np.abs(errors[2000:]) < 1.645 * np.hypot(spread.floor_n, spread.share * force[2000:])
    assert 0.87 < within.mean() < 0.93


def test_principal_directions_are_those_of_the_samples():
    along = np.random.default_rng(1).normal(size=(50, 1)).astype(np.float32) @ np.array([[3.0, 4.0]], np.float32)
    direction = principal_directions(along, 1)[0]
    np.testing.assert_allclose(np.abs(direction), [0.6, 0.8], rtol=1e-5)


def test_inputs_off_the_known_directions_are_unlike():
    """In a hundred inputs presses take three directions; one of the same size in another direction stands out."""
    random = np.random.default_rng(2)
    basis = np.linalg.qr(random.normal(size=(100, 100)))[0].astype(np.float32)
    known = (random.normal(size=(1500, 3)) @ basis[:, :3].T + 0.01 * random.normal(size=(1500, 100))).astype(np.float32)
    likeness = fit_likeness(known[:1000], known[1000:])
    assert np.mean([likeness.unlikeness(each) > 1 for each in known[1000:]]) <= 0.002
    assert likeness.unlikeness(3 * basis[:, 50]) > 5


def test_a_network_of_the_papers_sizes_has_its_parameters():
    config = dataclasses.replace(TrainConfig(), network=NetworkConfig())
    assert sum(each.numel() for each in build_network(config, 3200).parameters()) == 3_074_081
