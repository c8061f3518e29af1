"""Train a force model: reads from top to bottom.

The network, its optimiser and its stopping rule are the paper's (Sferrazza and D'Andrea, IROS 2019, section V).
Three things are ours, because without them a network of logistic units sits on the all-zero answer that sparse
labels reward (`docs/method.md` has the measurements):

* Inputs are standardised, and regions without markers silenced; outputs are learned in units of their size.
* Weights start four times larger than Glorot's and biases such that every unit starts balanced, which makes a
  logistic layer behave as a tanh layer at the start. (A logistic unit's slope is a quarter, its mean a half.)
* Squared error comes first, or stays: its gradient points to the peak, while that of the aRMSE, divided by each
  bin's own error, forgets it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_nodes import __version__
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.config import TrainConfig
from tactile_nodes.learning.dataset import Dataset
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.source import TrainingData, training_data
from tactile_nodes.model_file import save_model
from tactile_nodes.sensing import metrics
from tactile_nodes.sensing.model import FeatureLayout, ForceModel, InputScaling, Mlp

if TYPE_CHECKING:
    import torch


def train(config: TrainConfig, *, progress: Progress | None = None, command: str = '') -> Path:
    """Get the presses, train the network, and write the model file that the configuration names.

    Ctrl-C ends the training and keeps the best network so far. The same configuration gives the same network
    on the same machine. `command` goes into the model's card.

    Raises:
        ConfigurationError: torch is not installed, or the configuration contradicts the recorded presses.
        DatasetError: the file of recorded presses cannot be used.
    """
    torch = import_torch()
    progress = progress or Progress()
    data = training_data(config, progress)
    config, dataset, held_out = data.config, data.dataset, data.held_out
    scaling = fit_scaling(dataset, ~held_out, config)
    inputs, labels = prepare(dataset, scaling), dataset.labels(config.bins)
    scale_n = float(np.sqrt(np.mean(labels[~held_out] ** 2)))

    torch.set_num_threads(config.training.threads)
    torch.use_deterministic_algorithms(True)
    torch.manual_seed(config.training.seed)
    network = build_network(config, inputs.shape[1])
    shown = torch.from_numpy(shown_samples(dataset, held_out, config))
    fit = Fit(network, torch.from_numpy(inputs), torch.from_numpy(labels / scale_n), shown, torch.from_numpy(held_out))
    try:
        fit.run(config, scale_n, progress)
    except KeyboardInterrupt:
        progress.say('stopped; keeping the best network so far')

    model = ForceModel(
        layout=FeatureLayout(config.encoding.name, *dataset.features.shape[1:]),
        bins=config.bins,
        scaling=scaling,
        network=as_mlp(network, fit.best_weights),
        output_scale_n=scale_n,
    )
    model_id = save_model(config.output, model, card_of(data, fit, scale_n, command))
    progress.say(
        f'{config.output}: model {model_id}, best of {fit.epoch} epochs: {fit.best_loss * scale_n:.4f} N aRMSE'
    )
    return config.output


def import_torch() -> Any:
    """torch, or a sentence that says how to get it.

    Raises:
        ConfigurationError: torch is not installed.
    """
    try:
        import torch
    except ImportError as error:
        raise ConfigurationError(
            'training needs torch, which the live sensor does not: install it with: pip install tactile_nodes[train]'
        ) from error
    return torch


def shown_samples(dataset: Dataset, held_out: np.ndarray, config: TrainConfig) -> np.ndarray:
    """Indices of the samples that an epoch shows; those without contact several times, so that rest reads zero."""
    untouched = np.flatnonzero(~held_out & (dataset.presses[:, 3] == 0))
    repeats = [untouched] * (config.training.rest_repeats - 1)
    return np.concatenate([np.flatnonzero(~held_out), *repeats])


def fit_scaling(dataset: Dataset, chosen: np.ndarray, config: TrainConfig) -> InputScaling:
    """Mean and spread of each feature, over the samples chosen, and the regions that held markers throughout."""
    floor = config.network.confidence_floor
    trusted = np.asarray((dataset.confidence >= floor).all(axis=0), np.float32)
    values = dataset.features[chosen].astype(np.float32)
    mean: np.ndarray = values.mean(axis=0)
    gain = 1 / np.maximum(np.asarray(values.std(axis=0)), np.float32(1e-6))
    return InputScaling(mean, gain * _channel_gains(config, mean.shape[-1]), trusted, floor)


def _channel_gains(config: TrainConfig, channels: int) -> np.ndarray:
    gains = config.network.channel_gains or (1.0,) * channels
    if len(gains) != channels:
        raise ConfigurationError(
            f'network.channel_gains has {len(gains)} values, but {config.encoding.name} has {channels} channels; '
            'give one for each'
        )
    return np.asarray(gains, np.float32)


def prepare(dataset: Dataset, scaling: InputScaling) -> np.ndarray:
    """The network's inputs, (samples, features), scaled as the live node scales them."""
    inputs = np.empty((len(dataset.features), dataset.features[0].size), np.float32)
    for number, confidence in enumerate(dataset.confidence):
        mine = np.flatnonzero(dataset.rest == number)
        values = dataset.features[mine].astype(np.float32)
        inputs[mine] = scaling(values, confidence).reshape(len(mine), -1)
    return inputs


def build_network(config: TrainConfig, inputs: int) -> torch.nn.Sequential:
    """The paper's network: logistic hidden layers, each followed by dropout, and plain outputs."""
    import torch

    layers: list[torch.nn.Module] = []
    for units in config.network.hidden:
        layers += [torch.nn.Linear(inputs, units), torch.nn.Sigmoid(), torch.nn.Dropout(config.network.dropout)]
        inputs = units
    layers.append(torch.nn.Linear(inputs, config.bins.count))
    for number, layer in enumerate(layers):
        if isinstance(layer, torch.nn.Linear):
            _initialise(layer, first=number == 0, last=number == len(layers) - 1)
    return torch.nn.Sequential(*layers)


def _initialise(layer: torch.nn.Linear, *, first: bool, last: bool) -> None:
    """Glorot's spread, times four where a logistic unit follows; inputs that average a half are balanced out."""
    import torch

    torch.nn.init.xavier_uniform_(layer.weight, gain=1.0 if last else 4.0)
    with torch.no_grad():
        layer.bias.copy_(torch.zeros_like(layer.bias) if first else -0.5 * layer.weight.sum(dim=1))


@dataclass
class Fit:
    """The optimisation: a network, its samples, and the best weights seen."""

    network: torch.nn.Sequential
    inputs: torch.Tensor
    labels: torch.Tensor
    shown: torch.Tensor
    held_out: torch.Tensor
    epoch: int = 0
    best_epoch: int = 0
    silent_epochs: int = 0
    best_loss: float = float('inf')
    best_weights: dict[str, torch.Tensor] | None = None

    def run(self, config: TrainConfig, scale_n: float, progress: Progress) -> None:
        """Epochs until the validation loss has not fallen for the paper's 50 of them."""
        import torch

        chosen = config.training
        optimiser = torch.optim.NAdam(self.network.parameters(), lr=chosen.learning_rate)
        decay = torch.optim.lr_scheduler.ExponentialLR(optimiser, chosen.decay)
        with progress.bar('training', chosen.epochs) as bar:
            while self.epoch < chosen.epochs and self._waited() < chosen.patience:
                self.epoch += 1
                training = self._one_epoch(optimiser, self._loss(config), chosen.batch)
                decay.step()
                measured = self._validate()
                bar.advance(1, describe(training * scale_n, measured, scale_n))

    def _waited(self) -> int:
        """Epochs since the best one, without those in which the network said nothing: they are no reason to stop."""
        return self.epoch - max(self.best_epoch, self.silent_epochs)

    def _loss(self, config: TrainConfig) -> Callable[[torch.Tensor, torch.Tensor], torch.Tensor]:
        warming = self.epoch <= config.training.warm_up_epochs
        return squared_error if warming or config.training.loss == 'mse' else armse

    def _one_epoch(self, optimiser: torch.optim.Optimizer, loss: Callable[..., torch.Tensor], batch: int) -> float:
        self.network.train()
        losses = []
        for chosen in self._batches(batch):
            optimiser.zero_grad()
            value = loss(self.network(self.inputs[chosen]), self.labels[chosen])
            value.backward()  # type: ignore[no-untyped-call]
            optimiser.step()
            losses.append(float(value.detach()))
        return float(np.mean(losses))

    def _batches(self, size: int) -> Iterator[torch.Tensor]:
        import torch

        yield from torch.split(self.shown[torch.randperm(len(self.shown))], size)

    def _validate(self) -> Validation:
        """Figures of merit on what is held out; remembers the best network by its aRMSE."""
        import torch

        self.network.eval()
        with torch.no_grad():
            predicted = self.network(self.inputs[self.held_out]).numpy()
        measured = Validation.of(self.labels[self.held_out].numpy(), predicted)
        if measured.silent:
            self.silent_epochs += 1
        if measured.armse < self.best_loss:
            self.best_loss, self.best_epoch = measured.armse, self.epoch
            self.best_weights = {name: value.clone() for name, value in self.network.state_dict().items()}
        return measured


SILENT_SHARE = 0.2
"""Predicted peaks that average less than this share of the true ones are no answer yet."""


@dataclass(frozen=True)
class Validation:
    """Figures of merit in the labels' scale."""

    armse: float
    peak_rmse: float
    right_bin: float
    peak_share: float

    @property
    def silent(self) -> bool:
        """Whether the network still gives the all-zero answer that sparse labels reward."""
        return self.peak_share < SILENT_SHARE

    @classmethod
    def of(cls, true: np.ndarray, predicted: np.ndarray) -> Validation:
        touched = np.abs(true).max(axis=1) > 0
        return cls(
            metrics.armse(true, predicted),
            metrics.peak_rmse_n(true, predicted),
            metrics.right_bin_share(true[touched], predicted[touched]),
            float(predicted[touched].max(axis=1).mean() / max(true[touched].max(axis=1).mean(), 1e-12)),
        )


def squared_error(predicted: torch.Tensor, true: torch.Tensor) -> torch.Tensor:
    """Mean squared error."""
    return (predicted - true).square().mean()


def armse(predicted: torch.Tensor, true: torch.Tensor) -> torch.Tensor:
    """The paper's loss over a batch: each bin's root mean squared error, averaged over the bins."""
    # The addition keeps the root's slope finite where a bin is predicted exactly.
    return ((predicted - true).square().mean(dim=0) + 1e-12).sqrt().mean()


def describe(training_loss: float, measured: Validation, scale_n: float) -> str:
    """What stands under the bar."""
    silent = '  (still the all-zero answer)' if measured.silent else ''
    return (
        f'loss {training_loss:.4f}  held out: aRMSE {measured.armse * scale_n:.4f} N  '
        f'RMSE_mc {measured.peak_rmse * scale_n:.4f} N  right bin {measured.right_bin:.1%}{silent}'
    )


def as_mlp(network: torch.nn.Sequential, weights: dict[str, torch.Tensor] | None) -> Mlp:
    """The network for the live node: numpy arrays."""
    if weights is not None:
        network.load_state_dict(weights)
    state = {name: value.detach().numpy().copy() for name, value in network.state_dict().items()}
    names = sorted({name.split('.')[0] for name in state}, key=int)
    return Mlp(tuple(state[f'{name}.weight'] for name in names), tuple(state[f'{name}.bias'] for name in names))


def card_of(data: TrainingData, fit: Fit, scale_n: float, command: str) -> dict[str, Any]:
    """What a stranger needs to know about the model."""
    config = data.config
    return {
        'command': command,
        'made_with': f'tactile_nodes {__version__}',
        'licence': 'the same as tactile_nodes',
        'flow': {'name': config.flow.name, 'options': config.make_flow().options},
        'encoding': {'name': config.encoding.name, 'options': config.make_encoding().options},
        'crop_px': config.data.crop,
        'gel': data.gel,
        'data': {**data.origin, 'fingerprint': data.dataset.fingerprint},
        'training': {**asdict(config.training), **asdict(config.network), 'epochs_run': fit.epoch},
        'validation': {'armse_n': fit.best_loss * scale_n, 'epoch': fit.best_epoch},
    }
