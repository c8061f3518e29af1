"""A network in training: its samples, its optimiser, one epoch, and the settings for a restart."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_nodes.learning.config import TrainConfig
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.network.inputs import fit_scaling, judging_samples, output_scale_n, prepare, shown_samples
from tactile_nodes.learning.network.layers import build_network
from tactile_nodes.learning.network.scores import Validation
from tactile_nodes.sensing.explain.network import InputScaling

if TYPE_CHECKING:
    import torch


def restarted(config: TrainConfig, attempt: int) -> TrainConfig:
    """The configuration of an attempt: at first as given, then with settings that help to leave the all-zero answer.

    These are features divided by their spread, no regions without markers, outputs in units of their size, balanced
    initial weights, squared error until there is an answer, and another seed. Each further attempt halves the step.
    """
    if attempt == 0:
        return config
    network, training = config.network, config.training
    return replace(
        config,
        network=replace(
            network,
            input_scaling='feature',
            confidence_floor=max(network.confidence_floor, 0.5),
            initial_weights='balanced',
            output_unit='rms',
        ),
        training=replace(
            training,
            warm_up_epochs=max(training.warm_up_epochs, 10),
            seed=training.seed + 1000 * attempt,
            learning_rate=training.learning_rate * 0.5 ** (attempt - 1),
        ),
    )


@dataclass
class Attempt:
    """A network in training, and its samples on the device."""

    config: TrainConfig
    scaling: InputScaling
    scale_n: float
    network: torch.nn.Sequential
    optimiser: torch.optim.Optimizer
    inputs: torch.Tensor
    labels: torch.Tensor
    shown: torch.Tensor
    judging: torch.Tensor

    @classmethod
    def begin(cls, dataset: Dataset, held_out: np.ndarray, config: TrainConfig, device: torch.device) -> Attempt:
        """Start with new weights from the configuration's seed."""
        import torch

        scaling = fit_scaling(dataset, np.flatnonzero(~held_out), config)
        labels = dataset.labels(config.bins)
        scale_n = output_scale_n(labels[~held_out], config)
        inputs = torch.from_numpy(prepare(dataset, scaling)).to(device)
        torch.manual_seed(config.training.seed)
        network = build_network(config, inputs.shape[1]).to(device)
        return cls(
            config=config,
            scaling=scaling,
            scale_n=scale_n,
            network=network,
            optimiser=torch.optim.NAdam(network.parameters(), lr=config.training.learning_rate),
            inputs=inputs,
            labels=torch.from_numpy(labels / np.float32(scale_n)).to(device),
            shown=torch.from_numpy(shown_samples(dataset, held_out, config)),
            judging=torch.from_numpy(judging_samples(dataset, held_out, config)).to(device),
        )

    def epoch(self, number: int) -> float:
        """Show every sample once; the loss, averaged over the batches. `number` counts from 1."""
        chosen = self.config.training
        loss = squared_error if number <= chosen.warm_up_epochs or chosen.loss == 'mse' else armse
        for group in self.optimiser.param_groups:
            group['lr'] = chosen.learning_rate * chosen.decay ** (number - 1)
        self.network.train()
        losses = [self._step(batch, loss) for batch in self._batches(chosen.batch)]
        return float(np.mean(losses))

    def _step(self, batch: torch.Tensor, loss: Callable[[torch.Tensor, torch.Tensor], torch.Tensor]) -> float:
        self.optimiser.zero_grad()
        value = loss(self.network(self.inputs[batch]), self.labels[batch])
        value.backward()  # type: ignore[no-untyped-call]
        self.optimiser.step()
        return float(value.detach())

    def _batches(self, size: int) -> Iterator[torch.Tensor]:
        import torch

        order = self.shown[torch.randperm(len(self.shown))].to(self.inputs.device)
        yield from torch.split(order, size)

    def validate(self) -> Validation:
        """Scores on the held-out samples."""
        import torch

        self.network.eval()
        with torch.no_grad():
            predicted = self.network(self.inputs[self.judging])
        true_n, predicted_n = (values.cpu().numpy() * self.scale_n for values in (self.labels[self.judging], predicted))
        return Validation.of(true_n, predicted_n, self.config.bins)


def squared_error(predicted: torch.Tensor, true: torch.Tensor) -> torch.Tensor:
    """Mean squared error."""
    return (predicted - true).square().mean()


def armse(predicted: torch.Tensor, true: torch.Tensor) -> torch.Tensor:
    """The paper's loss over a batch: each bin's root mean squared error, averaged over the bins."""
    # The addition keeps the root's slope finite if a bin is predicted exactly.
    return ((predicted - true).square().mean(dim=0) + 1e-12).sqrt().mean()
