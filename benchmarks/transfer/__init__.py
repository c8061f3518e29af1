"""A model on other, simulated gels: error against the number of calibration presses.

The gels differ in hardness (30 %), thickness (0.3 mm), camera (1 mm shift, 2 degrees tilt, 3 degrees roll, 3 % of focal
length) and markers. They are calibrated with the presses of config/plans/calibrate.yaml, each held for some pictures as
on a rig. They are tested with single pictures of presses at random places and depths that no calibration uses; these
are the same for all gels and for the model's own.

The calibrated model is compared with the uncalibrated model, with a model of many other gels that needs no press on the
new one, with a response fitted to the same few presses alone, and with a model of the same kind trained in full on each
gel, which shows the best accuracy that the gel allows.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.harness.declaration import SENSING, SIMULATED, Benchmark, Part, Result, argument, at_once
from benchmarks.harness.running import Run
from benchmarks.transfer.page import Measured, draw, page
from benchmarks.transfer.scores import (
    ALONE,
    AS_IT_IS,
    CALIBRATED,
    COUNTS,
    MANY,
    OWN_GEL,
    PICTURES,
    TRAINED,
    Score,
    score,
)
from tactile_nodes import clock
from tactile_nodes.errors import ConfigurationError, DatasetError
from tactile_nodes.simulation.other_gels import LEARNED_SEED, TESTED_SEED, other_gel

if TYPE_CHECKING:
    from tactile_nodes.learning.config import TrainConfig
    from tactile_nodes.learning.datasets.simulated import Dataset
    from tactile_nodes.learning.progress import Progress
    from tactile_nodes.model_file import LoadedModel
    from tactile_nodes.sensing.explain.arrays import AnyReadout
    from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout
    from tactile_nodes.sensing.explain.measured.readout import ResponseReadout
    from tactile_nodes.simulation.gel import Gel

TEST_FRAMES, TEST_SEED, UNTOUCHED = 1500, 5003, 20
"""A fifth of the frames are without contact, all others are tested; no training uses presses of this seed."""
TRAINED_PRESSES, TRAINED_SEED = 3000, 5005
"""Presses to train a model on the tested gel; at random places, which differ from those of the test."""
LEAST_TRAINED, TRAINED_UNTOUCHED = 150, 40
"""The least number of presses for this training, and the approximate minimum of frames without contact."""
MANY_PRESSES = 400
"""Presses on each gel for a model that needs no press on the new gel; none of these gels is a test gel."""
REFUSED = 'refused'


def measured(arguments: argparse.Namespace, run: Run) -> Result:
    """Measure the requested number of gels."""
    from tactile_nodes.learning.evaluation.evaluate import config_of
    from tactile_nodes.model_file import find_model, load_model

    if arguments.own and arguments.own < LEAST_TRAINED:
        raise ConfigurationError(f'--own must be 0, or at least {LEAST_TRAINED} for a model to be trained by')
    loaded, seed = load_model(find_model(arguments.model)), arguments.gels_seed
    own, scores = measure(
        loaded, range(arguments.gels), run.progress, arguments.many, seed, trained=arguments.own,
        pictures=arguments.pictures, part=run.part,
    )  # fmt: skip
    gels = [other_gel(config_of(loaded).gel, number, seed) for number in range(arguments.gels)]
    summary = {'own': own.as_dict(), 'scores': [each.as_dict() for each in scores]}
    return {**summary, '_page': Measured(own, scores, gels, f'{name_of(arguments)}.png', arguments.pictures)}


def name_of(arguments: argparse.Namespace) -> str:
    """The name of the result, which depends on the gels and the number of pictures."""
    seed, pictures = arguments.gels_seed, arguments.pictures
    gels = '' if seed == TESTED_SEED else f'_gels_{seed}'
    return f'transfer{gels}' + ('' if pictures == PICTURES else f'_pictures_{pictures}')


def measure(
    loaded: LoadedModel, gels: Sequence[int], progress: Progress, many: int = 0, seed: int = TESTED_SEED,
    counts: Sequence[int] = COUNTS, frames: int = TEST_FRAMES, trained: int = 0,
    pictures: int = PICTURES, part: Part = at_once,
) -> tuple[Score, list[Score]]:  # fmt: skip
    """The model's score on its own gel, and all further scores, also of a model of `many` other gels unless 0.

    Every gel is calibrated with `counts` presses, of `pictures` each, and tested on `frames` frames. Unless `trained`
    is 0, a model is trained on each gel with that number of presses; the same on the model's own gel shows the effect
    of this number.

    Raises:
        ModelError: the model cannot be transferred.
    """
    from tactile_nodes.learning.evaluation.evaluate import config_of
    from tactile_nodes.learning.transfer.checks import source_readout

    source, gel = source_readout(loaded), config_of(loaded).gel
    tested, _ = _tested(loaded, gel, progress, frames)
    own = score(OWN_GEL, 0, AS_IT_IS, source, tested)
    of_many = _of_many(loaded, gel, many, progress) if many else None

    def on_own_gel() -> list[dict[str, Any]]:
        return [_trained(loaded, gel, OWN_GEL, trained, tested, progress).kept()]

    def on_gel(number: int) -> list[dict[str, Any]]:
        other = other_gel(gel, number, seed)
        pressed, rest = _tested(loaded, other, progress, frames)
        made = _on_gel(source, _planned(loaded, other, progress, pictures), pressed, number, counts)
        if of_many is not None:
            made.append(score(number, 0, MANY, _at_rest(of_many, rest), pressed))
        if trained:
            made.append(_trained(loaded, other, number, trained, pressed, progress))
        progress.say('; '.join(f'{each.way} {each.presses}: {each.force_rmse_n:.4f} N' for each in made))
        return [each.kept() for each in made]

    entries = part('own gel', on_own_gel) if trained else []
    entries += [each for number in gels for each in part(f'gel {number}', partial(on_gel, number))]
    return own, [Score.of(each) for each in entries]


def _of_many(loaded: LoadedModel, gel: Gel, many: int, progress: Progress) -> AxisymmetricReadout:
    """An axisymmetric response fitted to presses on many gels at once, as if they were one."""
    from tactile_nodes.learning.axisymmetric.fit import fit_axisymmetric
    from tactile_nodes.learning.config import AxisymmetricConfig

    parts = [_presses(loaded, other_gel(gel, number, LEARNED_SEED), progress, MANY_PRESSES) for number in range(many)]
    centred = [part.features - _rest_of(part) for part in parts]
    begins = np.cumsum([0, *(len(part.confidence) for part in parts)])
    pooled = dataclasses.replace(
        parts[0],
        features=np.concatenate(centred).astype(np.float16),
        presses=np.concatenate([part.presses for part in parts]),
        rest=np.concatenate([part.rest + begin for part, begin in zip(parts, begins, strict=False)]),
        confidence=np.concatenate([part.confidence for part in parts]),
    )
    config = AxisymmetricConfig(most_contacts=1)
    return fit_axisymmetric(pooled, np.zeros(len(pooled.presses), bool), config, loaded.model.bins, progress)


def _trained(loaded: LoadedModel, gel: Gel, number: int, presses: int, tested: Dataset, progress: Progress) -> Score:
    """The score of a model trained in full on this gel, with the same number of profiles as a calibrated one."""
    from tactile_nodes.learning.axisymmetric.fit import fit_axisymmetric
    from tactile_nodes.learning.config import AxisymmetricConfig, DataConfig
    from tactile_nodes.learning.datasets.simulated import simulate
    from tactile_nodes.learning.transfer.checks import source_readout

    known = source_readout(loaded).response
    config = AxisymmetricConfig(lateral=known.lateral, vertical=len(known.profiles) - known.lateral)
    # By default, random presses reach a little further out and deeper than the tested ones, as for the source model.
    data = DataConfig(seed=TRAINED_SEED, crop=loaded.card['crop_px'])
    at_rest = max(data.without_contact, TRAINED_UNTOUCHED / (presses + TRAINED_UNTOUCHED))
    data = dataclasses.replace(data, presses=round(presses / (1 - at_rest)), without_contact=at_rest)
    dataset = simulate(dataclasses.replace(_config(loaded, gel), data=data), progress)
    begun = clock.perf_ns()
    readout = fit_axisymmetric(dataset, np.zeros(len(dataset.presses), bool), config, loaded.model.bins, progress)
    seconds = (clock.perf_ns() - begun) / clock.NS_PER_S
    return dataclasses.replace(score(number, presses, TRAINED, readout, tested), seconds=round(seconds, 1))


def _rest_of(dataset: Dataset) -> np.ndarray:
    """The mean features of the first images of the untouched gel, which need no press."""
    untouched = np.flatnonzero(dataset.presses[:, 2] <= 0)[:UNTOUCHED]
    mean: np.ndarray = dataset.features[untouched].astype(np.float32).mean(axis=0)
    return mean


def _at_rest(readout: AxisymmetricReadout, rest: np.ndarray) -> AxisymmetricReadout:
    """The readout, relative to the new gel at rest."""
    return dataclasses.replace(readout, scaling=dataclasses.replace(readout.scaling, mean=rest))


def _presses(loaded: LoadedModel, gel: Gel, progress: Progress, frames: int) -> Dataset:
    """Presses at random places and depths, for training."""
    from tactile_nodes.learning.datasets.pressed_gels import anywhere

    return anywhere(_config(loaded, gel), progress, frames)


def _tested(loaded: LoadedModel, gel: Gel, progress: Progress, frames: int) -> tuple[Dataset, np.ndarray]:
    """Presses for the test, at the same random places and depths on every gel; and the features at rest."""
    from tactile_nodes.learning.datasets.pressed_gels import anywhere

    dataset = anywhere(_config(loaded, gel), progress, frames, TEST_SEED)
    return dataset.take(np.flatnonzero(dataset.presses[:, 2] > 0)), _rest_of(dataset)


def _planned(loaded: LoadedModel, gel: Gel, progress: Progress, pictures: int = 1) -> Dataset:
    """All presses of the longest calibration plan, with their own rest image."""
    from tactile_nodes.learning.datasets.pressed_gels import planned

    return planned(_config(loaded, gel), progress, pictures)


def _config(loaded: LoadedModel, gel: Gel) -> TrainConfig:
    from tactile_nodes.learning.config import DataConfig
    from tactile_nodes.learning.evaluation.evaluate import config_of

    return dataclasses.replace(config_of(loaded), data=DataConfig(crop=loaded.card['crop_px']), gel=gel)


def _on_gel(
    source: AxisymmetricReadout, planned: Dataset, tested: Dataset, number: int, counts: Sequence[int]
) -> list[Score]:
    """Scores of all calibrations of the source with the `planned` presses, on the presses of another data set."""
    from tactile_nodes.learning.datasets.pressed_gels import first_presses
    from tactile_nodes.learning.transfer.fit import transfer

    scores = [score(number, 0, AS_IT_IS, source, tested)]
    readout: AnyReadout
    for presses in counts:
        few = first_presses(planned, presses)
        begun = clock.perf_ns()
        try:
            made = transfer(source, few)
            readout, form = made.readout, made.form
        except DatasetError:
            readout, form = source, REFUSED
        seconds = (clock.perf_ns() - begun) / clock.NS_PER_S
        scored = score(number, presses, CALIBRATED, readout, tested)
        scores.append(dataclasses.replace(scored, form=form, seconds=round(seconds, 1)))
        alone = _alone(first_presses(few, presses, pictures=1), presses, source)
        scores.append(score(number, presses, ALONE, alone, tested))
    return scores


def _alone(few: Dataset, presses: int, source: AnyReadout) -> ResponseReadout:
    """A response fitted to the few presses alone, with a resolution that depends on their number."""
    from tactile_nodes.learning.config import ResponseConfig
    from tactile_nodes.learning.measured.fit import fit_response
    from tactile_nodes.learning.progress import Progress

    config = ResponseConfig(components=min(40, max(3, presses // 2)), spacing_mm=4.0, levels=3, most_contacts=1)
    return fit_response(few, np.zeros(len(few.presses), bool), config, source.bins, Progress())


BENCHMARK = Benchmark(
    name='transfer',
    about=__doc__,
    sources=('benchmarks/transfer/**', 'tactile_nodes/learning/**', 'config/plans/**', *SENSING, *SIMULATED),
    page=page,
    measure=measured,
    draw=draw,
    name_of=name_of,
    more_than_json=True,
    files=tuple(
        f'transfer{of}{end}' for of in ('', '_gels_4077', '_gels_4077_pictures_1') for end in ('.json', '.md', '.png')
    ),
    arguments=(
        argument('--model', default='portable', help='an axisymmetric model (default: portable)'),
        argument('--gels', least=1, type=int, default=10, metavar='N', help='gels to transfer to (default: 10)'),
        argument(
            '--many',
            least=0,
            type=int,
            default=8,
            metavar='N',
            help='gels to train the model `of many gels` with (default: 8)',
        ),
        argument(
            '--own',
            type=int,
            default=TRAINED_PRESSES,
            metavar='N',
            help=f'presses to train a model on each gel with; 0: no such model (default: {TRAINED_PRESSES})',
        ),
        argument(
            '--pictures',
            least=1,
            type=int,
            default=PICTURES,
            metavar='N',
            help=f'pictures of each calibration press, while it is held (default: {PICTURES})',
        ),
        argument(
            '--gels-seed',
            type=int,
            default=TESTED_SEED,
            metavar='N',
            help='seed of the gels; another seed gives gels to develop with',
        ),
    ),
)
