"""Finds the smallest configuration that meets a requirement: trains, scores, times and stores candidates alike.

A candidate is a flow with its options, a grid of regions and a readout. All are trained on the same presses and scored
on the same held-out presses. These decide the choice; presses that a split sets aside for the test are not used. Then
all are timed in turn on the same images. The front are the candidates that no other beats in both time and error. The
requirement selects one of them.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import asdict, dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.errors import ConfigurationError, NoPressesError
from tactile_nodes.learning.config import Choice, TrainConfig
from tactile_nodes.learning.datasets.file import save_dataset
from tactile_nodes.learning.datasets.recordings import RecordedPresses
from tactile_nodes.learning.evaluation.text_table import Table
from tactile_nodes.learning.network.scores import Validation
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.recorded.bags import CollectionBag, RecordedPress
from tactile_nodes.learning.recorded.building import BuildOptions, build
from tactile_nodes.learning.run.folder import Run
from tactile_nodes.learning.training.source import TrainingData, recorded_data, training_data
from tactile_nodes.learning.training.train import card_of, fit, threshold_of, validation_of
from tactile_nodes.learning.tuning.times import cpu_times_ms
from tactile_nodes.model_file import save_model
from tactile_nodes.sensing.explain.model import FeatureLayout, ForceModel
from tactile_nodes.sensing.metrics import pareto_front
from tactile_nodes.shapes import UInt8
from tactile_nodes.simulation.optics import Optics, Press

METRICS = {
    'armse_n': "aRMSE [N], the paper's: root mean square error of each bin, averaged over the bins",
    'rmse_mc_n': "RMSE_mc [N], the paper's: of the strongest bin's force",
    'd_loc_mm': "d_loc [mm], the paper's: mean distance between strongest bins",
    'total_rmse_n': 'root mean square error of the total force [N]',
}
IMAGES = 12
"""Number of frames that are timed."""
OURS = 'inverse_compositional'


@dataclass(frozen=True)
class Candidate:
    """A configuration to try, with its name in tables."""

    name: str
    flow: Choice
    regions: int
    components: int

    def of(self, base: TrainConfig) -> TrainConfig:
        """The run that trains it, otherwise identical to `base`."""
        spacing = 2.0 if self.components <= 40 else 1.75
        return replace(
            base,
            readout='response',
            flow=self.flow,
            encoding=Choice('cartesian_mean', {'rows': self.regions, 'cols': self.regions}),
            response=replace(base.response, components=self.components, spacing_mm=spacing),
        )


def candidates() -> list[Candidate]:
    """Our flow at full, half and quarter size, DIS by its presets, each on several grids; readouts of two sizes.

    Networks are not included: on no data so far was a network on the front (docs/results/accuracy.md).
    """
    listed = []
    for scale, size in ((2, 'quarter'), (1, 'half'), (0, 'full')):
        for regions, components in ((10, 24), (10, 40), (20, 40), (20, 64), (40, 64)):
            if (scale, regions) == (2, 40):  # patches of three pixels
                continue
            options = {'rows': regions, 'cols': regions, 'finest_scale': scale}
            name = f'ours at {size} size, {regions}x{regions}, {components}'
            listed.append(Candidate(name, Choice(OURS, options), regions, components))
    for preset in ('ultrafast', 'fast', 'medium'):
        for regions, components in ((10, 40), (20, 64)):
            name = f'DIS {preset}, {regions}x{regions}, {components}'
            listed.append(Candidate(name, Choice('dis', {'preset': preset, 'finest_scale': 1}), regions, components))
    return listed


@dataclass(frozen=True)
class Wish:
    """The requirement: a largest error, a largest time (CPU ms per frame), or both."""

    max_error: float | None = None
    max_ms: float | None = None
    metric: str = 'armse_n'

    def __post_init__(self) -> None:
        if self.max_error is None and self.max_ms is None:
            raise ConfigurationError('give a limit: --max-error, --max-ms, or both')
        if any(each is not None and not each > 0 for each in (self.max_error, self.max_ms)):
            raise ConfigurationError('--max-error and --max-ms must be above 0')
        if self.metric not in METRICS:
            raise ConfigurationError(f'there is no metric {self.metric!r}; use one of: {", ".join(METRICS)}')


@dataclass(frozen=True)
class Tried:
    """A trained candidate: its scores on held-out presses, and the CPU time of a frame in contact.

    `rest_image` is that of the presses, without rows if they are simulated.
    """

    candidate: Candidate
    model: ForceModel
    config: TrainConfig
    scores: Validation
    card: dict[str, Any]
    rest_image: UInt8[np.ndarray, 'h w']
    ms: float = float('nan')

    def error(self, metric: str) -> float:
        return float(getattr(self.scores, metric))


@dataclass(frozen=True)
class Tuned:
    """All candidates tried, and the front (cheapest first).

    `chosen` is the one that meets the requirement, `smaller` the next cheaper one. Both raise a ConfigurationError if
    none meets it.
    """

    tried: list[Tried]
    front: list[Tried]
    wish: Wish

    @property
    def chosen(self) -> Tried:
        return self.front[chosen_place(self.front, self.wish)]

    @property
    def smaller(self) -> Tried | None:
        place = chosen_place(self.front, self.wish)
        return self.front[place - 1] if place else None


class SimulatedSource:
    """Presses that a training run's configuration simulates."""

    def __init__(self, base: TrainConfig) -> None:
        if base.data.file:
            raise ConfigurationError(
                'a data set holds features of one flow and one grid, not images, so it cannot be used for tuning; name '
                'the bags that it was built from, or a run of simulated presses'
            )
        self._base = base

    def data(self, candidate: Candidate, progress: Progress) -> TrainingData:
        return training_data(candidate.of(self._base), progress)

    def images(self) -> list[UInt8[np.ndarray, 'h w']]:
        """A rest image, followed by images of presses."""
        gel = self._base.gel
        optics = Optics(gel, contact_table(gel))
        places = np.random.default_rng(1).uniform((-13.0, -13.0, 0.25), (13.0, 13.0, 2.0), (IMAGES, 3)).tolist()
        return [optics.render((), 1), *(optics.render((Press(*each[:3]),), 2 + i) for i, each in enumerate(places))]


class RecordedSource:
    """Presses in the bags of a collection, measured again for each flow and grid."""

    def __init__(self, bags: Sequence[Path], options: BuildOptions, base: TrainConfig) -> None:
        self._bags, self._options, self._base = list(bags), options, base
        self._built: dict[str, RecordedPresses] = {}

    def data(self, candidate: Candidate, progress: Progress) -> TrainingData:
        key = f'{candidate.flow} {candidate.regions}'
        if key not in self._built:
            self._built = {key: self.presses(candidate, progress)}
        return recorded_data(candidate.of(self._base), self._built[key], progress)

    def presses(self, candidate: Candidate, progress: Progress, command: str = '') -> RecordedPresses:
        """The data set of a candidate."""
        config = candidate.of(self._base)
        options = replace(self._options, flow=config.flow, encoding=config.encoding)
        return build(self._bags, options, progress, command=command)

    def images(self) -> list[UInt8[np.ndarray, 'h w']]:
        with closing(self._pressed()) as presses:
            found = list(islice(presses, IMAGES))
        return [
            *(press.reference.image for press in found[:1] if press.reference),
            *(each.frames[0].image for each in found),
        ]

    def _pressed(self) -> Generator[RecordedPress]:
        """Presses with images, one bag after the other; a bag is opened when its first press is needed."""
        for path in self._bags:
            with (
                suppress(NoPressesError),
                CollectionBag(path, self._options.namespace, self._options.reference_clock) as bag,
            ):
                for press in bag.presses():
                    if press.reference is not None and press.frames:
                        yield press


Source = SimulatedSource | RecordedSource


def tune(
    source: Source, wish: Wish, progress: Progress, command: str = '', among: Sequence[Candidate] | None = None
) -> Tuned:
    """Try all candidates (by default those of `candidates`), from which the requirement selects one.

    Raises:
        DatasetError, BagError: the presses cannot be used, or are too few for a candidate.
    """
    chosen_from = list(candidates() if among is None else among)
    tried = list(_tried(source, chosen_from, progress, command))
    times = cpu_times_ms([(each.model, each.config) for each in tried], source.images(), progress)
    timed = [replace(each, ms=ms) for each, ms in zip(tried, times, strict=True)]
    order = pareto_front([each.ms for each in timed], [each.error(wish.metric) for each in timed])
    return Tuned(timed, [timed[i] for i in order], wish)


def chosen_place(front: Sequence[Tried], wish: Wish) -> int:
    """Index in a front, cheapest first: the cheapest that is accurate enough, or the most accurate that is fast enough.

    Raises:
        ConfigurationError: there is none.
    """
    if wish.max_error is not None:
        good = [i for i, each in enumerate(front) if each.error(wish.metric) <= wish.max_error]
        if good and (wish.max_ms is None or front[good[0]].ms <= wish.max_ms):
            return good[0]
        best = front[good[0] if good else -1]
    else:
        assert wish.max_ms is not None
        fast = [i for i, each in enumerate(front) if each.ms <= wish.max_ms]
        if fast:
            return fast[-1]
        best = front[0]
    raise ConfigurationError(
        f'no candidate meets the limits; the closest is {best.candidate.name}, with {wish.metric} '
        f'{best.error(wish.metric):.4f} at {best.ms:.2f} ms a frame: relax them, or give more presses to train on'
    )


def _tried(source: Source, among: Sequence[Candidate], progress: Progress, command: str) -> Iterator[Tried]:
    with progress.bar('trying configurations', len(among)) as bar:
        for candidate in among:
            data = source.data(candidate, Progress())
            readout, report = fit(data, Progress(), Run())
            layout = FeatureLayout(data.config.encoding.name, *data.dataset.features.shape[1:])
            model = ForceModel(layout, data.config.bins, readout, threshold_of(data.config))
            scores = validation_of(readout, data)
            bar.advance(1, f'{candidate.name}: {scores}')
            card = card_of(data, report, scores, command)
            yield Tried(candidate, model, data.config, scores, card, data.rest_image)


def files_of(output: Path, *, recorded: bool) -> list[Path]:
    """The files of a profile: the model, its training run and, if the presses are recorded, their data set.

    Raises:
        ConfigurationError: the name is not that of a model file.
    """
    if output.suffix != '.safetensors':
        raise ConfigurationError(f'the name of a model file must end in .safetensors, got {output}')
    return [output, output.with_suffix('.yaml'), *([output.with_suffix('.npz')] if recorded else [])]


def write_profile(chosen: Tried, output: Path, command: str, presses: RecordedPresses | None = None) -> list[Path]:
    """Write the model and a training run that reproduces it; for recorded presses, also their data set.

    Raises:
        ConfigurationError: a file cannot be written, or as `files_of`.
        DatasetError: the data set cannot be written.
    """
    files = files_of(output, recorded=presses is not None)
    config = replace(chosen.config, output=output)
    if presses is not None:
        save_dataset(files[-1], presses)
        config = replace(config, data=replace(config.data, file=str(files[-1])))
    run = yaml.safe_dump(config.resolved(), sort_keys=False)
    try:
        save_model(output, chosen.model, chosen.card, chosen.rest_image)
        files[1].write_text(f'# Chosen by: {command}\n#   tactile train {files[1]}\n{run}', encoding='utf-8')
    except OSError as error:
        raise ConfigurationError(
            f'cannot write {error.filename} ({error.strerror}); choose another place with -o'
        ) from error
    return files


def table_of(tuned: Tuned) -> Table:
    """A row for each candidate, cheapest first. The front and the chosen candidate, if there is one, are marked."""
    on_front, rows, chosen = {id(each) for each in tuned.front}, [], None
    with suppress(ConfigurationError):
        chosen = tuned.chosen
    for each in sorted(tuned.tried, key=lambda one: one.ms):
        mark = 'chosen' if each is chosen else 'front' if id(each) in on_front else ''
        scores = asdict(each.scores)
        rows.append((each.candidate.name, f'{each.ms:.2f}', *(f'{scores[name]:.4f}' for name in METRICS), mark))
    return Table('', ('flow, regions, components', 'CPU ms', *METRICS, ''), tuple(rows))


def said_of(tuned: Tuned, metric: str) -> str:
    """The choice in a sentence, with the scores of the next smaller one."""
    chosen, smaller = tuned.chosen, tuned.smaller
    first = f'{chosen.candidate.name}: {metric} {chosen.error(metric):.4f} at {chosen.ms:.2f} ms of CPU a frame.'
    if smaller is None:
        return f'{first} There is no smaller one on the front.'
    times = smaller.error(metric) / max(chosen.error(metric), 1e-12)
    return (
        f'{first} The next smaller one, {smaller.candidate.name}, would take {smaller.ms:.2f} ms and cost {times:.2f} '
        f'times the error ({smaller.error(metric):.4f}).'
    )
