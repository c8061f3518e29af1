"""Samples as a network uses them: which ones are shown, the scaling of features, and the unit of forces."""

from __future__ import annotations

import numpy as np

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.config import NetworkConfig, TrainConfig
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.sensing.explain.network import InputScaling
from tactile_nodes.shapes import Bool, Float32, Int

LEAST_SPREAD = np.float32(1e-6)


def shown_samples(
    dataset: Dataset, held_out: Bool[np.ndarray, ' samples'], config: TrainConfig
) -> Int[np.ndarray, ' shown']:
    """Indices of the samples in an epoch; those without contact as often as the configuration says."""
    touched = dataset.presses[:, 3] > 0
    untouched = [np.flatnonzero(~held_out & ~touched)] * config.training.rest_repeats
    return np.concatenate([np.flatnonzero(~held_out & touched), *untouched])


def judging_samples(
    dataset: Dataset, held_out: Bool[np.ndarray, ' samples'], config: TrainConfig
) -> Int[np.ndarray, ' judges']:
    """Indices of the samples that stop the training; those without contact only if some are shown."""
    judges = held_out if config.training.rest_repeats else held_out & (dataset.presses[:, 3] > 0)
    return np.flatnonzero(judges)


def fit_scaling(dataset: Dataset, chosen: np.ndarray, config: TrainConfig) -> InputScaling:
    """The scaling of features, measured on the samples chosen, and the regions that hold markers.

    Raises:
        ConfigurationError: not one gain for each channel.
    """
    network, floor = config.network, config.network.confidence_floor
    trusted = dataset.trusted(floor)
    mean, spread = _mean_and_spread(dataset.features[chosen].astype(np.float32), trusted > 0, network.input_scaling)
    gains = _channel_gains(network, config.encoding.name, mean.shape[-1])
    return InputScaling(mean, gains / np.maximum(spread, LEAST_SPREAD), trusted, floor)


def _mean_and_spread(
    values: Float32[np.ndarray, 'samples rows cols channels'], trusted: Bool[np.ndarray, 'rows cols'], kind: str
) -> tuple[Float32[np.ndarray, 'rows cols channels'], Float32[np.ndarray, 'rows cols channels']]:
    shape = values.shape[1:]
    if kind == 'none':
        return np.zeros(shape, np.float32), np.ones(shape, np.float32)
    if kind == 'channel':
        seen = values[:, trusted]
        mean, spread = seen.mean(axis=(0, 1), dtype=np.float64), seen.std(axis=(0, 1), dtype=np.float64)
        return np.full(shape, mean, np.float32), np.full(shape, spread, np.float32)
    return np.asarray(values.mean(axis=0)), np.asarray(values.std(axis=0))


def _channel_gains(network: NetworkConfig, encoding: str, channels: int) -> Float32[np.ndarray, ' channels']:
    gains = network.channel_gains or (1.0,) * channels
    if len(gains) != channels:
        raise ConfigurationError(
            f'network.channel_gains has {len(gains)} values, but {encoding} has {channels} channels; give one for each'
        )
    return np.asarray(gains, np.float32)


def prepare(dataset: Dataset, scaling: InputScaling) -> Float32[np.ndarray, 'samples inputs']:
    """The network's inputs, scaled as the live node scales them."""
    inputs = np.empty((len(dataset.features), dataset.features[0].size), np.float32)
    for number, confidence in enumerate(dataset.confidence):
        mine = np.flatnonzero(dataset.rest == number)
        values = dataset.features[mine].astype(np.float32)
        inputs[mine] = scaling(values, confidence).reshape(len(mine), inputs.shape[1])
    return inputs


def output_scale_n(labels: Float32[np.ndarray, 'samples bins'], config: TrainConfig) -> float:
    """The force (N) of an output of 1."""
    return 1.0 if config.network.output_unit == 'newton' else float(np.sqrt(np.mean(labels**2)))
