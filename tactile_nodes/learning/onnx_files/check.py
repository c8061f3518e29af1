"""Runs an exported model as other programs do, and compares it with its original, frame by frame."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_nodes.errors import from_extra
from tactile_nodes.learning.datasets.simulated import Dataset, simulate
from tactile_nodes.learning.evaluation.evaluate import evaluation_config, require_simulated
from tactile_nodes.learning.progress import Progress
from tactile_nodes.model_file import LoadedModel
from tactile_nodes.sensing.explain.measured.readout import ResponseReadout
from tactile_nodes.sensing.explain.model import ForceEstimator, ForceMap, ForceModel
from tactile_nodes.sensing.features import Features
from tactile_nodes.shapes import Float32

OUTPUTS = 'normal_force', 'contact', 'position_sigma', 'total_sigma', 'unlikeness', 'seen'


class OnnxSession:
    """An ONNX file's content, run by onnxruntime in one thread of the CPU.

    Raises:
        ConfigurationError: onnxruntime is not installed.
    """

    def __init__(self, content: bytes) -> None:
        with from_extra('onnx', 'running ONNX files'):
            import onnxruntime
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        self._session: Any = onnxruntime.InferenceSession(content, options, providers=['CPUExecutionProvider'])

    def answer(
        self, values: Float32[np.ndarray, 'rows cols channels'], confidence: Float32[np.ndarray, 'rows cols']
    ) -> dict[str, np.ndarray]:
        """The graph's outputs by name."""
        found = self._session.run(OUTPUTS, {'features': values[None], 'confidence': confidence})
        return dict(zip(OUTPUTS, found, strict=True))


@dataclass(frozen=True)
class Differences:
    """The largest differences between an exported model and its original over `samples` frames.

    Sigmas and novelty are compared as shares of the original's. The original is limited to one contact here. In
    `several` of the frames it would have found more; the export flags `several_flagged` of these as novel.
    """

    samples: int
    bin_n: float
    place_mm: float
    force_n: float
    sigma_share: float
    unlikeness_share: float
    several: int = 0
    several_flagged: int = 0


def real_samples(loaded: LoadedModel, count: int, progress: Progress | None = None) -> Dataset:
    """Frames as `tactile evaluate` uses them, of a seed that is not that of the training. Every fifth is at rest.

    Raises:
        ModelError: the model was not trained on simulated presses.
    """
    require_simulated(loaded, ', so there are no frames to compare it on; export it without --check')
    presses, seed = -(-count * 4 // 5), loaded.card['data']['seed'] + 2
    dataset = simulate(evaluation_config(loaded, presses, seed), progress or Progress())
    return dataset.take(np.arange(min(count, len(dataset.presses))))


def frames(loaded: LoadedModel, samples: Dataset, lost_share: float = 0.0) -> list[Features]:
    """The samples as a node sees them, optionally with this share of all regions lost, drawn again for each sample."""
    random, name = np.random.default_rng(0), loaded.model.layout.encoding
    features = []
    for values, rest in zip(samples.features, samples.rest, strict=True):
        confidence = samples.confidence[rest]
        kept = random.random(confidence.shape) >= lost_share
        features.append(Features(name, values.astype(np.float32), (confidence * kept).astype(np.float32)))
    return features


def compare(loaded: LoadedModel, content: bytes, shown: list[Features]) -> Differences:
    """Run both models on each frame.

    Raises:
        ConfigurationError: onnxruntime is not installed.
    """
    session, original = OnnxSession(content), ForceEstimator(_with_one_contact(loaded.model))
    found = [session.answer(each.values, each.confidence) for each in shown]
    gaps = [_gaps(original.predict(frame), each) for frame, each in zip(shown, found, strict=True)]
    several = [len(ForceEstimator(loaded.model).predict(frame).contacts) > 1 for frame in shown]
    flagged = sum(bool(each['unlikeness'] > 1) for each, more in zip(found, several, strict=True) if more)
    bin_n, place_mm, force_n, sigma, unlike = (max(column) for column in zip(*gaps, strict=True))
    return Differences(len(shown), bin_n, place_mm, force_n, sigma, unlike, sum(several), flagged)


def _with_one_contact(model: ForceModel) -> ForceModel:
    if not isinstance(model.readout, ResponseReadout):
        return model
    return dataclasses.replace(model, readout=dataclasses.replace(model.readout, most_contacts=1))


def _gaps(expected: ForceMap, found: dict[str, np.ndarray]) -> tuple[float, float, float, float, float]:
    place, force = found['contact'][:2], found['contact'][2]
    return (
        _gap(found['normal_force'], expected.normal_force_n),
        _gap(place, expected.contact_mm),
        _gap(force, expected.contacts[0].force_n),
        max(
            _share(found['position_sigma'], expected.position_sigma_mm),
            _share(found['total_sigma'], expected.total_sigma_n),
        ),
        _share(found['unlikeness'], expected.unlikeness),
    )


def _gap(found: np.ndarray, expected: np.ndarray | float | tuple[float, float]) -> float:
    """The largest difference: zero if both are unknown, infinite if only one is."""
    gaps = np.abs(np.float64(found) - np.asarray(expected))
    unknown = np.isnan(found), np.isnan(expected)
    return float(np.where(unknown[0] & unknown[1], 0.0, np.where(unknown[0] | unknown[1], np.inf, gaps)).max())


def _share(found: np.ndarray, expected: float) -> float:
    """The difference as a share of the expected value."""
    gap = _gap(found, expected)
    return gap / max(abs(expected), 1e-9) if gap > 0 else 0.0
