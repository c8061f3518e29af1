"""A model on other gels without a rig: weights put anywhere, a pen at known places, or nothing but two rest images.

The gels are those of `tactile bench transfer`. Weights alternate between two, and what is not told
of a press is taken out of the data before the calibration sees it. Pens press as hard as it comes.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.harness.declaration import SENSING, SIMULATED, Benchmark, Part, Result, argument, at_once
from benchmarks.harness.report import opening, table
from benchmarks.harness.running import Run
from benchmarks.transfer import UNTOUCHED
from tactile_nodes import clock
from tactile_nodes.errors import DatasetError
from tactile_nodes.simulation.other_gels import TESTED_SEED, other_gel

if TYPE_CHECKING:
    from tactile_nodes.learning.datasets.simulated import Dataset
    from tactile_nodes.learning.progress import Progress
    from tactile_nodes.model_file import LoadedModel
    from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout
    from tactile_nodes.sensing.picture.outline import OutlineMap
    from tactile_nodes.simulation.gel import Gel

WEIGHTS_N = 0.02 * 9.81, 0.05 * 9.81
"""20 and 50 grams, of the 1.1 N that the models know."""
REACH_MM, WEIGHTS_SEED = 13.0, 6001
PENS, FRAMES, TESTED = 3, 625, 150
AS_IT_IS, FULL, IMAGE, PEN, WEIGHT, IMAGE_WEIGHT, PEN_WEIGHT = (
    'as it is', 'force and place known', 'two rest images', 'pen', 'weights', 'two rest images and weights',
    f'{PENS} pens, the others weights',
)  # fmt: skip
ABOUT = """\
{gels} simulated gels; median (worst) over the gels, each tested on {tested} presses at new continuous places. The place
is the median over the presses of a gel. A pen is at a known place with an unknown force, weights ({grams} g in turn,
with the tip that the model knows) are at unknown places."""
RUNS = (
    (FULL, 10), (FULL, 25), (IMAGE, 0), (PEN, 5), (PEN, 10), (PEN, 25), (WEIGHT, 10),
    (IMAGE_WEIGHT, 5), (IMAGE_WEIGHT, 10), (IMAGE_WEIGHT, 25), (PEN_WEIGHT, 5), (PEN_WEIGHT, 10), (PEN_WEIGHT, 25),
)  # fmt: skip


@dataclass(frozen=True)
class Score:
    """What one readout does on the test presses of one gel; `seconds` is how long it took to make."""

    gel: int
    way: str
    presses: int
    force_rmse_n: float
    place_median_mm: float
    form: str = ''
    seconds: float = 0.0


@dataclass(frozen=True)
class _Pressed:
    """All that is known of one gel; what a way is not to know is taken out of it."""

    presses: Dataset
    weights: Dataset
    outline: OutlineMap
    half_px: float


def measured(arguments: argparse.Namespace, run: Run) -> Result:
    """On so many gels."""
    from tactile_nodes.model_file import find_model, load_model

    loaded, gels = load_model(find_model(arguments.model)), range(arguments.gels)
    return {'scores': measure(loaded, gels, run.progress, seed=arguments.gels_seed, part=run.part)}


def measure(
    loaded: LoadedModel, gels: Sequence[int], progress: Progress, runs: Sequence[tuple[str, int]] = RUNS,
    seed: int = TESTED_SEED, frames: int = FRAMES, part: Part = at_once,
) -> list[dict[str, Any]]:  # fmt: skip
    """The scores of some ways, each with a number of presses; `frames` pictures of a gel are pens and test presses.

    Raises:
        ModelError: the model cannot be transferred.
    """
    from tactile_nodes.learning.evaluation.evaluate import config_of
    from tactile_nodes.learning.transfer.checks import source_readout

    source, gel = source_readout(loaded), config_of(loaded).gel

    def on_gel(number: int) -> list[dict[str, Any]]:
        pressed = _pressed(loaded, other_gel(gel, number, seed), frames, runs, progress)
        made = list(_on_gel(source, pressed, number, runs))
        progress.say('; '.join(f'{each.way} {each.presses}: {each.force_rmse_n:.4f} N' for each in made))
        return [asdict(each) for each in made]

    return [each for number in gels for each in part(f'gel {number}', partial(on_gel, number))]


def _pressed(
    loaded: LoadedModel, other: Gel, frames: int, runs: Sequence[tuple[str, int]], progress: Progress
) -> _Pressed:
    from tactile_nodes.learning.config import DataConfig
    from tactile_nodes.learning.datasets.pressed_gels import anywhere
    from tactile_nodes.learning.evaluation.evaluate import config_of
    from tactile_nodes.sensing.picture.outline import outline_map

    crop = loaded.card['crop_px']
    presses = anywhere(replace(config_of(loaded), data=DataConfig(crop=crop), gel=other), progress, frames)
    # The shipped models hold no rest image, and their card names the gel: one of the same gel is rendered.
    outline = outline_map(*(_optics(each).render((), WEIGHTS_SEED) for each in (config_of(loaded).gel, other)))
    return _Pressed(presses, _weighed(loaded, other, max(count for _, count in runs)), outline, crop / 2)


def _optics(gel: Gel):  # type: ignore[no-untyped-def]
    from tactile_nodes.contact_tables.gel_tables import contact_table
    from tactile_nodes.simulation.optics import Optics

    return Optics(gel, contact_table(gel))


def _weighed(loaded: LoadedModel, gel: Gel, count: int) -> Dataset:
    """Weights on a gel, one after the other, and images of it untouched, as `Dataset` holds them."""
    from tactile_nodes.contact_tables.gel_tables import contact_table
    from tactile_nodes.learning.datasets.simulated import Dataset
    from tactile_nodes.learning.evaluation.evaluate import config_of
    from tactile_nodes.sensing.geometry import centre_crop
    from tactile_nodes.simulation.optics import Press

    config, optics, tip = config_of(loaded), _optics(gel), contact_table(gel)
    flow, encoding, crop = config.make_flow(), config.make_encoding(), loaded.card['crop_px']
    images = (centre_crop(optics.render((), WEIGHTS_SEED + number), crop, crop) for number in range(UNTOUCHED + 1))
    rest = next(images)
    flow.set_reference(rest)
    encoding.set_reference(rest)
    encoded = [encoding.encode(flow.displacement(image)) for image in images]
    rows = [(0.0, 0.0, -1.0, 0.0)] * UNTOUCHED
    places = np.random.default_rng(WEIGHTS_SEED).uniform(-REACH_MM, REACH_MM, (count, 2))
    for number, (x, y) in enumerate(places.tolist()):
        force_n = WEIGHTS_N[number % len(WEIGHTS_N)]
        press = Press(x, y, tip.depth_at(force_n))
        image = centre_crop(optics.render((press,), 2 * WEIGHTS_SEED + number), crop, crop)
        encoded.append(encoding.encode(flow.displacement(image)))
        rows.append((x, y, press.depth_mm, force_n))
    return Dataset(
        np.stack([each.values for each in encoded]).astype(np.float16), np.array(rows, np.float32),
        np.arange(len(rows)), np.stack([each.confidence for each in encoded]).astype(np.float32), gel.gel_id,
    )  # fmt: skip


def _first(dataset: Dataset, presses: int) -> np.ndarray:
    """The first presses, and images of the untouched gel, which cost nothing."""
    touched = dataset.presses[:, 2] > 0
    return np.sort(np.concatenate([np.flatnonzero(touched)[:presses], np.flatnonzero(~touched)[:UNTOUCHED]]))


def _on_gel(
    source: AxisymmetricReadout, pressed: _Pressed, number: int, runs: Sequence[tuple[str, int]]
) -> Iterator[Score]:
    yield _score(number, AS_IT_IS, 0, source, pressed.presses)
    for way, presses in runs:
        begun = clock.perf_ns()
        try:
            readout, form = _made(source, pressed, way, presses)
        except DatasetError:
            readout, form = source, 'refused'
        seconds = round((clock.perf_ns() - begun) / clock.NS_PER_S, 1)
        yield replace(_score(number, way, presses, readout, pressed.presses), form=form, seconds=seconds)


def _made(source: AxisymmetricReadout, pressed: _Pressed, way: str, presses: int) -> tuple[AxisymmetricReadout, str]:
    """The readout that one way leads to, and its form."""
    from tactile_nodes.learning.transfer.fit import Transfer, transfer
    from tactile_nodes.learning.transfer.partial import PartialTransfer, transfer_outline, transfer_partial
    from tactile_nodes.sensing.explain.field.readout import FieldReadout

    few = pressed.presses.take(_first(pressed.presses, presses))
    if way == IMAGE:
        made: Transfer | PartialTransfer = transfer_outline(source, pressed.outline, pressed.half_px)
    elif way == FULL:
        made = transfer(source, few)
    else:
        dataset = _as_pens(few) if way == PEN else _with_weights(pressed, PENS if way == PEN_WEIGHT else 0, presses)
        outline = pressed.outline if way == IMAGE_WEIGHT else None
        made = transfer_partial(source, dataset, outline, pressed.half_px)
    assert not isinstance(made.readout, FieldReadout)
    return made.readout, made.form


def _as_pens(presses: Dataset) -> Dataset:
    """Every press as at its known place, with a force that nobody knows."""
    told = presses.presses.copy()
    told[told[:, 2] > 0, 3] = np.nan
    return replace(presses, presses=told)


def _with_weights(pressed: _Pressed, pens: int, presses: int) -> Dataset:
    """Some pens, then weights at places that are not told."""
    weights = pressed.weights.take(_first(pressed.weights, presses))
    told = weights.presses.copy()
    touched = np.flatnonzero(told[:, 2] > 0)
    told[touched[:pens], 3] = np.nan
    told[touched[pens:], :2] = np.nan
    return replace(weights, presses=told)


def _score(gel: int, way: str, presses: int, readout: AxisymmetricReadout, dataset: Dataset) -> Score:
    from tactile_nodes.learning.transfer.fit import live_errors

    errors = live_errors(readout, dataset, np.flatnonzero(dataset.presses[:, 2] > 0)[-TESTED:])
    away = np.hypot(errors[:, 0], errors[:, 1])
    return Score(gel, way, presses, float(np.sqrt(np.mean(errors[:, 2] ** 2))), float(np.median(away)))


def _row(way: str, presses: int, scores: Sequence[Score]) -> list[str]:
    chosen = [each for each in scores if (each.way, each.presses) == (way, presses)]
    forms = [each.form for each in chosen if each.form]
    counted = ', '.join(f'{forms.count(form)} {form}' for form in dict.fromkeys(forms))
    values = [[each.force_rmse_n for each in chosen], [each.place_median_mm for each in chosen]]
    told = [f'{np.median(each):.4f} ({max(each):.4f})' for each in values]
    return [way, str(presses), *told, f'{np.median([each.seconds for each in chosen]):.1f}', counted]


def page(result: Mapping[str, Any]) -> str:
    """The results as a page of documentation."""
    scores = [Score(**each) for each in result['scores']]
    heads = ['', 'presses', 'force RMSE, N', 'place, mm', 'time, s', 'forms chosen']
    rows = [_row(way, presses, scores) for way, presses in dict.fromkeys((each.way, each.presses) for each in scores)]
    grams = ' and '.join(f'{1e3 * each / 9.81:.0f}' for each in WEIGHTS_N)
    about = ABOUT.format(gels=len({each.gel for each in scores}), tested=TESTED, grams=grams)
    return '\n\n'.join([*opening('Transfer to other gels without a rig', result, about), table(heads, rows)])


BENCHMARK = Benchmark(
    name='transfer_partial',
    about=__doc__,
    sources=('benchmarks/transfer_partial.py', 'tactile_nodes/learning/**', *SENSING, *SIMULATED),
    page=page,
    measure=measured,
    arguments=(
        argument('--model', default='portable', help='an axisymmetric model (default: portable)'),
        argument('--gels', least=1, type=int, default=10, metavar='N', help='gels to transfer to (default: 10)'),
        argument(
            '--gels-seed',
            type=int,
            default=TESTED_SEED,
            metavar='N',
            help='other gels than the test gels, to develop on',
        ),
    ),
)
