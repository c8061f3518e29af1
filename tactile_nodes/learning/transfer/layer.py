"""The paper's calibration layer, fitted to presses on another gel: rectified units before a frozen network.

Section V and Table III of the paper. The layer acts on the raw features, before the scaling that a network may have.
Raw features of the polar encoding are never negative, so rectified units with identity weights change nothing at
first. Of features minus their mean they would cut off half. The scaling and the network behind the layer stay.

Regions that the scaling silences are left out, because their gradient is zero.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_nodes import clock
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.network.attempt import armse
from tactile_nodes.learning.network.layers import import_torch
from tactile_nodes.learning.progress import Progress
from tactile_nodes.params import from_mapping, load_mapping, parameter
from tactile_nodes.paths import described_in
from tactile_nodes.sensing.explain.network import CalibrationLayer, NetworkReadout
from tactile_nodes.shapes import Int

if TYPE_CHECKING:
    import torch

UNITS_PER_BLOCK = 64
"""The weights are kept in blocks that fit a processor's cache, since Nadam passes over each eight times."""


@dataclass(frozen=True)
class LayerConfig:
    """How the layer is fitted: batch and dropout are the paper's, the others are tuned (`paper_letter.yaml` has its).

    Nadam's first step moves every weight by the rate, so a unit by the rate times the sum of its inputs. Features of
    the polar encoding are never negative and add up to thousands, most of it from angles. Minus their mean they do not.
    """

    batch: int = parameter(64, 'presses per step', minimum=1)
    learning_rate: float = parameter(3e-5, "Nadam's step size", minimum=0.0)
    patience: int = parameter(40, 'epochs without a better validation loss before stopping', minimum=1)
    dropout: float = parameter(0.05, "share of the layer's units left out in training", minimum=0.0, maximum=0.9)
    centred: bool = parameter(True, 'weights act on features minus their mean; the bias compensates')
    keep_start: bool = parameter(True, 'the identity counts as the best so far when training begins')
    epochs: int = parameter(1000, 'most epochs', minimum=1)
    validation: float = parameter(0.1, 'share of the presses that stop the training', minimum=0.01, maximum=0.5)
    judged: float = parameter(0.2, 'share of the places held out for evaluation', minimum=0.05, maximum=0.5)
    seed: int = parameter(1, 'seed of order, dropout and held-out presses', minimum=0)
    threads: int = parameter(1, 'processor threads; the result depends on it in the last digits', minimum=1)


def load_layer_config(path: Path | str) -> LayerConfig:
    """Read the settings from a YAML file, or the one of this name that ships.

    Raises:
        ConfigurationError: it is missing, no YAML, or has an unknown key or a value of the wrong type.
    """
    file = described_in('transfer', path, 'layer')
    return from_mapping(LayerConfig, load_mapping(file), source=str(file))


@dataclass(frozen=True)
class FittedLayer:
    """The layer with the lowest validation loss (N), and its training history. Epoch 0 is the identity."""

    layer: CalibrationLayer
    best_epoch: int
    epochs_run: int
    ended: str
    start_armse_n: float
    best_armse_n: float
    seconds: float

    def as_dict(self) -> dict[str, Any]:
        """The entry in the model card."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__ if name != 'layer'}


@dataclass
class LayerTraining:
    """A layer in training before frozen weights, with its samples.

    `rows` are the weights of the active units, in blocks. `centre` is subtracted from the features.
    """

    config: LayerConfig
    scale_n: float
    units: torch.Tensor
    features: torch.Tensor
    used: torch.Tensor
    labels: torch.Tensor
    centre: torch.Tensor
    rows: list[torch.Tensor]
    bias: torch.Tensor
    frozen: list[torch.Tensor]
    hidden: str
    optimiser: torch.optim.Optimizer

    @classmethod
    def begin(
        cls, readout: NetworkReadout, dataset: Dataset, learned: Int[np.ndarray, ' learned'], config: LayerConfig
    ) -> LayerTraining:
        """Start from the identity, which changes nothing; the features' mean is that of the training samples.

        Raises:
            ConfigurationError: torch is not installed.
        """
        torch = import_torch()
        torch.set_num_threads(config.threads)
        torch.manual_seed(config.seed)
        scaling, channels = readout.scaling, dataset.features.shape[-1]
        units = np.flatnonzero(np.repeat(scaling.trusted.reshape(-1) > 0, channels))
        seen = (dataset.confidence >= scaling.confidence_floor).reshape(len(dataset.confidence), -1)
        used = np.repeat(seen, channels, axis=1)[:, units].astype(np.float32)[dataset.rest]
        features = torch.from_numpy(dataset.features.reshape(len(dataset.features), -1).astype(np.float32))
        identity = torch.eye(features.shape[1])[units]
        rows = [block.clone().requires_grad_() for block in identity.split(UNITS_PER_BLOCK)]
        bias = torch.zeros(len(units), requires_grad=True)
        labels = dataset.labels(readout.bins) / np.float32(readout.output_scale_n)
        return cls(
            config=config,
            scale_n=readout.output_scale_n,
            units=torch.from_numpy(units),
            features=features,
            used=torch.from_numpy(used),
            labels=torch.from_numpy(labels),
            centre=features[learned].mean(dim=0) if config.centred else torch.zeros(features.shape[1]),
            rows=rows,
            bias=bias,
            frozen=_frozen(readout, units),
            hidden=readout.network.hidden,
            optimiser=torch.optim.NAdam([*rows, bias], lr=config.learning_rate, foreach=False),
        )

    def adjusted(self, samples: torch.Tensor) -> torch.Tensor:
        """The layer's outputs of the active units for some samples."""
        import torch

        features = self.features[samples] - self.centre
        summed = torch.cat([features @ block.T for block in self.rows], dim=1)
        return torch.relu(summed + self.bias + self.centre[self.units])

    def answers(self, samples: torch.Tensor, dropout: float = 0.0) -> torch.Tensor:
        """The frozen network's outputs for some samples."""
        import torch

        mean, gain, *layers = self.frozen
        values = torch.nn.functional.dropout(self.adjusted(samples), dropout, training=dropout > 0)
        values = (values - mean) * gain * self.used[samples]
        hidden = {'logistic': torch.sigmoid, 'relu': torch.relu}[self.hidden]
        for weight, bias in zip(layers[:-2:2], layers[1:-2:2], strict=True):
            values = hidden(torch.nn.functional.linear(values, weight, bias))
        return torch.nn.functional.linear(values, *layers[-2:])

    def step(self, samples: torch.Tensor) -> float:
        """One step down the paper's loss; returns the loss of the samples before it, in N."""
        self.optimiser.zero_grad()
        loss = armse(self.answers(samples, self.config.dropout), self.labels[samples])
        loss.backward()  # type: ignore[no-untyped-call]
        self.optimiser.step()
        return float(loss.detach()) * self.scale_n

    def epoch(self, learned: torch.Tensor) -> float:
        """Show every sample once; the loss in N, averaged over the batches."""
        return float(np.mean([self.step(batch) for batch in self._batches(learned)]))

    def _batches(self, learned: torch.Tensor) -> Iterator[torch.Tensor]:
        import torch

        yield from torch.split(learned[torch.randperm(len(learned))], self.config.batch)

    def loss_n(self, samples: torch.Tensor) -> float:
        """The paper's loss over some samples, without dropout."""
        import torch

        with torch.no_grad():
            return float(armse(self.answers(samples), self.labels[samples])) * self.scale_n

    def state(self) -> list[torch.Tensor]:
        """A copy of weights and bias."""
        return [each.detach().clone() for each in (*self.rows, self.bias)]

    def restore(self, state: list[torch.Tensor]) -> None:
        """Restore what `state` returned."""
        for own, kept in zip((*self.rows, self.bias), state, strict=True):
            own.data.copy_(kept)

    def layer(self) -> CalibrationLayer:
        """The layer as the live node uses it, rounded to the digits that a model file keeps."""
        import torch

        with torch.no_grad():
            weight, bias = torch.eye(self.features.shape[1]), torch.zeros(self.features.shape[1])
            weight[self.units] = torch.cat(self.rows)
            bias[self.units] = self.bias + (self.centre - weight @ self.centre)[self.units]
        exact = CalibrationLayer(weight.numpy(), bias.numpy())
        return CalibrationLayer.of_change(exact.change, exact.bias)


def _frozen(readout: NetworkReadout, units: Int[np.ndarray, ' units']) -> list[torch.Tensor]:
    """Mean, gain, and weights and biases of each layer; those of the first layer for the active units."""
    import torch

    scaling, network = readout.scaling, readout.network
    first, *others = network.weights
    arrays: list[np.ndarray] = [each.reshape(-1)[units] for each in (scaling.mean, scaling.gain)]
    for weight, bias in zip((first[:, units], *others), network.biases, strict=True):
        arrays += [weight, bias]
    return [torch.from_numpy(np.ascontiguousarray(each)) for each in arrays]


def fit_layer(
    readout: NetworkReadout,
    dataset: Dataset,
    learned: Int[np.ndarray, ' learned'],
    judges: Int[np.ndarray, ' judges'],
    config: LayerConfig,
    progress: Progress | None = None,
) -> FittedLayer:
    """Train until the validation loss has not fallen for the paper's 200 epochs; Ctrl-C keeps the best layer.

    Raises:
        ConfigurationError: torch is not installed.
    """
    torch = import_torch()
    begun = clock.perf_ns()
    training = LayerTraining.begin(readout, dataset, learned, config)
    shown, judging = torch.from_numpy(learned), torch.from_numpy(judges)
    search = _Search(config, training.loss_n(judging))
    best = training.state()
    with (progress or Progress()).bar('fitting the layer', config.epochs) as bar:
        try:
            while not search.ended:
                loss_n = training.epoch(shown)
                if search.better(training.loss_n(judging)):
                    best = training.state()
                bar.advance(1, f'loss {loss_n:.4f} N  {search}')
        except KeyboardInterrupt:
            search.ended = 'interrupted'
    training.restore(best)
    seconds = round((clock.perf_ns() - begun) / clock.NS_PER_S, 1)
    return FittedLayer(
        training.layer(), search.best_epoch, search.epoch, search.ended, search.start_n, search.best_n, seconds
    )


class _Search:
    """Early stopping: the best epoch so far, and whether it is long ago."""

    def __init__(self, config: LayerConfig, start_n: float) -> None:
        self._config = config
        self.start_n = start_n
        self.best_n = start_n if config.keep_start else float('inf')
        self.best_epoch = self.epoch = 0
        self.ended = ''

    def better(self, loss_n: float) -> bool:
        """Count an epoch with its loss; returns whether it is the best so far."""
        self.epoch += 1
        found = loss_n < self.best_n
        if found:
            self.best_n, self.best_epoch = loss_n, self.epoch
        elif self.epoch - self.best_epoch >= self._config.patience:
            self.ended = f'{self._config.patience} epochs without a better validation loss'
        if not self.ended and self.epoch >= self._config.epochs:
            self.ended = 'most epochs'
        return found

    def __str__(self) -> str:
        return f'held out {self.best_n:.4f} N at epoch {self.best_epoch}, {self.start_n:.4f} N without the layer'
