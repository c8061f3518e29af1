"""A model on other gels: error against the number of presses that it is calibrated by, all of it simulated.

The gels differ in hardness (30 %), thickness (0.3 mm) and camera (1 mm aside, 2 degrees tilted, 3 rolled, 3 % of focal
length), and have other markers each. Pressed by the plan of a calibration (config/plans/calibrate.yaml) and tested on
presses at random continuous places and depths that no calibration saw, beside the model as it is, a model of many other
gels that needs no press of the new one, and a response fitted to the same few presses alone.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tactile_nodes import clock
from tactile_nodes.benchmarks.report import keep, surroundings
from tactile_nodes.errors import ConfigurationError, DatasetError
from tactile_nodes.simulation.other_gels import LEARNED_SEED, TESTED_SEED, other_gel

if TYPE_CHECKING:
    from tactile_nodes.learning.config import TrainConfig
    from tactile_nodes.learning.dataset import Dataset
    from tactile_nodes.learning.progress import Progress
    from tactile_nodes.model_file import LoadedModel
    from tactile_nodes.sensing.axisymmetric_readout import AxisymmetricReadout
    from tactile_nodes.sensing.readout_arrays import AnyReadout
    from tactile_nodes.sensing.response_readout import ResponseReadout
    from tactile_nodes.simulation.gel import Gel

FRAMES, TESTED, UNTOUCHED = 625, 300, 20
COUNTS = 10, 25, 50, 100
MEASURES = ('force_rmse_n', 'place_median_mm', 'armse_n', 'd_loc_mm', 'rmse_mc_n')
AS_IT_IS, MANY, CALIBRATED, ALONE = 'as it is', 'of many gels', 'calibrated', 'fitted alone'
MANY_PRESSES = 400
"""On each of the gels that a model without any press of the new gel is trained on; none of them is a test gel."""
REFUSED = 'refused'


@dataclass(frozen=True)
class Score:
    """What one readout does on the test presses of one gel; `seconds` is how long it took to make.

    `covered` is the share of forces within the 90 % interval that the readout states; NaN where it states none.
    """

    gel: int
    presses: int
    way: str
    force_rmse_n: float
    place_median_mm: float
    armse_n: float
    d_loc_mm: float
    rmse_mc_n: float
    covered: float
    form: str = ''
    seconds: float = 0.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of ``tactile bench transfer``."""
    parser.add_argument('--model', default='portable', help='an axisymmetric or a response model (default: portable)')
    parser.add_argument('--gels', type=int, default=10, metavar='N', help='gels to transfer to (default: 10)')
    parser.add_argument(
        '--many', type=int, default=8, metavar='N', help='gels that a model without any press learns from (default: 8)'
    )
    parser.add_argument(
        '--gels-seed', type=int, default=TESTED_SEED, metavar='N', help='other gels than the test gels, to develop on'
    )
    parser.add_argument(
        '-o', '--output', type=Path, metavar='FOLDER',
        help='write transfer.json, transfer.md and transfer.png there; of other gels transfer_gels_N.*',
    )  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    """Measure, print, and keep."""
    from tactile_nodes.benchmarks.transfer_page import draw, page
    from tactile_nodes.learning.evaluate import config_of
    from tactile_nodes.learning.progress import TerminalProgress
    from tactile_nodes.model_file import find_model, load_model

    if arguments.gels < 1 or arguments.many < 0:
        raise ConfigurationError('--gels must be at least 1, and --many at least 0')
    seed, name, said = arguments.gels_seed, 'transfer', ''
    if seed != TESTED_SEED:
        name, said = f'transfer_gels_{seed}', f' --gels-seed {seed}'
    command = f'tactile bench transfer --model {arguments.model} --gels {arguments.gels} --many {arguments.many}{said}'
    plain = surroundings(command)
    loaded = load_model(find_model(arguments.model))
    own, scores = measure(loaded, range(arguments.gels), TerminalProgress(), arguments.many, seed)
    gels = [other_gel(config_of(loaded).gel, number, seed) for number in range(arguments.gels)]
    text = page(command, plain, own, scores, gels, f'{name}.png')
    print(text)
    if arguments.output:
        keep(
            arguments.output,
            name,
            text,
            {**plain, 'own': asdict(own), 'scores': [asdict(each) for each in scores]},
        )
        draw(own, scores, arguments.output / f'{name}.png')
    return 0


def measure(
    loaded: LoadedModel, gels: Sequence[int], progress: Progress, many: int = 0, seed: int = TESTED_SEED
) -> tuple[Score, list[Score]]:
    """The model's score on its own gel, and all scores on the others; with a model of `many` further gels beside.

    Raises:
        ModelError: it cannot be transferred.
    """
    from tactile_nodes.learning.evaluate import config_of
    from tactile_nodes.learning.transfer_checks import source_readout

    source, gel = source_readout(loaded), config_of(loaded).gel
    own = _score(-1, 0, AS_IT_IS, source, _tested(_presses(loaded, gel, progress)))
    of_many = _of_many(loaded, gel, many, progress) if many else None
    scores = []
    for number in gels:
        other = other_gel(gel, number, seed)
        dataset = _presses(loaded, other, progress)
        made = _on_gel(source, _planned(loaded, other, progress), dataset, number)
        if of_many is not None:
            made.append(_score(number, 0, MANY, _at_rest(of_many, dataset), _tested(dataset)))
        scores += made
        progress.say('; '.join(f'{each.way} {each.presses}: {each.force_rmse_n:.4f} N' for each in made))
    return own, scores


def _of_many(loaded: LoadedModel, gel: Gel, many: int, progress: Progress) -> AxisymmetricReadout:
    """An axisymmetric response fitted to presses on many gels at once, as if they were one."""
    from tactile_nodes.learning.axisymmetric_fit import fit_axisymmetric
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


def _rest_of(dataset: Dataset) -> np.ndarray:
    """What the first images of the untouched gel show, which needs no press."""
    untouched = np.flatnonzero(dataset.presses[:, 2] <= 0)[:UNTOUCHED]
    mean: np.ndarray = dataset.features[untouched].astype(np.float32).mean(axis=0)
    return mean


def _at_rest(readout: AxisymmetricReadout, dataset: Dataset) -> AxisymmetricReadout:
    """The readout about the new gel's own rest."""
    return dataclasses.replace(readout, scaling=dataclasses.replace(readout.scaling, mean=_rest_of(dataset)))


def _presses(loaded: LoadedModel, gel: Gel, progress: Progress, frames: int = FRAMES) -> Dataset:
    """Presses at random places and depths."""
    from tactile_nodes.learning.pressed_gels import anywhere

    return anywhere(_config(loaded, gel), progress, frames)


def _planned(loaded: LoadedModel, gel: Gel, progress: Progress) -> Dataset:
    """As many presses of the plan of a calibration as the longest one has, about a rest image of their own."""
    from tactile_nodes.learning.pressed_gels import planned

    return planned(_config(loaded, gel), progress)


def _config(loaded: LoadedModel, gel: Gel) -> TrainConfig:
    from tactile_nodes.learning.config import DataConfig
    from tactile_nodes.learning.evaluate import config_of

    return dataclasses.replace(config_of(loaded), data=DataConfig(crop=loaded.card['crop_px']), gel=gel)


def _tested(dataset: Dataset) -> Dataset:
    return dataset.take(np.flatnonzero(dataset.presses[:, 2] > 0)[-TESTED:])


def _on_gel(source: AnyReadout, planned: Dataset, dataset: Dataset, number: int) -> list[Score]:
    """Scores of all that `planned` presses make of the source, on the presses of another data set."""
    from tactile_nodes.learning.pressed_gels import first_presses
    from tactile_nodes.learning.transfer_fit import transfer

    tested = _tested(dataset)
    scores = [_score(number, 0, AS_IT_IS, source, tested)]
    readout: AnyReadout
    for presses in COUNTS:
        few = first_presses(planned, presses)
        begun = clock.perf_ns()
        try:
            made = transfer(source, few)
            readout, form = made.readout, made.form
        except DatasetError:
            readout, form = source, REFUSED
        seconds = (clock.perf_ns() - begun) / clock.NS_PER_S
        score = _score(number, presses, CALIBRATED, readout, tested)
        scores.append(dataclasses.replace(score, form=form, seconds=round(seconds, 1)))
        scores.append(_score(number, presses, ALONE, _alone(few, presses, source), tested))
    return scores


def _alone(few: Dataset, presses: int, source: AnyReadout) -> ResponseReadout:
    """A response fitted to the few presses alone, as finely as they allow."""
    from tactile_nodes.learning.config import ResponseConfig
    from tactile_nodes.learning.progress import Progress
    from tactile_nodes.learning.response_fit import fit_response

    config = ResponseConfig(components=min(40, max(3, presses // 2)), spacing_mm=4.0, levels=3, most_contacts=1)
    return fit_response(few, np.zeros(len(few.presses), bool), config, source.bins, Progress())


def _score(gel: int, presses: int, way: str, readout: AnyReadout, tested: Dataset) -> Score:
    from tactile_nodes.sensing import metrics

    read = [
        readout.read(values.astype(np.float32), tested.confidence[rest])
        for values, rest in zip(tested.features, tested.rest, strict=True)
    ]
    bins = np.stack([each.normal_force_n.reshape(-1) for each in read])
    places = np.array([(each.contacts[0].x_mm, each.contacts[0].y_mm) for each in read])
    labels = tested.labels(readout.bins)
    away = np.hypot(*(places - tested.presses[:, :2]).T)
    off = metrics.total_errors_n(labels, bins)
    return Score(
        gel, presses, way, metrics.root_mean_square(off), float(np.median(away)), metrics.armse(labels, bins),
        metrics.location_error_mm(labels, bins, readout.bins), metrics.peak_rmse_n(labels, bins),
        metrics.coverage(off, np.array([each.total_sigma_n for each in read])),
    )  # fmt: skip
