"""The complete state of an optimisation in one safetensors file, to continue it bit for bit.

Weights, the best weights so far, the optimiser's state of each weight and the random generators' states are tensors.
Counters are JSON in the file's metadata. The file is written atomically.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tactile_nodes.errors import ModelError
from tactile_nodes.files import check_size
from tactile_nodes.paths import write_whole

if TYPE_CHECKING:
    import torch

FORMAT = 'tactile_nodes.checkpoint'
_LARGEST_BYTES = 4 << 30


@dataclass
class Counters:
    """Progress of a training.

    `attempt` is 0 until an all-zero network is started again. `spoke_epoch` and `best_epoch` are epochs of
    this attempt, 0 until there is one. `ended` says why no epoch follows.
    """

    epoch: int = 0
    attempt: int = 0
    attempt_start: int = 0
    spoke_epoch: int = 0
    best_epoch: int = 0
    best_armse_n: float = float('inf')
    seconds: float = 0.0
    ended: str = ''


@dataclass
class Snapshot:
    """Counters and tensors by name, such as 'network.0.weight' and 'optimiser.1.exp_avg'."""

    counters: Counters
    tensors: dict[str, torch.Tensor]

    def part(self, prefix: str) -> dict[str, torch.Tensor]:
        """The tensors below a name."""
        return {
            name.removeprefix(f'{prefix}.'): tensor
            for name, tensor in self.tensors.items()
            if name.startswith(f'{prefix}.')
        }


def write(path: Path, snapshot: Snapshot) -> None:
    """Replace the previous snapshot.

    Raises:
        ModelError: writing failed, as on a full disk; the previous snapshot stays.
    """
    import safetensors.torch

    tensors = {name: tensor.detach().cpu().contiguous() for name, tensor in snapshot.tensors.items()}
    counters = {name: value for name, value in asdict(snapshot.counters).items() if value != float('inf')}
    try:
        write_whole(path, safetensors.torch.save(tensors, {FORMAT: json.dumps(counters)}))
    except OSError as error:
        raise ModelError(
            f'cannot write the checkpoint {path} ({error.strerror}); make room, and the same command continues'
        ) from error


def read(path: Path) -> Snapshot | None:
    """The snapshot of a run; None if there is none yet.

    Raises:
        ModelError: the file is damaged.
    """
    from safetensors import SafetensorError, safe_open

    if not path.is_file():
        return None
    try:
        check_size(path, _LARGEST_BYTES)
        with safe_open(path, framework='pt') as opened:
            counters: Mapping[str, object] = json.loads(opened.metadata()[FORMAT])
            tensors = {name: opened.get_tensor(name) for name in opened.keys()}  # noqa: SIM118  (no mapping)
        return Snapshot(Counters(**counters), tensors)  # type: ignore[arg-type]
    except (SafetensorError, KeyError, TypeError, ValueError, OSError) as error:
        raise ModelError(f'the checkpoint {path} is damaged; train again with: tactile train … --fresh') from error


def optimiser_tensors(optimiser: torch.optim.Optimizer) -> dict[str, torch.Tensor]:
    """The state of each weight, numbered in the optimiser's order."""
    return {
        f'optimiser.{number}.{name}': value
        for number, weight in enumerate(_weights(optimiser))
        for name, value in optimiser.state[weight].items()
    }


def restore_optimiser(optimiser: torch.optim.Optimizer, tensors: Mapping[str, torch.Tensor]) -> None:
    """The inverse of `optimiser_tensors`. Counters stay on the CPU, as in the optimiser."""
    for number, weight in enumerate(_weights(optimiser)):
        mine = {name.split('.')[1]: value for name, value in tensors.items() if name.split('.')[0] == str(number)}
        optimiser.state[weight] = {
            name: value.to(weight.device) if value.shape == weight.shape else value.clone()
            for name, value in mine.items()
        }


def _weights(optimiser: torch.optim.Optimizer) -> list[torch.Tensor]:
    return [weight for group in optimiser.param_groups for weight in group['params']]


def random_tensors() -> dict[str, torch.Tensor]:
    """The state of torch's random generators."""
    import torch

    states = {'random.cpu': torch.get_rng_state()}
    if torch.cuda.is_available():
        states['random.cuda'] = torch.cuda.get_rng_state()
    return states


def restore_random(states: Mapping[str, torch.Tensor]) -> None:
    """The inverse of `random_tensors`."""
    import torch

    torch.set_rng_state(states['cpu'])
    if 'cuda' in states and torch.cuda.is_available():
        torch.cuda.set_rng_state(states['cuda'])
