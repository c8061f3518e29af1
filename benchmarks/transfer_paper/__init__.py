"""The paper's calibration layer on other, simulated gels: its three metrics against the number of presses.

As in the paper, 800 presses on a coarse grid are divided into training and test presses. The layer is compared with no
calibration, and with a network trained on the same few presses. The test presses are at the same places as the training
presses, at other depths, so presses at new continuous places are a second test. The first training steps of the layer
show why the published learning rate does harm.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.harness.declaration import SENSING, SIMULATED, Benchmark, Result, argument
from benchmarks.harness.running import Run
from benchmarks.transfer_paper.page import draw, page
from benchmarks.transfer_paper.scores import (
    AS_IT_IS,
    GROUP,
    NEW,
    OURS,
    OWN,
    PUBLISHED,
    REST,
    SCRATCH,
    TENTH,
    Score,
)
from tactile_nodes import clock
from tactile_nodes.errors import ConfigurationError

if TYPE_CHECKING:
    from tactile_nodes.learning.config import TrainConfig
    from tactile_nodes.learning.datasets.simulated import Dataset
    from tactile_nodes.learning.progress import Progress
    from tactile_nodes.learning.transfer.layer import LayerConfig
    from tactile_nodes.model_file import LoadedModel
    from tactile_nodes.sensing.explain.network import NetworkReadout
    from tactile_nodes.simulation.gel import Gel

GRID_SEED, NEW_SEED, TESTED = 5101, 5102, 300
COUNTS = (100, 300, 700)
PATIENCE = 40


@dataclass(frozen=True)
class Presses:
    """The coarse grid and the new places on one gel."""

    gel: int
    grid: Dataset
    new: Dataset


def measured(arguments: argparse.Namespace, run: Run) -> Result:
    """Measure all gels; the result is stored after each."""
    from benchmarks.transfer_paper.steps import first_steps
    from tactile_nodes.learning.transfer.network import network_readout
    from tactile_nodes.model_file import find_model, load_model

    counts, loaded = _counts(arguments), load_model(find_model(arguments.model))
    readout, config = network_readout(loaded), scratch_config(loaded, arguments.patience)

    def on_gel(number: int) -> Result:
        presses = pressed(loaded, number, run.progress)
        steps = [] if number else first_steps(readout, presses.grid)
        scores = measure(readout, presses, counts, arguments.patience, config, run.progress.say)
        return {'scores': [asdict(each) for each in scores], 'steps': [asdict(each) for each in steps]}

    own = run.part('own gel', lambda: [asdict(each) for each in as_it_is(readout, pressed(loaded, OWN, run.progress))])
    result = {'scores': own, 'steps': []}
    for number in range(arguments.gels):
        for name, found in run.part(f'gel {number}', partial(on_gel, number)).items():
            result[name] += found
        run.keep(result)
    return result


def _counts(arguments: argparse.Namespace) -> list[int]:
    counts = sorted(set(arguments.presses))
    if counts[-1] > 800 - GROUP:
        raise ConfigurationError(f'--presses must be at most {800 - GROUP}, got {counts[-1]}')
    return counts


def pressed(loaded: LoadedModel, number: int, progress: Progress) -> Presses:
    """The presses on one of the other gels, or on the model's own gel."""
    from tactile_nodes.learning.evaluation.evaluate import config_of
    from tactile_nodes.simulation.other_gels import other_gel

    own = config_of(loaded).gel
    gel = own if number == OWN else other_gel(own, number)
    grid = _simulated(loaded, gel, progress, plan='coarse', seed=GRID_SEED, presses_per_rest_image=250)
    new = _simulated(
        loaded, gel, progress, presses=TESTED, seed=NEW_SEED, reach_mm=13.5, shallowest_mm=0.25, deepest_mm=2.0,
        presses_per_rest_image=0,
    )  # fmt: skip
    return Presses(number, grid, new)


def _simulated(loaded: LoadedModel, gel: Gel, progress: Progress, **asked: Any) -> Dataset:
    from tactile_nodes.learning.config import DataConfig
    from tactile_nodes.learning.datasets.simulated import simulate
    from tactile_nodes.learning.evaluation.evaluate import config_of

    data = DataConfig(without_contact=0.0, processes=1, crop=loaded.card['crop_px'], **asked)
    return simulate(dataclasses.replace(config_of(loaded), data=data, gel=gel), progress)


def scratch_config(loaded: LoadedModel, patience: int) -> TrainConfig:
    """The shipped training configuration of the paper's network."""
    from tactile_nodes.learning.config import Choice, load_train_config
    from tactile_nodes.paths import share_directory

    config = load_train_config(share_directory() / 'config' / 'train' / 'paper.yaml')
    training = dataclasses.replace(config.training, patience=patience, device='cpu')
    return dataclasses.replace(
        config, training=training, encoding=Choice(*loaded.encoding), recorded_bins=loaded.model.bins
    )


def layer_settings(patience: int) -> dict[str, LayerConfig]:
    """The paper's settings, the same with a tenth of the rate, and the shipped settings."""
    from tactile_nodes.learning.transfer.layer import LayerConfig, load_layer_config
    from tactile_nodes.paths import share_directory

    letter = load_layer_config(share_directory() / 'config' / 'transfer' / 'paper_letter.yaml')
    tenth = dataclasses.replace(letter, learning_rate=letter.learning_rate / 10)
    ways = {PUBLISHED: letter, TENTH: tenth, OURS: LayerConfig()}
    return {way: dataclasses.replace(config, patience=patience) for way, config in ways.items()}


def as_it_is(readout: NetworkReadout, presses: Presses) -> list[Score]:
    """Scores of the readout without any calibration."""
    return _scores(readout, presses, 0, AS_IT_IS)


def measure(
    readout: NetworkReadout,
    presses: Presses,
    counts: Sequence[int],
    patience: int,
    config: TrainConfig,
    say: Callable[[str], None],
) -> list[Score]:
    """Scores of every method on one gel."""
    scores = as_it_is(readout, presses)
    for count in counts:
        made = [_layered(readout, presses, count, way, each) for way, each in layer_settings(patience).items()]
        made.append(_from_scratch(presses, count, config))
        scores += [score for each in made for score in each]
        errors = '; '.join(f'{one.way} {one.armse_n:.4f} N, {new.armse_n:.4f} N at new places' for one, new in made)
        say(f'gel {presses.gel}, {count} presses: {errors}')
    return scores


def _layered(readout: NetworkReadout, presses: Presses, count: int, way: str, config: LayerConfig) -> list[Score]:
    from tactile_nodes.learning.transfer.layer import fit_layer
    from tactile_nodes.learning.transfer.network import shuffled_parts

    fitted = fit_layer(readout, presses.grid, *shuffled_parts(np.arange(count), config), config)
    if fitted.ended == 'interrupted':
        raise KeyboardInterrupt
    details = {'best_epoch': fitted.best_epoch, 'epochs': fitted.epochs_run, 'seconds': fitted.seconds}
    return _scores(dataclasses.replace(readout, layer=fitted.layer), presses, count, way, **details)


def _from_scratch(presses: Presses, count: int, config: TrainConfig) -> list[Score]:
    """Scores of the paper's network, trained on the few presses alone, with the same share for early stopping."""
    from tactile_nodes.learning.network.fit import fit_network
    from tactile_nodes.learning.progress import Progress
    from tactile_nodes.learning.transfer.layer import LayerConfig
    from tactile_nodes.learning.transfer.network import shuffled_parts

    begun = clock.perf_ns()
    _, stops = shuffled_parts(np.arange(count), LayerConfig())
    held_out = np.isin(np.arange(count), stops)
    readout, report = fit_network(presses.grid.take(np.arange(count)), held_out, config, Progress())
    if report['ended'] == 'interrupted':
        raise KeyboardInterrupt
    details = {'best_epoch': report['best_epoch'], 'epochs': report['epochs_run']}
    seconds = round((clock.perf_ns() - begun) / clock.NS_PER_S, 1)
    return _scores(readout, presses, count, SCRATCH, seconds=seconds, **details)


def _scores(readout: NetworkReadout, presses: Presses, count: int, way: str, **details: Any) -> list[Score]:
    """Scores on the rest of the grid, and at new places."""
    rest = presses.grid.take(np.arange(count, len(presses.grid.presses)))
    tests = {REST: rest, NEW: presses.new}
    return [
        Score(presses.gel, count, way, name, *metrics_of(readout, dataset), **details)
        for name, dataset in tests.items()
    ]


def metrics_of(readout: NetworkReadout, dataset: Dataset) -> tuple[float, float, float]:
    """aRMSE, d_loc and RMSE_mc: means over groups of presses, so that sets of different size are comparable."""
    from tactile_nodes.sensing import metrics

    true_n, found_n, bins = dataset.labels(readout.bins), answers(readout, dataset), readout.bins
    groups = np.array_split(np.arange(len(true_n)), max(1, round(len(true_n) / GROUP)))
    found = [
        (
            metrics.armse(true_n[rows], found_n[rows]),
            metrics.location_error_mm(true_n[rows], found_n[rows], bins),
            metrics.peak_rmse_n(true_n[rows], found_n[rows]),
        )
        for rows in groups
    ]
    armse_n, d_loc_mm, rmse_mc_n = np.mean(found, axis=0).tolist()
    return armse_n, d_loc_mm, rmse_mc_n


def answers(readout: NetworkReadout, dataset: Dataset) -> np.ndarray:
    """Forces of all samples at once; the same as the live node's, except for rounding."""
    from tactile_nodes.sensing.explain.network import ACTIVATIONS, rectified

    values = dataset.features.astype(np.float32).reshape(len(dataset.features), -1)
    if readout.layer:
        values = rectified(values @ readout.layer.weight.T + readout.layer.bias)
    for number in np.unique(dataset.rest):
        rows = dataset.rest == number
        shaped = values[rows].reshape(-1, *dataset.features.shape[1:])
        values[rows] = readout.scaling(shaped, dataset.confidence[number]).reshape(len(shaped), -1)
    network, hidden = readout.network, ACTIVATIONS[readout.network.hidden]
    for weight, bias in zip(network.weights[:-1], network.biases[:-1], strict=True):
        values = hidden(values @ weight.T + bias)
    forces: np.ndarray = (values @ network.weights[-1].T + network.biases[-1]) * np.float32(readout.output_scale_n)
    return forces


BENCHMARK = Benchmark(
    name='transfer_paper',
    about=__doc__,
    sources=('benchmarks/transfer_paper/**', 'tactile_nodes/learning/**', 'config/transfer/**', *SENSING, *SIMULATED),
    page=page,
    measure=measured,
    draw=draw,
    arguments=(
        argument('--model', default='paper', help='a network with polar features (default: paper)'),
        argument('--gels', least=1, type=int, default=3, metavar='N', help='gels to transfer to (default: 3)'),
        argument(
            '--presses',
            least=20,
            type=int,
            nargs='+',
            default=list(COUNTS),
            metavar='N',
            help=f'to learn from (default: {" ".join(map(str, COUNTS))})',
        ),
        argument(
            '--patience',
            least=1,
            type=int,
            default=PATIENCE,
            metavar='N',
            help=f'epochs without a better validation loss; the paper has 200 (default: {PATIENCE})',
        ),
    ),
)
