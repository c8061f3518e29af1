"""A training that takes a second: presses on a gel of six by six regions whose motion has a simple law."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from tactile_nodes.learning.config import Choice, NetworkConfig, TrainConfig, TrainingConfig
from tactile_nodes.learning.datasets.simulated import Dataset

PRESSES = 120


def tiny_presses(count: int = PRESSES, seed: int = 0) -> Dataset:
    """Regions move away from the tip, the more the nearer and the harder; a tenth of the frames is without contact."""
    random = np.random.default_rng(seed)
    places, force = random.uniform(-15, 15, (count, 2)), random.uniform(0.2, 1.0, count)
    force[::10] = 0.0
    along = np.linspace(-13.0, 13.0, 6)
    regions = np.stack(np.meshgrid(along, along), axis=-1)
    away = regions[None] - places[:, None, None]
    motion = force[:, None, None, None] * away * np.exp(-(away**2).sum(axis=-1, keepdims=True) / 50)
    features = motion + 0.01 * random.normal(size=motion.shape)
    presses = np.column_stack([places, np.where(force > 0, 2 * force, -1.0), force]).astype(np.float32)
    confidence = np.ones((1, 6, 6), np.float32)
    confidence[0, 0, 0] = 0.1
    return Dataset(features.astype(np.float16), presses, np.zeros(count, int), confidence, 'tiny')


def tiny_held_out(count: int = PRESSES) -> np.ndarray:
    return np.arange(count) % 5 == 1


def tiny_config(network: dict[str, object] | None = None, **training: object) -> TrainConfig:
    """Nine bins, eight hidden units and dropout, so that random numbers are drawn in every step."""
    asked = {'hidden': (8,), 'dropout': 0.2, 'rows': 3, 'cols': 3, **(network or {})}
    trained = {'batch': 20, 'epochs': 30, 'warm_up_epochs': 3, 'threads': 1, 'device': 'cpu', 'checkpoint_s': 0.0}
    return TrainConfig(
        encoding=Choice('cartesian_mean', {'rows': 6, 'cols': 6}),
        network=NetworkConfig(**asked),  # type: ignore[arg-type]
        training=TrainingConfig(**{**trained, **training}),  # type: ignore[arg-type]
    )


def main(runs: Path) -> None:
    """Train in the folder `runs` and say so after every epoch: for a test that kills this process."""
    from contextlib import nullcontext

    from tactile_nodes.learning.network.fit import fit_network
    from tactile_nodes.learning.progress import Progress
    from tactile_nodes.learning.run.folder import RunFolder

    class Bar:
        def advance(self, steps: int = 1, text: str = '') -> None:
            print('epoch', flush=True)

    class Announcing(Progress):
        def bar(self, title: str, steps: int):  # type: ignore[no-untyped-def]
            return nullcontext(Bar())

    config = tiny_config(epochs=100_000)
    fit_network(tiny_presses(), tiny_held_out(), config, Announcing(), RunFolder(runs, config, 'tiny'))


if __name__ == '__main__':
    main(Path(sys.argv[1]))
