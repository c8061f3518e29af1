"""Readouts of the chart's contenders: fitted in the same way, scored on the same frames, and timed in turn."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from benchmarks.front.contenders import Contender
from benchmarks.front.shelf import Shelf, Time
from benchmarks.harness.report import in_turn, quartiles
from tactile_nodes.clock import perf_ns
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.network.scores import Validation
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.run.folder import Run
from tactile_nodes.learning.training.source import TrainingData
from tactile_nodes.learning.training.train import fit, threshold_of
from tactile_nodes.sensing.explain.model import FeatureLayout, ForceEstimator, ForceModel
from tactile_nodes.sensing.features import Features

VALIDATION = 10
"""One in this number of training frames is held out for validation."""


def fitted(shelf: Shelf, taking_part: Sequence[Contender], train: int, progress: Progress) -> dict[str, dict[str, Any]]:
    """Scores on the frames after the first `train`, times, and a description of the readout; by name.

    Raises:
        DatasetError: there are too few frames for training.
    """
    models = {}
    with progress.bar('fitting readouts', len(taking_part)) as bar:
        for each in taking_part:
            models[each.name] = _fit(shelf, each, train)
            bar.advance(1, each.name)
    answered = _answers(shelf, taking_part, models, train, progress)
    return {each.name: _entry(shelf, each, models[each.name], answered[each.name], train) for each in taking_part}


def _key(contender: Contender) -> tuple[str, int, str]:
    return contender.way, contender.regions, contender.encoding


def _fit(shelf: Shelf, contender: Contender, train: int) -> ForceModel:
    key, config = _key(contender), contender.config()
    dataset = Dataset(
        features=np.stack(shelf.values[key][:train]),
        presses=np.array(shelf.presses[:train], np.float32),
        rest=np.arange(train),
        confidence=np.stack(shelf.confidence[key][:train]),
        fingerprint='',
    )
    held_out = np.arange(train) % VALIDATION == 1
    readout, _ = fit(TrainingData(config, dataset, held_out, {}, {}), Progress(), Run())
    layout = FeatureLayout(contender.encoding, *dataset.features.shape[1:])
    return ForceModel(layout, config.bins, readout, threshold_of(config), contender.name)


Answer = tuple[np.ndarray, Time]


def _answers(
    shelf: Shelf, taking_part: Sequence[Contender], models: dict[str, ForceModel], train: int, progress: Progress
) -> dict[str, list[Answer]]:
    """Forces on bins and their times, frame by frame, with the contenders in turn."""
    estimators = {name: ForceEstimator(model) for name, model in models.items()}
    found: dict[str, list[Answer]] = {each.name: [] for each in taking_part}
    test = range(train, len(shelf.presses))
    with progress.bar('answering', len(test)) as bar:
        for number in test:
            for each in in_turn(taking_part, number):
                key = _key(each)
                features = Features(
                    each.encoding, shelf.values[key][number].astype(np.float32), shelf.confidence[key][number]
                )
                begun = time.process_time_ns(), perf_ns()
                answer = estimators[each.name].predict(features).normal_force_n
                took = (time.process_time_ns() - begun[0]) / 1e6, (perf_ns() - begun[1]) / 1e6
                found[each.name].append((answer.reshape(-1), took))
            bar.advance()
    return found


def _entry(
    shelf: Shelf, contender: Contender, model: ForceModel, answered: Sequence[Answer], train: int
) -> dict[str, Any]:
    presses = np.array(shelf.presses[train:], np.float32)
    truth = Dataset(np.zeros(0), presses, np.zeros(0), np.zeros(0), '').labels(model.bins)
    scores = Validation.of(truth, np.stack([forces for forces, _ in answered]).astype(np.float32), model.bins)
    touched = presses[:, 2] > 0
    measured = np.array(shelf.times_ms[_key(contender)][train:])
    predicted = np.array([took for _, took in answered])
    whole = measured + predicted
    return {
        **asdict(scores),
        'way': contender.way,
        'regions': contender.regions,
        'encoding': contender.encoding,
        'readout': contender.readout,
        'parameters': model.readout.parameter_count,
        'cpu_ms': quartiles(whole[touched, 0]),
        'wall_ms': quartiles(whole[touched, 1]),
        'rest_cpu_ms': quartiles(whole[~touched, 0]),
        'stages_cpu_ms': {
            'flow and features': float(np.median(measured[touched, 0])),
            'predict': float(np.median(predicted[touched, 0])),
        },
    }
