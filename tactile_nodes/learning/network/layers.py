"""The network in torch: its layers, its initial weights, and its conversion to arrays for the live node."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from tactile_nodes.errors import from_extra
from tactile_nodes.learning.config import NetworkConfig, TrainConfig
from tactile_nodes.sensing.explain.network import Mlp

if TYPE_CHECKING:
    import torch


def import_torch() -> Any:
    """Import torch; if it is missing, the error says how to install it.

    Raises:
        ConfigurationError: torch is not installed.
    """
    with from_extra('train', 'training a network, unlike the live sensor,'):
        import torch
    return torch


def build_network(config: TrainConfig, inputs: int) -> torch.nn.Sequential:
    """The paper's network, or a variant of it: hidden layers, each followed by dropout, and linear outputs."""
    import torch

    chosen = config.network
    hidden = {'logistic': torch.nn.Sigmoid, 'relu': torch.nn.ReLU}[chosen.activation]
    layers: list[torch.nn.Module] = []
    for units in chosen.hidden:
        layers += [torch.nn.Linear(inputs, units), hidden(), torch.nn.Dropout(chosen.dropout)]
        inputs = units
    layers.append(torch.nn.Linear(inputs, config.bins.count))
    for number, layer in enumerate(layers):
        if isinstance(layer, torch.nn.Linear):
            _initialise(layer, chosen, first=number == 0, last=number == len(layers) - 1)
    return torch.nn.Sequential(*layers)


def _initialise(layer: torch.nn.Linear, chosen: NetworkConfig, *, first: bool, last: bool) -> None:
    """Glorot's spread and no bias; or, before logistic units, four times that, and biases that cancel inputs of a half.

    A logistic unit's slope is a quarter and its mean a half, so the second initially behaves as a layer of tanh.
    Rectified units get He's spread instead.
    """
    import torch

    balanced = chosen.initial_weights == 'balanced'
    rectified = balanced and chosen.activation == 'relu'
    gain = 1.0 if last or not balanced else 2**0.5 if rectified else 4.0
    torch.nn.init.xavier_uniform_(layer.weight, gain=gain)
    with torch.no_grad():
        half = 0.5 if balanced and not rectified and not first else 0.0
        layer.bias.copy_(-half * layer.weight.sum(dim=1))


def as_mlp(weights: Mapping[str, torch.Tensor], activation: str) -> Mlp:
    """A network's weights as numpy arrays, for the live node."""
    state = {name: value.detach().cpu().numpy().copy() for name, value in weights.items()}
    names = sorted({name.split('.')[0] for name in state}, key=int)
    return Mlp(
        tuple(state[f'{name}.weight'] for name in names), tuple(state[f'{name}.bias'] for name in names), activation
    )
