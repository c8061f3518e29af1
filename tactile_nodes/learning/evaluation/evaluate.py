"""Evaluates a model on presses that it never saw: continuous random places and depths, with a separate seed."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from tactile_nodes.errors import ModelError
from tactile_nodes.learning.config import Choice, DataConfig, TrainConfig
from tactile_nodes.learning.datasets.file import load_dataset
from tactile_nodes.learning.datasets.simulated import Dataset, simulate
from tactile_nodes.learning.evaluation.predictions import Predictions, name_of, predictions_of
from tactile_nodes.learning.evaluation.scores import (
    ALL,
    LightScores,
    PressScores,
    RestScores,
    score_groups,
    score_light,
    score_rest,
)
from tactile_nodes.learning.evaluation.statuses import AT_REST, LIGHT, StatusScores, score_status
from tactile_nodes.learning.evaluation.uncertainty import Uncertainty, force_uncertainty, position_uncertainty
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.recorded.gels import OTHER, other_markers
from tactile_nodes.learning.training.source import evaluation_samples, simulated_split
from tactile_nodes.model_file import LoadedModel, load_model
from tactile_nodes.simulation.gel import Gel

LIGHTEST_MM = 0.25
"""The smallest depth of the paper. Touches up to this depth are a separate set."""
EVALUATE_RECORDED = '; evaluate it with --dataset FILE'
SHARING = {'paper', 'coarse'}
"""Plans with presses at the same places and depths."""


@dataclass(frozen=True)
class Evaluation:
    """A model's scores: by group of presses, at rest, for light touches, and of its uncertainty.

    Scores that were not requested, or that the model does not provide, are None or empty. All scores are computed from
    `answers`.
    """

    name: str
    model_id: str
    groups: Mapping[str, PressScores]
    rest: RestScores | None
    force_uncertainty: Uncertainty | None
    position_uncertainty: Uncertainty | None
    fingerprint: str
    answers: Predictions = dataclasses.field(repr=False)
    data: str = ''
    statuses: Mapping[str, StatusScores] = dataclasses.field(default_factory=dict)
    light: LightScores | None = None

    def as_dict(self) -> dict[str, Any]:
        """The scores in JSON types. Unknown values are None."""
        plain = _plain(asdict(dataclasses.replace(self, answers=None)))  # type: ignore[arg-type]
        return {name: value for name, value in plain.items() if name != 'answers'}


def evaluate(
    model_file: Path | str,
    *,
    presses: int = 2000,
    seed: int = 1001,
    progress: Progress | None = None,
) -> Evaluation:
    """Scores of a model on simulated presses of the gel that it was trained on.

    One frame in five is at rest. Light touches come in addition, half as many as presses, with seed + 1.

    Raises:
        ModelError: the file cannot be used, or the model was trained on data that is not simulated or on these seeds.
    """
    loaded, progress = load_model(model_file), progress or Progress()
    config = evaluation_config(loaded, presses, seed)
    dataset = simulate(config, progress)
    light = predictions_of(loaded, simulate(light_config(config, max(1, presses // 2)), progress), progress)
    found = score(loaded, dataset, simulated_words(loaded, config), name_of(model_file), progress)
    return dataclasses.replace(
        found,
        statuses={**found.statuses, LIGHT: score_status(light)},
        light=score_light(light),
    )


def evaluate_recorded(model_file: Path | str, file: Path | str, *, split: str | None = None) -> Evaluation:
    """Scores of a model on recorded presses that it never saw: those its training set aside, or another file.

    Raises:
        ModelError: the model cannot be used, needs other features, or saw these presses.
        DatasetError: the file cannot be used.
    """
    loaded = load_model(model_file)
    recordings = load_dataset(file)
    samples, words = evaluation_samples(loaded, recordings, split)
    if other_markers(loaded.rest_image, recordings.rest_image):
        words += f'; {OTHER}'
    return score(loaded, samples, f'{file}: {words}', name_of(model_file))


def evaluate_put_aside(
    model_file: Path | str, *, of: Path | str | None = None, progress: Progress | None = None
) -> Evaluation:
    """Scores of a model on the simulated grid presses that the training of a model (by default itself) set aside.

    On a grid position that was trained at other depths, this is the paper's test.

    Raises:
        ModelError: a file cannot be used, nothing was set aside, or the model may have learned from these presses.
    """
    loaded, progress = load_model(model_file), progress or Progress()
    other = load_model(of) if of is not None else loaded
    samples, words = put_aside(other, loaded, progress)
    return score(loaded, samples, words, name_of(model_file), progress)


def put_aside(other: LoadedModel, loaded: LoadedModel, progress: Progress) -> tuple[Dataset, str]:
    """The grid presses that a model's training set aside, with the flow and the features of `loaded`, and in words.

    Raises:
        ModelError: as `evaluate_put_aside`, or this release splits presses in another way.
    """
    require_simulated(loaded, EVALUATE_RECORDED)
    theirs, ours = other.card['data'], loaded.card['data']
    if theirs.get('origin') != 'simulated' or 'split_id' not in theirs:
        raise ModelError(
            f'the training of model {other.model_id} has no simulated test set; name another model, or evaluate on '
            'random presses'
        )
    plans = {ours.get('plan'), theirs['plan']}
    if (len(plans) == 1 or plans == SHARING) and ours.get('split_id') != theirs['split_id']:
        raise ModelError(
            f'model {loaded.model_id} was trained on another part of the {theirs["plan"]} plan than model '
            f'{other.model_id}, so it may have seen the test set of that one; train it with the same split'
        )
    known = {each.name for each in dataclasses.fields(DataConfig)}
    data = DataConfig(**{name: value for name, value in theirs.items() if name in known})
    dataset = simulate(dataclasses.replace(config_of(loaded), data=data), progress)
    split = simulated_split(dataset, data, theirs['validation'])
    if split.split_id != theirs['split_id']:
        raise ModelError(
            f'the presses that model {other.model_id} was trained on cannot be reproduced here (other releases of '
            'NumPy or tactile_nodes); evaluate it on random ones, or train it again'
        )
    words = f'{len(split.test)} samples put aside by {data.split} of the {data.plan} plan'
    if other.model_id != loaded.model_id:
        words += f' of model {other.model_id}'
    elif dataset.fingerprint != theirs['fingerprint']:  # another kind of processor adds in another order
        words += ', measured again: not bit-identical to the training'
    return dataset.take(split.test), words


def score(
    loaded: LoadedModel, dataset: Dataset, data: str = '', name: str = '', progress: Progress | None = None
) -> Evaluation:
    """Scores of a model on samples. `data` describes them."""
    answers = predictions_of(loaded, dataset, progress)
    return Evaluation(
        name=name or loaded.model_id,
        model_id=loaded.model_id,
        groups=score_groups(answers),
        rest=score_rest(answers),
        force_uncertainty=force_uncertainty(answers),
        position_uncertainty=position_uncertainty(answers),
        fingerprint=dataset.fingerprint,
        answers=answers,
        data=data,
        statuses={
            name: score_status(answers[chosen])
            for name, chosen in ((ALL, answers.touched), (AT_REST, ~answers.touched))
            if chosen.any()
        },
    )


def evaluation_config(loaded: LoadedModel, presses: int, seed: int) -> TrainConfig:
    """Presses of the paper's depths over the paper's 27 of 32 mm, for a model's own gel, flow and features."""
    card = loaded.card
    require_simulated(loaded, EVALUATE_RECORDED)
    if seed <= card['data']['seed'] <= seed + 1:
        raise ModelError(
            f'model {loaded.model_id} was trained on presses of seed {card["data"]["seed"]}, but the evaluation uses '
            f'seeds {seed} and {seed + 1}; choose another --seed'
        )
    config = config_of(loaded)
    data = DataConfig(
        presses=presses * 5 // 4, seed=seed, reach_mm=13.5 / 16 * config.gel.rim.inner_mm, shallowest_mm=LIGHTEST_MM,
        deepest_mm=2.0, without_contact=0.2, crop=card['crop_px'],
    )  # fmt: skip
    return dataclasses.replace(config, data=data)


def require_simulated(loaded: LoadedModel, advice: str) -> None:
    """Raises ModelError with this advice: the model was not trained on simulated presses."""
    if loaded.card.get('data', {}).get('origin') != 'simulated':
        raise ModelError(f'model {loaded.model_id} was not trained on the simulated gel{advice}')


def config_of(loaded: LoadedModel) -> TrainConfig:
    """The configuration of simulated presses for a model: its gel, flow and features."""
    gel = {name: value for name, value in loaded.card['gel'].items() if name != 'id'}
    return TrainConfig(
        flow=Choice(*loaded.flow), encoding=Choice(*loaded.encoding), gel=Gel.from_mapping(gel, 'the model card')
    )


def light_config(config: TrainConfig, touches: int) -> TrainConfig:
    """Touches from zero depth to the paper's smallest depth."""
    data = dataclasses.replace(
        config.data, presses=touches, seed=config.data.seed + 1, shallowest_mm=0.0, deepest_mm=LIGHTEST_MM,
        without_contact=0.0,
    )  # fmt: skip
    return dataclasses.replace(config, data=data)


def simulated_words(loaded: LoadedModel, config: TrainConfig) -> str:
    """A description of the presses, and whether the gel is the one that the model was trained on."""
    data, gel = config.data, config.gel.gel_id
    words = (
        f'simulated gel {gel}, random places within {2 * data.reach_mm:g}x{2 * data.reach_mm:g} mm and depths of '
        f'{data.shallowest_mm:g} to {data.deepest_mm:g} mm, seed {data.seed}'
    )
    if gel == loaded.gel:
        return words
    return f'{words}; NOT the gel of the training, {loaded.gel}, which an earlier release simulated: train it again'


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _plain(part) for name, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
