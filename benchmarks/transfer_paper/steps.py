"""The harm of the layer's published rate: its first training steps, with one setting changed at a time."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tactile_nodes.learning.datasets.simulated import Dataset
    from tactile_nodes.learning.transfer.layer import LayerConfig
    from tactile_nodes.sensing.explain.network import NetworkReadout

PRESSES, EPOCHS = 400, 5


@dataclass(frozen=True)
class FirstSteps:
    """The first steps with one setting. Lengths are in px, because half of the units are magnitudes.

    `most_px` is the rate times the mean sum of a unit's inputs. `moved_px` is the change of the magnitudes by the first
    step (root mean square), and `moved_spreads` the same relative to each one's spread over the source's presses. The
    losses are the paper's, over all other presses of the grid: before training, after one step, one epoch, and five.
    `peak_share` is the mean predicted peak over the true one, after the last epoch.
    """

    setting: str
    rate: float
    most_px: float
    moved_px: float
    moved_spreads: float
    start_n: float
    step_n: float
    epoch_n: float
    last_n: float
    peak_share: float


def variants() -> dict[str, LayerConfig]:
    """The published settings, and variants with one change."""
    from tactile_nodes.learning.transfer.layer import load_layer_config
    from tactile_nodes.paths import share_directory

    letter = load_layer_config(share_directory() / 'config' / 'transfer' / 'paper_letter.yaml')
    rate = letter.learning_rate
    return {
        'as published': letter,
        'no dropout': dataclasses.replace(letter, dropout=0.0),
        'all presses in one batch': dataclasses.replace(letter, batch=PRESSES),
        'features minus their mean': dataclasses.replace(letter, centred=True),
        'a tenth of the rate': dataclasses.replace(letter, learning_rate=rate / 10),
        'a tenth, minus their mean': dataclasses.replace(letter, learning_rate=rate / 10, centred=True),
        'a hundredth of the rate': dataclasses.replace(letter, learning_rate=rate / 100),
    }


def first_steps(readout: NetworkReadout, grid: Dataset) -> list[FirstSteps]:
    """The first steps of every variant, trained on half of the grid and tested on the other half."""
    return [_begin(readout, grid, name, config) for name, config in variants().items()]


def _begin(readout: NetworkReadout, grid: Dataset, name: str, config: LayerConfig) -> FirstSteps:
    import torch

    from tactile_nodes.learning.network.scores import Validation
    from tactile_nodes.learning.transfer.layer import LayerTraining

    count = len(grid.presses)
    half = min(PRESSES, count // 2)
    learned, tested = torch.arange(half), torch.arange(half, count)
    training = LayerTraining.begin(readout, grid, learned.numpy(), config)
    magnitudes = (training.units % grid.features.shape[-1]) == 0
    entering = (training.features[learned] - training.centre).abs().sum(dim=1).mean()
    with torch.no_grad():
        before, start_n = training.adjusted(tested), training.loss_n(tested)
    training.step(learned[: config.batch])
    with torch.no_grad():
        moved = (training.adjusted(tested) - before)[:, magnitudes]
        step_n = training.loss_n(tested)
    gain = training.frozen[1][magnitudes]
    losses = []
    for _ in range(EPOCHS):
        training.epoch(learned)
        losses.append(training.loss_n(tested))
    with torch.no_grad():
        found_n = training.answers(tested).numpy() * training.scale_n
    scores = Validation.of(grid.take(tested.numpy()).labels(readout.bins), found_n, readout.bins)
    return FirstSteps(
        name, config.learning_rate, config.learning_rate * float(entering), float(moved.square().mean().sqrt()),
        float((moved * gain).square().mean().sqrt()), start_n, step_n, losses[0], losses[-1], scores.peak_share,
    )  # fmt: skip
