"""The presses of a run, simulated or recorded, and which of them it may learn from."""

from __future__ import annotations

import dataclasses
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactile_nodes.errors import ConfigurationError, DatasetError, ModelError
from tactile_nodes.learning.config import Choice, DataConfig, TrainConfig
from tactile_nodes.learning.datasets.file import load_dataset
from tactile_nodes.learning.datasets.plans import press_numbers
from tactile_nodes.learning.datasets.recordings import RecordedPresses
from tactile_nodes.learning.datasets.simulated import Dataset, simulate
from tactile_nodes.learning.datasets.split import Split, by_position, by_sample
from tactile_nodes.learning.field.body import KnownBody
from tactile_nodes.learning.progress import Progress
from tactile_nodes.model_file import LoadedModel, find_model, load_model, size_of_crop


@dataclass(frozen=True)
class TrainingData:
    """Samples, which of them are for validation, and the model card's entries about gel and data.

    `config` is the run's configuration, completed from a file of recorded presses. `rest_image` is the last reference
    image of recorded presses; it has no rows if presses are simulated.
    """

    config: TrainConfig
    dataset: Dataset
    held_out: np.ndarray
    gel: dict[str, Any]
    origin: dict[str, Any]
    rest_image: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((0, 0), np.uint8))


def training_data(config: TrainConfig, progress: Progress) -> TrainingData:
    """The samples to learn from.

    Raises:
        ConfigurationError: the configuration contradicts the file of recorded presses.
        DatasetError: that file cannot be used.
            Also if another body pressed than the run of a readout `field` names.
        ModelError: there is no model of tips, or it has seen the presses that are to be put aside.
    """
    file = config.data.file
    data = recorded_data(config, load_dataset(file), progress) if file else simulated_data(config, progress)
    return _with_tips(data) if config.readout == 'field' else data


def _with_tips(data: TrainingData) -> TrainingData:
    """The data of a readout `field`; they name the presses of the model that reads its tips, too."""
    name, ours, body = data.config.field.tips, data.origin, data.config.field.body
    for pressed in set(() if data.dataset.indenter is None else data.dataset.indenter.tolist()) - {''}:
        with suppress(ConfigurationError):  # a name that is no body does not tell what pressed
            if KnownBody.named(pressed).name != KnownBody.named(body).name:
                raise DatasetError(f'{pressed} pressed the gel, but field.body of the run is {body}; correct it there')
    theirs = load_model(find_model(name)).card.get('data', {})
    seen = {each: [*ours.get(each, ()), *theirs.get(each, ())] for each in ('bags', 'pictures') if theirs.get(each)}
    if any(len(each) > len(set(each)) for each in seen.values()) and ours.get('split_id') != theirs.get('split_id'):
        raise ModelError(
            f'the model of tips, {name}, has seen presses that would be put aside for the test; train it with the same '
            '--dataset and --split, or name another (field.tips), such as portable'
        )
    return dataclasses.replace(data, origin={**ours, **seen})


def simulated_data(config: TrainConfig, progress: Progress) -> TrainingData:
    """Simulated presses. For a grid, a part is set aside for the test, as for recorded presses.

    Raises:
        DatasetError: there are too few for that.
    """
    dataset = simulate(config, progress)
    origin = {**config.data.simulated(), 'origin': 'simulated', 'validation': config.training.validation}
    if config.data.plan == 'random':
        held_out = held_out_share(len(dataset.presses), config)
    else:
        split = simulated_split(dataset, config.data, config.training.validation)
        _tell(split, f'{config.data.plan} plan', config.data.split, progress)
        chosen = np.sort(np.concatenate([split.train, split.validation]))
        dataset, held_out = dataset.take(chosen), np.isin(chosen, split.validation)
        origin |= _split_entries(config, split)
    return TrainingData(config, dataset, held_out, config.gel.card, origin)


def simulated_split(dataset: Dataset, data: DataConfig, validation: float) -> Split:
    """Training, validation and test set of simulated presses on a grid.

    Raises:
        DatasetError: there are too few.
    """
    if data.split == 'position':
        places = dataset.presses[:, :2]
        return by_position(places, seed=data.split_seed, test=data.test, validation=validation)
    depth_mm = dataset.presses[:, 2]
    numbers = press_numbers(depth_mm)
    return by_sample(numbers, depth_mm, seed=data.split_seed, test=data.test, validation=validation)


def _tell(split: Split, name: str, by: str, progress: Progress) -> None:
    progress.say(
        f'{name}: {len(split.train)} samples to train, {len(split.validation)} to validate, '
        f'{len(split.test)} put aside for the test, split by {by}'
    )


def _split_entries(config: TrainConfig, split: Split) -> dict[str, Any]:
    """The settings that reproduce the split."""
    return {
        'split': config.data.split,
        'split_seed': config.data.split_seed,
        'split_id': split.split_id,
        'test': config.data.test,
        'validation': config.training.validation,
    }


def held_out_share(samples: int, config: TrainConfig) -> np.ndarray:
    """Which samples are for validation, chosen by the training's seed."""
    random = np.random.default_rng(config.training.seed)
    chosen: np.ndarray = random.permutation(samples) < max(1, round(samples * config.training.validation))
    return chosen


def recorded_data(config: TrainConfig, recordings: RecordedPresses, progress: Progress) -> TrainingData:
    """Training and validation set of recorded presses. The test set is not included.

    Raises:
        ConfigurationError: the configuration contradicts them.
        DatasetError: there are too few.
    """
    config = with_file(config, recordings)
    data, validation = config.data, config.training.validation
    split = recordings.split(data.split, data.split_seed, test=data.test, validation=validation)
    chosen = np.sort(np.concatenate([split.train, split.validation]))
    _tell(split, data.file, data.split, progress)
    origin = {
        'origin': 'recorded',
        'file': Path(data.file).name,
        'bags': [bag['id'] for bag in recordings.card['bags']],
        'pictures': recordings.pictures,
        'frames': recordings.card['frames'],
        'labels': recordings.card['labels']['reading'],
        'samples': len(recordings),
        'presses': len(np.unique(recordings.press_number)),
        **_split_entries(config, split),
    }
    held_out = np.isin(chosen, split.validation)
    gel = dict(recordings.card['gel'])
    samples = recordings.as_samples(chosen)
    return TrainingData(config, samples, held_out, gel, origin, recordings.rest_image)


def with_file(config: TrainConfig, recordings: RecordedPresses) -> TrainConfig:
    """The configuration with the file's flow, features, crop and bins.

    Raises:
        ConfigurationError: it specifies different ones itself.
    """
    card, bins = recordings.card, recordings.bins
    asked_for: dict[str, object] = {}
    for block, method in (('flow', config.make_flow), ('encoding', config.make_encoding)):
        if any(name.startswith(f'{block}.') for name in config.stated):
            chosen = method()
            asked_for[block] = {'name': chosen.name, 'options': chosen.options}
    asked_for |= {
        name: getattr(config.network, name) for name in ('rows', 'cols') if f'network.{name}' in config.stated
    }
    theirs = {**{name: _method(card[name]) for name in ('flow', 'encoding')}, 'rows': bins.rows, 'cols': bins.cols}
    for name, value in asked_for.items():
        if value != theirs[name]:
            raise ConfigurationError(
                f'the run asks for {name} {value}, but {config.data.file} was made with {theirs[name]}; remove {name} '
                'from the run, or build the data set again'
            )
    return dataclasses.replace(
        config,
        flow=Choice(**_method(card['flow'])),
        encoding=Choice(**_method(card['encoding'])),
        recorded_bins=bins,
        network=dataclasses.replace(config.network, rows=bins.rows, cols=bins.cols),
        data=dataclasses.replace(config.data, crop=card['crop_px']),
    )


def _method(described: dict[str, Any]) -> dict[str, Any]:
    return {name: described[name] for name in ('name', 'options')}


def evaluation_samples(loaded: LoadedModel, recordings: RecordedPresses, kind: str | None) -> tuple[Dataset, str]:
    """Samples that a model never saw, and a description of them.

    For the file that it was trained on, these are the presses set aside. For another file they are all presses, or the
    test set of the split `kind` with seed 1.

    Raises:
        ModelError: it needs other features, or saw the presses chosen for its evaluation.
        DatasetError: there are too few presses.
    """
    require_same_features(loaded, recordings)
    origin = loaded.card.get('data', {})
    if origin.get('origin') == 'recorded' and origin.get('fingerprint') == recordings.fingerprint:
        return _put_aside(loaded, recordings, kind)
    pressed = [bag for bag in recordings.card['bags'] if bag.get('attempts') != 0]  # all bags without have one id
    ours = {bag['id'] for bag in pressed}
    if ours & set(origin.get('bags', ())):
        if origin.get('origin') != 'recorded':  # a calibration holds no presses back
            raise ModelError(
                f'model {loaded.model_id} or its source was calibrated with presses of the same bags or tables, so it '
                'saw these; evaluate it on others'
            )
        raise ModelError(
            f'model {loaded.model_id} was trained on presses of the same bags in another data set, so it may have seen '
            'these; evaluate it on the file that it was trained on, or on other bags'
        )
    pictures = recordings.pictures
    if known := len(set(origin.get('pictures', ())) & set(pictures)):
        made = 'trained' if origin.get('origin') == 'recorded' else 'calibrated'
        raise ModelError(
            f'model {loaded.model_id} was {made} with {known} of the {len(pictures)} images of presses in this '
            'data set; evaluate it on held-out presses, in a separate table'
        )
    if kind is None:
        return recordings.as_samples(), f'all {len(recordings)} samples, none of them used in training'
    chosen = recordings.split(kind, 1).test
    return recordings.as_samples(chosen), f'{len(chosen)} samples, the test set by {kind}'


def _put_aside(loaded: LoadedModel, recordings: RecordedPresses, kind: str | None) -> tuple[Dataset, str]:
    origin = loaded.card['data']
    if kind not in (None, origin['split']):
        raise ModelError(
            f'model {loaded.model_id} was trained with the split by {origin["split"]}, so it saw presses of the test '
            f'set by {kind}; train one with --split {kind}'
        )
    split = recordings.split(
        origin['split'], origin['split_seed'], test=origin['test'], validation=origin['validation']
    )
    if split.split_id != origin['split_id']:
        raise ModelError(
            f'the split that model {loaded.model_id} was trained with cannot be reproduced with this release of NumPy; '
            'evaluate it with the release that it was trained with'
        )
    return recordings.as_samples(split.test), f'{len(split.test)} samples put aside by {origin["split"]}'


def require_same_features(loaded: LoadedModel, recordings: RecordedPresses) -> None:
    """Refuse presses whose features were measured differently from those in a model's training.

    Raises:
        ModelError: names both methods.
    """
    card = recordings.card
    for name, theirs, ours in (
        ('flow', loaded.flow, tuple(_method(card['flow']).values())),
        ('encoding', loaded.encoding, tuple(_method(card['encoding']).values())),
        ('image size', loaded.image_size, size_of_crop(card['crop_px'])),
    ):
        if theirs != ours:
            raise ModelError(
                f'model {loaded.model_id} was trained with {name} {_unlike(theirs, ours)}, but the data set was made '
                f'with {_unlike(ours, theirs)}; build the data set with the options of the model (--model FILE)'
            )


def _unlike(one: tuple[Any, Any], other: tuple[Any, Any]) -> str:
    """How one method differs from another: its name, or the options that differ; for sizes, both numbers.

    >>> _unlike(('dis', {'preset': 'fast', 'threads': 1}), ('dis', {'preset': 'medium', 'threads': 1}))
    "dis (preset='fast')"
    """
    name, options = one
    if not isinstance(options, dict):
        return f'{name}x{options}'
    differ = {each: value for each, value in options.items() if other[1].get(each, ...) != value}
    if name != other[0] or not differ:
        return str(name)
    return f'{name} ({", ".join(f"{each}={value!r}" for each, value in differ.items())})'
