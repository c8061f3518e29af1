"""A model on other gels: error against the number of presses that it is calibrated by, all of it simulated.

The gels differ in hardness (30 %), thickness (0.3 mm) and camera (1 mm aside, 2 degrees tilted, 3 rolled, 3 % of focal
length), and have other markers each. Tested on presses at continuous places that no calibration saw, beside the model
as it is and a response fitted to the same few presses alone.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_nodes import clock
from tactile_nodes.benchmarks.report import surroundings, table, write_json
from tactile_nodes.errors import ConfigurationError, DatasetError

if TYPE_CHECKING:
    from tactile_nodes.learning.dataset import Dataset
    from tactile_nodes.learning.progress import Progress
    from tactile_nodes.model_file import LoadedModel
    from tactile_nodes.sensing.readout_arrays import AnyReadout
    from tactile_nodes.sensing.response import ResponseReadout
    from tactile_nodes.simulation.gel import Gel

GELS_SEED, PRESSES_SEED = 77, 5001
FRAMES, WITHOUT_CONTACT, TESTED, UNTOUCHED = 625, 0.2, 300, 20
COUNTS = 10, 25, 50, 100
MEASURES = ('force_rmse_n', 'place_median_mm', 'armse_n')
AS_IT_IS, CALIBRATED, ALONE = 'as it is', 'calibrated', 'fitted alone'


@dataclass(frozen=True)
class Score:
    """What one readout does on the test presses of one gel; `seconds` is how long it took to make."""

    gel: int
    presses: int
    way: str
    force_rmse_n: float
    place_median_mm: float
    armse_n: float
    form: str = ''
    seconds: float = 0.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of ``tactile bench transfer``."""
    parser.add_argument('--model', default='portable', help='an axisymmetric or a response model (default: portable)')
    parser.add_argument('--gels', type=int, default=10, metavar='N', help='gels to transfer to (default: 10)')
    parser.add_argument('-o', '--output', type=Path, metavar='FOLDER', help='write transfer.json and transfer.md there')


def run(arguments: argparse.Namespace) -> int:
    """Measure, print, and keep."""
    from tactile_nodes.learning.progress import TerminalProgress
    from tactile_nodes.model_file import find_model, load_model

    if arguments.gels < 1:
        raise ConfigurationError('--gels must be at least 1')
    command = f'tactile bench transfer --model {arguments.model} --gels {arguments.gels}'
    plain = surroundings(command)
    loaded = load_model(find_model(arguments.model))
    own, scores = measure(loaded, range(arguments.gels), TerminalProgress())
    text = page(command, own, scores)
    print(text)
    if arguments.output:
        _keep(arguments.output, text, {**plain, 'own': asdict(own), 'scores': [asdict(each) for each in scores]})
    return 0


def other_gel(gel: Gel, number: int) -> Gel:
    """A gel that differs from another as makes of one sensor do; thickness in three steps."""
    random = np.random.default_rng([GELS_SEED, number])
    stiffer = _within(random, 0.3)
    thicker = 0.3 * float(random.integers(-1, 2))
    shift = _within(random, 1.0), _within(random, 1.0)
    tilt = _within(random, 2.0), _within(random, 2.0)
    return dataclasses.replace(
        gel,
        seed=100 + number,
        shear_modulus_mpa=gel.shear_modulus_mpa * (1 + stiffer),
        soft_mm=gel.soft_mm + thicker,
        camera_shift_mm=shift,
        camera_tilt_deg=tilt,
        focal_px_per_rad=gel.focal_px_per_rad * (1 + _within(random, 0.03)),
        camera_roll_deg=_within(random, 3.0),
    )


def _within(random: np.random.Generator, most: float) -> float:
    return float(random.uniform(-most, most))


def measure(loaded: LoadedModel, gels: Sequence[int], progress: Progress) -> tuple[Score, list[Score]]:
    """The model's score on its own gel, and all scores on the others.

    Raises:
        ModelError: it cannot be transferred.
    """
    from tactile_nodes.learning.evaluate import config_of
    from tactile_nodes.learning.transfer_checks import source_readout

    source, gel = source_readout(loaded), config_of(loaded).gel
    own = _score(-1, 0, AS_IT_IS, source, _tested(_presses(loaded, gel, progress)))
    scores = []
    for number in gels:
        made = _on_gel(source, _presses(loaded, other_gel(gel, number), progress), number)
        scores += made
        progress.say('; '.join(f'{each.way} {each.presses}: {each.force_rmse_n:.4f} N' for each in made))
    return own, scores


def _presses(loaded: LoadedModel, gel: Gel, progress: Progress) -> Dataset:
    from tactile_nodes.learning.config import DataConfig
    from tactile_nodes.learning.dataset import simulate
    from tactile_nodes.learning.evaluate import config_of

    data = DataConfig(
        presses=FRAMES, seed=PRESSES_SEED, reach_mm=13.5, shallowest_mm=0.25, deepest_mm=2.0,
        without_contact=WITHOUT_CONTACT, presses_per_rest_image=0, processes=1, crop=loaded.card['crop_px'],
    )  # fmt: skip
    return simulate(dataclasses.replace(config_of(loaded), data=data, gel=gel), progress)


def _tested(dataset: Dataset) -> Dataset:
    return dataset.take(np.flatnonzero(dataset.presses[:, 2] > 0)[-TESTED:])


def _few(dataset: Dataset, presses: int) -> Dataset:
    """The first presses, and some images of the untouched gel, which cost a rig nothing."""
    touched = dataset.presses[:, 2] > 0
    chosen = np.concatenate([np.flatnonzero(touched)[:presses], np.flatnonzero(~touched)[:UNTOUCHED]])
    return dataset.take(np.sort(chosen))


def _on_gel(source: AnyReadout, dataset: Dataset, number: int) -> list[Score]:
    from tactile_nodes.learning.transfer_fit import transfer

    tested = _tested(dataset)
    scores = [_score(number, 0, AS_IT_IS, source, tested)]
    readout: AnyReadout
    for presses in COUNTS:
        few = _few(dataset, presses)
        begun = clock.perf_ns()
        try:
            made = transfer(source, few)
            readout, form = made.readout, made.form
        except DatasetError:
            readout, form = source, 'refused'
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
    force = metrics.root_mean_square(metrics.total_errors_n(labels, bins))
    return Score(gel, presses, way, force, float(np.median(away)), metrics.armse(labels, bins))


def page(command: str, own: Score, scores: Sequence[Score]) -> str:
    """The results as a page of documentation."""
    gels = len({each.gel for each in scores})
    rows = [_row(way, presses, scores) for presses in (0, *COUNTS) for way in (AS_IT_IS, CALIBRATED, ALONE)]
    told = [each for each in rows if each]
    heads = ['', 'presses', 'force RMSE, N', 'place, mm', 'aRMSE, N', 'time, s', 'forms chosen']
    level = ['own gel', 'all', *(f'{getattr(own, name):.4f}' for name in MEASURES), '', '']
    return '\n'.join([
        '# Transfer to other gels',
        '',
        f'`{command}`',
        '',
        f'{gels} simulated gels; median (worst) over the gels, each tested on {TESTED} presses at new continuous',
        'places. The place is the median over the presses of a gel. The first row is the model on its own gel.',
        '',
        table(heads, [level, *told]),
    ])  # fmt: skip


def _row(way: str, presses: int, scores: Sequence[Score]) -> list[str]:
    chosen = [each for each in scores if (each.way, each.presses) == (way, presses)]
    if not chosen:
        return []
    values = [[getattr(each, name) for each in chosen] for name in MEASURES]
    forms = [each.form for each in chosen if each.form]
    counted = ', '.join(f'{forms.count(form)} {form}' for form in dict.fromkeys(forms))
    seconds = f'{np.median([each.seconds for each in chosen]):.1f}' if forms else ''
    return [way, str(presses), *(f'{np.median(each):.4f} ({max(each):.4f})' for each in values), seconds, counted]


def _keep(folder: Path, text: str, result: dict[str, Any]) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / 'transfer.md').write_text(text + '\n', encoding='utf-8')
    except OSError as error:
        raise ConfigurationError(f'cannot write to {folder} ({error.strerror}); choose another with -o') from error
    write_json(folder / 'transfer.json', result)
