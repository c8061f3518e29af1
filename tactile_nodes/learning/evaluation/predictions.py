"""A model's estimates of samples together with the true values, as arrays."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.progress import Progress
from tactile_nodes.model_file import LoadedModel
from tactile_nodes.pipeline.judge_force import judged_alone
from tactile_nodes.sensing.explain.model import ForceEstimator, ForceMap
from tactile_nodes.sensing.features import Features
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.shapes import Float, Float32, Int


@dataclass(frozen=True)
class Predictions:
    """True and estimated values of each sample. Lengths in mm in the surface frame, forces in N, NaN where unknown.

    A sample without contact has a negative depth. `position_sigma_mm` is along each axis. `status`, `stated_sigma_n`
    (the standard deviation of the total) and `nominal_n` (its usual value) are those that the force topic would publish
    for an undisturbed image.
    """

    place_mm: Float[np.ndarray, 'samples 2']
    depth_mm: Float[np.ndarray, ' samples']
    true_n: Float32[np.ndarray, 'samples bins']
    found_n: Float32[np.ndarray, 'samples bins']
    found_mm: Float[np.ndarray, 'samples 2']
    total_n: Float[np.ndarray, ' samples']
    total_sigma_n: Float[np.ndarray, ' samples']
    position_sigma_mm: Float[np.ndarray, ' samples']
    status: Int[np.ndarray, ' samples']
    stated_sigma_n: Float[np.ndarray, ' samples']
    nominal_n: Float[np.ndarray, ' samples']
    bins: BinGrid
    contact_threshold_n: float

    def __len__(self) -> int:
        return len(self.depth_mm)

    def __getitem__(self, chosen: np.ndarray) -> Predictions:
        """Some of the samples."""
        arrays = {
            each.name: value[chosen]
            for each in fields(self)
            if isinstance(value := getattr(self, each.name), np.ndarray)
        }
        return Predictions(**arrays, bins=self.bins, contact_threshold_n=self.contact_threshold_n)

    @property
    def touched(self) -> np.ndarray:
        """Which samples are presses."""
        return self.depth_mm > 0

    @property
    def force_n(self) -> Float[np.ndarray, ' samples']:
        """True total force."""
        total: np.ndarray = self.true_n.sum(axis=1, dtype=np.float64)
        return total

    @property
    def force_error_n(self) -> Float[np.ndarray, ' samples']:
        """Estimated minus true total force."""
        error: np.ndarray = self.total_n - self.force_n
        return error

    @property
    def place_error_mm(self) -> Float[np.ndarray, 'samples 2']:
        """Estimated minus true place, along x and y."""
        error: np.ndarray = self.found_mm - self.place_mm
        return error

    @property
    def away_mm(self) -> Float[np.ndarray, ' samples']:
        """Distance between the estimated and the true place."""
        distance: np.ndarray = np.hypot(self.place_error_mm[:, 0], self.place_error_mm[:, 1])
        return distance

    @property
    def detected(self) -> np.ndarray:
        """Which samples the model reports as contact: its total force reaches its own threshold."""
        return self.total_n >= self.contact_threshold_n


def predict(loaded: LoadedModel, dataset: Dataset, progress: Progress | None = None) -> list[ForceMap]:
    """The model's estimates, one sample at a time as in the live node."""
    estimator = ForceEstimator(loaded.model)
    name = loaded.model.layout.encoding
    answers = []
    with (progress or Progress()).bar('reading forces', len(dataset.presses)) as bar:
        for values, rest in zip(dataset.features, dataset.rest, strict=True):
            answers.append(estimator.predict(Features(name, values.astype(np.float32), dataset.confidence[rest])))
            bar.advance()
    return answers


def predictions_of(loaded: LoadedModel, dataset: Dataset, progress: Progress | None = None) -> Predictions:
    """True and estimated values for all samples of a data set."""
    found = predict(loaded, dataset, progress)
    bins, verdicts = loaded.model.bins, [judged_alone(each) for each in found]
    return Predictions(
        place_mm=np.asarray(dataset.presses[:, :2], np.float64),
        depth_mm=np.asarray(dataset.presses[:, 2], np.float64),
        true_n=dataset.labels(bins),
        found_n=np.stack([each.normal_force_n.reshape(-1) for each in found]),
        found_mm=np.array([each.contact_mm for each in found], np.float64),
        total_n=np.array([each.total_n for each in found], np.float64),
        total_sigma_n=np.array([each.total_sigma_n for each in found], np.float64),
        position_sigma_mm=np.array([each.position_sigma_mm for each in found], np.float64),
        status=np.array([each.status for each in verdicts], np.int64),
        stated_sigma_n=np.array([each.sigma_n for each in verdicts], np.float64),
        nominal_n=np.array([each.nominal_n for each in found], np.float64),
        bins=bins,
        contact_threshold_n=loaded.model.contact_threshold_n,
    )


def name_of(file: Path | str) -> str:
    """The name of a model in tables: 'paper' for models/paper.safetensors."""
    return Path(file).stem
