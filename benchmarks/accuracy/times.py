"""The time of a model per frame: flow, features and estimate. Models run in turn on the same images."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.harness.report import in_turn, spread
from tactile_nodes.clock import perf_ns
from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.learning.evaluation.evaluate import config_of
from tactile_nodes.model_file import LoadedModel
from tactile_nodes.sensing.explain.model import ForceEstimator
from tactile_nodes.sensing.features import FeatureEncoding
from tactile_nodes.sensing.flow.methods import FlowMethod
from tactile_nodes.sensing.geometry import centre_crop
from tactile_nodes.simulation.optics import Optics, Press

STAGES = ('flow', 'features', 'predict')
_WARM_UP = 2


@dataclass(frozen=True)
class _Contender:
    flow: FlowMethod
    encoding: FeatureEncoding
    estimator: ForceEstimator
    images: tuple[np.ndarray, ...]

    @classmethod
    def of(cls, loaded: LoadedModel, images: list[np.ndarray]) -> _Contender:
        """Prepare a model for the images, of which the first is the rest image."""
        config, (width, height) = config_of(loaded), loaded.image_size
        rest, *pressed = (np.ascontiguousarray(centre_crop(image, width, height)) for image in images)
        flow, encoding = config.make_flow(), config.make_encoding()
        flow.set_reference(rest)
        encoding.set_reference(rest)
        return cls(flow, encoding, ForceEstimator(loaded.model), tuple(pressed))

    def turn(self) -> tuple[float, ...]:
        """Median time of each stage over the images, in ms."""
        times = []
        for image in self.images:
            begun = perf_ns()
            field = self.flow.displacement(image)
            measured = perf_ns()
            features = self.encoding.encode(field)
            encoded = perf_ns()
            self.estimator.predict(features)
            times.append((measured - begun, encoded - measured, perf_ns() - encoded))
        return tuple((np.median(times, axis=0) / 1e6).tolist())


def stage_times(models: Mapping[str, LoadedModel], rounds: int, images: int) -> dict[str, Any]:
    """Time of each stage by model (ms), and ratios to the first model, with their range over the rounds."""
    shown = _images(next(iter(models.values())), images)
    contenders = {name: _Contender.of(each, shown) for name, each in models.items()}
    taken: dict[str, list[tuple[float, ...]]] = {name: [] for name in contenders}
    for number in range(rounds + _WARM_UP):
        for name in in_turn(list(contenders), number):
            taken[name].append(contenders[name].turn())
    arrays = {name: np.array(each[_WARM_UP:]) for name, each in taken.items()}
    first = next(iter(arrays.values()))
    return {name: _summary(each, first) for name, each in arrays.items()}


def _summary(times: np.ndarray, first: np.ndarray) -> dict[str, Any]:
    stages = {stage: spread(times[:, place].tolist()) for place, stage in enumerate(STAGES)}
    return {
        **stages,
        'sum': spread(times.sum(axis=1).tolist()),
        'predict_ratio': spread((times[:, -1] / first[:, -1]).tolist()),
        'sum_ratio': spread((times.sum(axis=1) / first.sum(axis=1)).tolist()),
    }


def _images(loaded: LoadedModel, count: int) -> list[np.ndarray]:
    """A rest image and presses of several depths."""
    gel = config_of(loaded).gel
    optics = Optics(gel, contact_table(gel))
    random = np.random.default_rng(1)
    places = random.uniform((-13.0, -13.0, 0.25), (13.0, 13.0, 2.0), (count, 3))
    return [optics.render((), 1), *(optics.render((Press(*place),), 2 + i) for i, place in enumerate(places.tolist()))]
