"""How good a model is, on presses that it never saw: continuous random places and depths, with a seed of their own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from tactile_nodes.errors import ModelError
from tactile_nodes.learning.config import Choice, DataConfig, TrainConfig
from tactile_nodes.learning.dataset import Dataset, simulate
from tactile_nodes.learning.dataset_file import load_dataset
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.source import evaluation_samples
from tactile_nodes.model_file import LoadedModel, load_model
from tactile_nodes.sensing import metrics
from tactile_nodes.sensing.features import Features
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.sensing.model import ForceEstimator, ForceMap
from tactile_nodes.simulation.gel import Gel

NEAR_BORDER_MM = 0.3


@dataclass(frozen=True)
class PressScores:
    """Figures of merit over presses; the first three are the paper's, lengths in mm, forces in N."""

    presses: int
    armse_n: float
    d_loc_mm: float
    rmse_mc_n: float
    total_rmse_n: float
    total_p95_n: float
    right_bin: float
    position_median_mm: float
    position_p95_mm: float


@dataclass(frozen=True)
class RestScores:
    """What a model says while nothing touches: the total force it invents."""

    frames: int
    total_mean_n: float
    total_rms_n: float
    total_largest_n: float
    largest_bin_n: float


@dataclass(frozen=True)
class Evaluation:
    """A model's scores, by group of presses, and at rest."""

    model_id: str
    groups: Mapping[str, PressScores]
    rest: RestScores | None
    fingerprint: str
    data: str = ''

    def as_dict(self) -> dict[str, object]:
        return asdict(self)


def evaluate(
    model_file: Path | str, *, presses: int = 2000, seed: int = 1001, progress: Progress | None = None
) -> Evaluation:
    """Scores of a model on simulated presses of the gel that it was trained on, and as many frames at rest again.

    Raises:
        ModelError: the file cannot be used, was trained on other data than simulated, or with this very seed.
    """
    loaded = load_model(model_file)
    config = evaluation_config(loaded, presses, seed)
    return score(loaded, simulate(config, progress or Progress()))


def evaluate_recorded(model_file: Path | str, file: Path | str, *, split: str | None = None) -> Evaluation:
    """Scores of a model on recorded presses that it never saw: what its training put aside, or another file.

    Raises:
        ModelError: the model cannot be used, needs other features, or saw these presses.
        DatasetError: the file cannot be used.
    """
    loaded = load_model(model_file)
    samples, words = evaluation_samples(loaded, load_dataset(file), split)
    return score(loaded, samples, f'{file}: {words}')


def score(loaded: LoadedModel, dataset: Dataset, data: str = '') -> Evaluation:
    """Scores of a model on samples; `data` says which they are."""
    predictions = predict(loaded, dataset)
    forces = np.stack([each.normal_force_n.reshape(-1) for each in predictions])
    positions = np.array([each.contact_mm for each in predictions])
    bins = loaded.model.bins
    groups = {
        name: score_presses(dataset, forces, positions, chosen, bins)
        for name, chosen in groups_of(dataset, bins).items()
        if chosen.any()
    }
    untouched = forces[dataset.presses[:, 2] < 0]
    rest = score_rest(untouched) if len(untouched) else None
    return Evaluation(loaded.model_id, groups, rest, dataset.fingerprint, data)


def evaluation_config(loaded: LoadedModel, presses: int, seed: int) -> TrainConfig:
    """Presses of the paper's depths over the paper's 27 mm, for a model's own gel, flow and features."""
    card = loaded.card
    if card.get('data', {}).get('origin') != 'simulated':
        raise ModelError(
            f'model {loaded.model_id} was not trained on the simulated gel; evaluate it with --dataset FILE'
        )
    if card['data']['seed'] == seed:
        raise ModelError(f'model {loaded.model_id} was trained on presses of seed {seed}; choose another --seed')
    data = DataConfig(
        presses=presses * 5 // 4, seed=seed, reach_mm=13.5, shallowest_mm=0.25, deepest_mm=2.0,
        without_contact=0.2, crop=card['crop_px'],
    )  # fmt: skip
    gel = Gel.from_mapping({name: value for name, value in card['gel'].items() if name != 'id'}, 'the model card')
    flow, encoding = Choice(*loaded.flow), Choice(*loaded.encoding)
    return TrainConfig(data=data, flow=flow, encoding=encoding, gel=gel)


def predict(loaded: LoadedModel, dataset: Dataset) -> list[ForceMap]:
    """The model's answers, one sample at a time as the live node asks."""
    estimator = ForceEstimator(loaded.model)
    name = loaded.model.layout.encoding
    return [
        estimator.predict(Features(name, values.astype(np.float32), dataset.confidence[rest]))
        for values, rest in zip(dataset.features, dataset.rest, strict=True)
    ]


def groups_of(dataset: Dataset, bins: BinGrid) -> dict[str, np.ndarray]:
    """Which presses are scored together: all, near to and away from a border between bins, and by depth."""
    x, y, depth, _ = dataset.presses.T
    touched = depth > 0
    distance = np.array([bins.border_distance_mm(*place) for place in zip(x.tolist(), y.tolist(), strict=True)])
    near = distance < NEAR_BORDER_MM
    groups = {
        'all presses': touched,
        f'within {NEAR_BORDER_MM} mm of a bin border': touched & near,
        'away from bin borders': touched & ~near,
    }
    for low, high in ((0.25, 0.5), (0.5, 1.0), (1.0, 2.0)):
        below = depth <= high if high == 2.0 else depth < high  # the deepest presses of the paper are 2 mm deep
        groups[f'{low} to {high} mm deep'] = touched & (depth >= low) & below
    return groups


def score_presses(
    dataset: Dataset,
    forces_n: Float32[np.ndarray, 'samples bins'],
    positions_mm: np.ndarray,
    chosen: np.ndarray,
    bins: BinGrid,
) -> PressScores:
    """Scores over the chosen samples."""
    true, predicted = dataset.labels(bins)[chosen], forces_n[chosen]
    totals = metrics.total_errors_n(true, predicted)
    away = np.hypot(*(positions_mm[chosen] - dataset.presses[chosen, :2]).T)
    return PressScores(
        presses=int(chosen.sum()),
        armse_n=metrics.armse(true, predicted),
        d_loc_mm=metrics.location_error_mm(true, predicted, bins),
        rmse_mc_n=metrics.peak_rmse_n(true, predicted),
        total_rmse_n=float(np.sqrt(np.mean(totals**2))),
        total_p95_n=float(np.percentile(np.abs(totals), 95)),
        right_bin=metrics.right_bin_share(true, predicted),
        position_median_mm=float(np.median(away)),
        position_p95_mm=float(np.percentile(away, 95)),
    )


def score_rest(forces_n: Float32[np.ndarray, 'samples bins']) -> RestScores:
    """Scores over frames in which nothing touches."""
    totals = forces_n.sum(axis=1)
    return RestScores(
        frames=len(forces_n),
        total_mean_n=float(totals.mean()),
        total_rms_n=float(np.sqrt(np.mean(totals**2))),
        total_largest_n=float(np.abs(totals).max()),
        largest_bin_n=float(np.abs(forces_n).max()),
    )


def table(evaluation: Evaluation) -> str:
    """The scores as text, one line a group."""
    heads = ('presses', 'aRMSE N', 'd_loc mm', 'RMSE_mc N', 'total RMSE N', 'p95 N', 'right bin', 'place mm', 'p95 mm')
    width = max(len(name) for name in evaluation.groups)
    heading = [f'model {evaluation.model_id}', *filter(None, [evaluation.data])]
    lines = [*heading, f'{"":{width}}  ' + '  '.join(heads)]
    for name, scores in evaluation.groups.items():
        cells = [str(scores.presses), *(f'{value:.4f}' for value in list(asdict(scores).values())[1:])]
        lines.append(
            f'{name:{width}}  ' + '  '.join(f'{cell:>{len(head)}}' for cell, head in zip(cells, heads, strict=True))
        )
    if (rest := evaluation.rest) is None:
        return '\n'.join([*lines, 'at rest: the data set holds no image of the untouched gel'])
    lines.append(
        f'at rest, {rest.frames} frames: total {rest.total_mean_n:+.4f} N on average, {rest.total_rms_n:.4f} N RMS, '
        f'{rest.total_largest_n:.4f} N at most; largest bin {rest.largest_bin_n:.4f} N'
    )
    return '\n'.join(lines)
