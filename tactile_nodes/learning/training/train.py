"""Trains a force model: presses, a readout fitted to them, its uncertainty, its card, its file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tactile_nodes import __version__, clock
from tactile_nodes.errors import TooFewPressesError
from tactile_nodes.learning.axisymmetric.fit import fit_axisymmetric
from tactile_nodes.learning.config import TIPS, TipsConfig, TrainConfig
from tactile_nodes.learning.datasets.pressed_gels import pressed_gel
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.field.calibration import card_of_sensor, train_field
from tactile_nodes.learning.field.refining import with_refinement
from tactile_nodes.learning.measured.fit import fit_response
from tactile_nodes.learning.network.fit import fit_network
from tactile_nodes.learning.network.inputs import judging_samples
from tactile_nodes.learning.network.layers import import_torch
from tactile_nodes.learning.network.scores import Validation
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.run.folder import Run, RunFolder
from tactile_nodes.learning.tasks import done
from tactile_nodes.learning.training.source import TrainingData, training_data
from tactile_nodes.learning.transfer.errors import Errors
from tactile_nodes.learning.transfer.fit import live_errors
from tactile_nodes.learning.transfer.judgement import objection, of_the_mean, poor, require_worth, unjudged
from tactile_nodes.learning.transfer.prior import Found, found_by_counts, learned_prior
from tactile_nodes.model_file import check_model_output, save_model
from tactile_nodes.sensing.explain.arrays import AnyReadout
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout
from tactile_nodes.sensing.explain.model import FeatureLayout, ForceModel

USUAL_PRESSES, LEFT = 200, 140
"""Number of recorded presses that gives a useful model, and how many of them the splits leave to train on."""
CALIBRATE = (
    'calibrate a model of another gel, which takes ten to a hundred presses with the features of that model: tactile '
    'dataset … --model portable -o presses.npz, then tactile calibrate --dataset presses.npz --model portable -o FILE'
)
CLEARLY = 1.25
"""Factor on the product of the errors of force and place by which the less simple readout must be better."""
NETWORK_THRESHOLD_N = 0.05
"""Above the force that a network trained as published reads without contact."""


def train(
    config: TrainConfig,
    *,
    progress: Progress | None = None,
    command: str = '',
    runs: Path | None = None,
    fresh: bool = False,
    forced: bool = False,
) -> Path:
    """Get the presses, fit the readout, and write the model file that the configuration names.

    With `runs`, the run is stored in a folder below it, from which the same call continues after a kill; `fresh`
    discards the stored state. Ctrl-C ends the training and keeps the best network so far. The same configuration gives
    the same readout on the same machine, in one run or in several. `command` goes into the model's card.

    Raises:
        ConfigurationError: torch is not installed, the configuration contradicts the recorded presses, or another
            process trains the same run.
        DatasetError: the presses cannot be used, or are too few. Also, unless `forced`, if the model is no better on
            held-out recorded presses than their mean.
    """
    if config.readout == 'network':
        import_torch()  # before any press is rendered
    check_model_output(config.output, Path(config.data.file) if config.data.file else None)
    progress = progress or Progress()
    with calibration_named(config):
        data = training_data(config, progress)
    run = Run() if runs is None else RunFolder(runs, data.config, data.dataset.fingerprint, fresh=fresh)
    with run:
        with calibration_named(config):
            readout, report = fit(data, progress, run)
        data = replace(data, config=replace(data.config, readout=readout.kind))
        warning = require_learned(readout, data, forced=forced)
        model = ForceModel(
            layout=FeatureLayout(data.config.encoding.name, *data.dataset.features.shape[1:]),
            bins=data.config.bins,
            readout=readout,
            contact_threshold_n=threshold_of(data.config),
        )
        scores = validation_of(readout, data)
        card = card_of(data, report, scores, command)
        model_id = save_model(config.output, model, card, data.rest_image)
        run.finish({'model_id': model_id, 'parameters': readout.parameter_count, **card})
    progress.say(f'{config.output}: model {model_id}, {readout.parameter_count} parameters; {scores}')
    if warning:
        progress.say(warning)
    return config.output


@contextmanager
def calibration_named(config: TrainConfig) -> Iterator[None]:
    """If recorded presses are too few for a separate model, add to the error what they are enough for.

    Raises:
        TooFewPressesError: the error of the block, with this addition.
    """
    try:
        yield
    except TooFewPressesError as error:
        if not config.data.file:
            raise
        raise TooFewPressesError(f'{error}; or {CALIBRATE}') from error


def require_learned(readout: AnyReadout, data: TrainingData, *, forced: bool = False) -> str:
    """A warning for the user of a model trained on recorded presses; empty if there are enough presses.

    Raises:
        DatasetError: unless `forced`, if the model is no better on held-out presses than their mean, or if these allow
            no conclusion.
    """
    if not data.config.data.file:
        return ''
    presses = data.dataset.presses
    judges = np.flatnonzero(data.held_out & (presses[:, 2] > 0))
    after, mean = Errors.of(live_errors(readout, data.dataset, judges)), of_the_mean(presses[judges][:, [0, 1, 3]])
    fault = objection('model', after, None, mean) or unjudged(len(judges), mean)
    advice = _advice(int((~data.held_out & (presses[:, 2] > 0)).sum()))
    require_worth(fault, advice, forced=forced, command='tactile train')
    fault = fault or poor(after, mean)
    return f'warning: {fault}; {advice}' if fault else ''


def _advice(presses: int) -> str:
    """Advice on how to get a model if this number of training presses was not enough."""
    enough = presses >= LEFT
    few = f'{presses} presses to train on {"usually do better" if enough else "are too few"}'
    more = 'check places and forces' if enough else f'record {USUAL_PRESSES} or more in all'
    return f'{few}: {more}, or {CALIBRATE}'


def threshold_of(config: TrainConfig) -> float:
    """The total force above which the live node reports a contact."""
    return float(getattr(getattr(config, config.readout), 'contact_threshold_n', NETWORK_THRESHOLD_N))


def fit(data: TrainingData, progress: Progress, run: Run) -> tuple[AnyReadout, dict[str, Any]]:
    """The readout that the configuration selects, and the card's entries about its training."""
    config, dataset = data.config, data.dataset
    if config.readout == 'network':
        return fit_network(dataset, data.held_out, config, progress, run)
    if config.readout == 'tips':
        return _fit_tips(data, progress, run)
    begun = clock.perf_ns()
    if config.readout == 'field':
        field_readout, fitted = train_field(dataset, config.field, config.bins, progress)
        if config.field.touches and not config.data.file:
            field_readout, fitted['refinement'] = with_refinement(field_readout, config, progress)
        seconds = round((clock.perf_ns() - begun) / clock.NS_PER_S, 1)
        return field_readout, {'settings': asdict(config.field), 'seconds': seconds, 'device': 'cpu', 'field': fitted}
    settings: TipsConfig
    readout: AnyReadout
    if config.readout == 'axisymmetric':
        settings = config.axisymmetric
        readout = with_prior(
            fit_axisymmetric(dataset, data.held_out, settings, config.bins, progress), config, progress
        )
    else:
        settings = config.response
        readout = fit_response(dataset, data.held_out, settings, config.bins, progress)
    seconds = round((clock.perf_ns() - begun) / clock.NS_PER_S, 1)
    return readout, {'settings': asdict(settings), 'seconds': seconds, 'device': 'cpu'}


def _fit_tips(data: TrainingData, progress: Progress, run: Run) -> tuple[AnyReadout, dict[str, Any]]:
    """An axisymmetric readout, or a response if that reads the validation presses clearly better."""
    made = {name: fit(replace(data, config=replace(data.config, readout=name)), progress, run) for name in TIPS}
    judges = np.flatnonzero(data.held_out & (data.dataset.presses[:, 2] > 0))
    errors = {name: Errors.of(live_errors(readout, data.dataset, judges)) for name, (readout, _) in made.items()}
    simple, other = (errors[name].force_rmse_n * errors[name].place_median_mm for name in TIPS)
    chosen = TIPS[simple > CLEARLY * other]
    told = '; '.join(
        f'{name}: force RMSE {each.force_rmse_n:.4f} N, place {each.place_median_mm:.3f} mm'
        for name, each in errors.items()
    )
    progress.say(f'on the validation presses: {told}; {chosen} is taken')
    readout, report = made[chosen]
    return readout, {**report, 'tips': {name: each.as_dict() for name, each in errors.items()}}


def with_prior(readout: AxisymmetricReadout, config: TrainConfig, progress: Progress) -> AxisymmetricReadout:
    """The readout with a prior from calibrations of other gels, if the gel is simulated; otherwise unchanged."""
    gels = config.axisymmetric.other_gels
    if not gels or config.data.file:
        return readout
    jobs = [_OtherGel(readout, config, number) for number in range(gels)]
    found: dict[int, list[Found]] = {}
    with progress.bar('calibrating other gels', gels) as bar:
        for number, of_gel in done(_found_on, jobs, config.data.processes):
            found[number] = of_gel
            bar.advance()
    return replace(readout, prior=learned_prior(readout, [found[number] for number in range(gels)]))


@dataclass(frozen=True)
class _OtherGel:
    """Task: calibrate a readout for one other gel."""

    readout: AxisymmetricReadout
    config: TrainConfig
    number: int


def _found_on(other: _OtherGel) -> list[Found]:
    return found_by_counts(other.readout, *pressed_gel(other.config, other.number))


def validation_of(readout: AnyReadout, data: TrainingData) -> Validation:
    """Scores on the held-out samples, each read as in the live node."""
    dataset: Dataset = data.dataset
    judges = judging_samples(dataset, data.held_out, data.config)
    read = [
        readout.read(dataset.features[i].astype(np.float32), dataset.confidence[dataset.rest[i]]).normal_force_n
        for i in judges
    ]
    return Validation.of(
        dataset.labels(data.config.bins)[judges], np.stack(read).reshape(len(judges), -1), data.config.bins
    )


def card_of(data: TrainingData, report: dict[str, Any], scores: Validation, command: str) -> dict[str, Any]:
    """The model's card: information for users who do not know the model."""
    config = data.config
    return {
        'command': command,
        'made_with': f'tactile_nodes {__version__}',
        'licence': 'the same as tactile_nodes',
        'flow': {'name': config.flow.name, 'options': config.make_flow().options},
        'encoding': {'name': config.encoding.name, 'options': config.make_encoding().options},
        'crop_px': config.data.crop,
        'gel': data.gel,
        'data': {**data.origin, 'fingerprint': data.dataset.fingerprint},
        'training': report,
        'validation': asdict(scores),
        **(card_of_sensor(config.field) if config.readout == 'field' else {}),
    }
