"""Recorded presses decide whether one response holds for all places."""

from __future__ import annotations

import numpy as np
import pytest
from responding_gel import AXISYMMETRIC, CONFIG, REACH_MM, motion, presses, seen_with_noise

from tactile_nodes.learning.config import Choice, TrainConfig
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.run.folder import Run
from tactile_nodes.learning.training.source import TrainingData
from tactile_nodes.learning.training.train import fit


def held_at_a_side(count: int, seed: int) -> Dataset:
    """Presses on a gel that is held at its right side, and so moves less towards it the nearer it is pressed there."""
    random = np.random.default_rng(seed)
    places, force = random.uniform(-REACH_MM, REACH_MM, (count, 2)), random.uniform(0.05, 1.0, count)
    force[random.random(count) < 0.15] = 0.0
    field = motion(places, force)
    field[..., 0] *= (0.6 - 0.04 * places[:, 0])[:, None, None]
    return seen_with_noise(field, places, force, random)


@pytest.mark.parametrize(
    ('dataset', 'kind'),
    [(presses(300, 1), 'axisymmetric'), (held_at_a_side(1500, 1), 'response')],
    ids=['alike everywhere', 'held at a side'],
)
def test_of_two_readouts_for_tips_the_one_that_reads_other_presses_better_is_taken(dataset: Dataset, kind: str) -> None:
    config = TrainConfig(
        readout='tips', encoding=Choice('cartesian_mean', {'rows': 6, 'cols': 6}),
        axisymmetric=AXISYMMETRIC, response=CONFIG,
    )  # fmt: skip
    data = TrainingData(config, dataset, np.arange(len(dataset.presses)) % 10 == 1, {}, {})
    readout, report = fit(data, Progress(), Run())
    errors = {name: each['force_rmse_n'] * each['place_median_mm'] for name, each in report['tips'].items()}
    assert (readout.kind, min(errors, key=errors.__getitem__)) == (kind, kind)
