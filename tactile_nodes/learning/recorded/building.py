"""Builds a data set from bags of presses: aligned, checked, measured. Lists presses left out with the reason."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from tactile_nodes import __version__
from tactile_nodes.errors import ConfigurationError, DatasetError, ImageError
from tactile_nodes.learning.config import Choice
from tactile_nodes.learning.datasets.file import FORMAT, FORMAT_VERSION
from tactile_nodes.learning.datasets.labels import describe
from tactile_nodes.learning.datasets.recordings import RecordedPresses
from tactile_nodes.learning.progress import Bar, Progress
from tactile_nodes.learning.recorded import exclusions
from tactile_nodes.learning.recorded.bags import CollectionBag, Frame, RecordedPress, open_bags
from tactile_nodes.learning.recorded.exclusions import LeftOut, Limits, judge
from tactile_nodes.learning.recorded.gels import Gels
from tactile_nodes.learning.recorded.measuring import Measurer
from tactile_nodes.learning.recorded.samples import Sample, Shelf
from tactile_nodes.messages import types
from tactile_nodes.model_file import LoadedModel, crop_of_size
from tactile_nodes.params import load_mapping
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.shapes import UInt8
from tactile_nodes.simulation.gel import Gel

FRAMES = {
    'mean': 'the mean of the images of a window, measured once: less noise than live images have',
    'first': 'the first image of a window: the noise of a live image',
    'each': 'every image of a window: the noise of live images, a sample for each; calibrations use their mean',
}


@dataclass(frozen=True)
class BuildOptions:
    """How bags become samples.

    Attributes:
        frames: which images of a window are measured, one of `FRAMES`.
        without_contact: share of the samples that show the untouched gel, if the bags hold enough such images.
        gel: name or id of the gel, or all properties of a simulated gel, with its id.
        separate_runs: a press of the same plan in another bag is another press, not another attempt at it.
        picture: width and height of the images that are described, of which `crop` is cut; None: any.
        namespace: the sensor whose topics are used, for bags that hold several.
        reference_clock: the recorder of edges whose clock is the reference for all others; None: the machine's.
    """

    flow: Choice = field(default_factory=lambda: Choice('dis'))
    encoding: Choice = field(default_factory=lambda: Choice('polar_mean'))
    bins: BinGrid = field(default_factory=BinGrid)
    frames: str = 'first'
    without_contact: float = 0.05
    limits: Limits = field(default_factory=Limits)
    gel: dict[str, Any] = field(default_factory=lambda: {'id': ''})
    crop: int | tuple[int, int] = 440
    picture: tuple[int, int] | None = None
    separate_runs: bool = False
    namespace: str | None = None
    reference_clock: str | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.without_contact <= 0.5:
            raise ConfigurationError(f'the share without contact must be between 0 and 0.5, got {self.without_contact}')

    @classmethod
    def of_model(cls, loaded: LoadedModel, gel: str = '', frames: str = 'first') -> BuildOptions:
        """Options to measure as a model does. Raises ConfigurationError: the file `gel` is not a simulated gel."""
        return cls(
            flow=Choice(*loaded.flow), encoding=Choice(*loaded.encoding), bins=loaded.model.bins, frames=frames,
            gel=gel_entry(gel), crop=loaded.image_size,
        )  # fmt: skip


def build(
    bags: Sequence[Path], options: BuildOptions, progress: Progress | None = None, *, command: str = ''
) -> RecordedPresses:
    """The data set of some bags; presses on two gels, and bags without presses, are only warned of.

    Ctrl-C ends it at once. Measurements made so far are kept, and the next run continues from there.

    Raises:
        BagError, DatasetError, ConfigurationError: a bag, an option, the cache or all presses cannot be used.
    """
    progress = progress or Progress()
    with ExitStack() as stack:
        opened = open_bags(bags, stack, progress.say, options.namespace, options.reference_clock)
        measurer = stack.enter_context(Measurer(options.flow, options.encoding, options.crop))
        bar = stack.enter_context(progress.bar('reading presses', sum(bag.press_count for bag in opened)))
        builder, gels = Builder(options, measurer, bar), Gels(progress)
        for number, bag in enumerate(opened):
            for press in bag.presses():
                builder.take(number, press)
                gels.see(bag.path, measurer)
    return builder.recordings(
        [card_entry(bag, options.gel['id']) for bag in opened], [bag.path for bag in opened], command=command
    )


class Builder:
    """Takes presses one by one, bag after bag, and returns the data set of all presses so far."""

    def __init__(self, options: BuildOptions, measurer: Measurer, bar: Bar | None = None) -> None:
        self.options, self.measurer, self.bar = options, measurer, bar
        self.shelf = Shelf(options.bins)
        self.left_out: list[LeftOut] = []
        self.untouched_found = 0
        self._usable: dict[tuple[Any, ...], tuple[LeftOut, list[Sample]]] = {}
        self._seen: set[tuple[Any, ...]] = set()
        self._suspects: dict[tuple[str, int, int, int], str] = {}
        self._without_contact = 0.0
        self._rest = 0, measurer.rest_image

    @property
    def presses(self) -> int:
        """Number of usable presses so far."""
        return len(self._usable)

    def take(self, bag: int, press: RecordedPress) -> list[Sample]:
        """Check and measure one attempt. Returns its samples, none if it cannot be used.

        Raises:
            DatasetError: its images have another size than described.
        """
        message = press.message
        if message.status == types.Press.STATUS_SUSPECT:
            self._suspects[message.plan_id, message.press, message.attempt, self._run(bag)] = message.reason
            return []
        entry = LeftOut(bag, message.plan_id, message.press, message.attempt, '', '')
        verdict = self._doubled(press) or judge(press, self.options.limits, self.options.bins)
        samples: list[Sample] = []
        if verdict is None:
            try:
                samples = self._samples(bag, press)
            except ImageError as error:
                verdict = exclusions.BAD_IMAGE, str(error)
        if verdict is None:
            self._keep(entry, samples)
        else:
            self._leave_out(entry, *verdict)
        if self.bar is not None:
            measurer, out = self.measurer, len(self.left_out)
            self.bar.advance(1, f'{measurer.computed} measured, {measurer.found} known, {out} out')
        return samples

    def recordings(
        self, entries: Sequence[Mapping[str, Any]], bags: Sequence[Path], *, command: str = ''
    ) -> RecordedPresses:
        """The data set so far.

        Args:
            entries: an entry of the card for each bag, as `card_entry` makes it.
            bags: their paths.
            command: the command line.

        Raises:
            DatasetError: no press can be used.
        """
        samples = self.finish()
        if not samples:
            of = f' of {_listed(bags)}' if bags else ''
            raise DatasetError(f'no press{of} can be used: {reasons(self.left_out)}')
        recordings = self.shelf.recordings(samples, {**_card(self, entries, bags), 'command': command})
        return replace(recordings, rest_image=self._rest[1])

    def finish(self) -> list[Sample]:
        """All samples except suspect ones, in the order in which their presses first appeared."""
        for key, (entry, _) in list(self._usable.items()):
            suspect = entry.plan, entry.press, entry.attempt, self._run(entry.bag)
            if (reason := self._suspects.get(suspect)) is not None:
                self._leave_out(entry, exclusions.SUSPECT, reason)
                del self._usable[key]
        return [sample for _, samples in self._usable.values() for sample in samples]

    def _run(self, bag: int) -> int:
        return bag if self.options.separate_runs else 0

    def _doubled(self, press: RecordedPress) -> exclusions.Verdict | None:
        message = press.message
        key = (message.plan_id, message.press, message.attempt, *press.window_ns)
        if key in self._seen:
            return exclusions.DOUBLED, 'the same attempt was reported before'
        self._seen.add(key)
        return None

    def _keep(self, entry: LeftOut, samples: list[Sample]) -> None:
        """Of several usable attempts at a press, keep the last."""
        key = (entry.plan, entry.press, self._run(entry.bag))
        if earlier := self._usable.pop(key, None):
            old, new = (earlier, (entry, samples))
            if samples[0].window_ns < earlier[1][0].window_ns:  # the bags were not given in the order of recording
                old, new = new, old
            self._leave_out(old[0], exclusions.SUPERSEDED, f'attempt {new[0].attempt} in bag {new[0].bag + 1} counts')
            self._usable[key] = new
        else:
            self._usable[key] = entry, samples

    def _leave_out(self, entry: LeftOut, reason: str, detail: str) -> None:
        self.left_out.append(LeftOut(entry.bag, entry.plan, entry.press, entry.attempt, reason, detail))

    def _samples(self, bag: int, press: RecordedPress) -> list[Sample]:
        assert press.reference is not None  # otherwise `judge` would have rejected it
        self._require_described(press.reference.image)
        self.measurer.use_reference(press.reference.image)
        if press.reference.stamp_ns >= self._rest[0]:
            self._rest = press.reference.stamp_ns, self.measurer.rest_image
        self.measurer.look_before([frame.image for frame in press.before])
        samples = [
            self._sample(bag, press, group, contact=True) for group in _groups(press.frames, self.options.frames)
        ]
        if press.untouched:
            self.untouched_found += 1
            share = self.options.without_contact
            self._without_contact += share / (1 - share)
            if self._without_contact >= 1 - 1e-9:
                self._without_contact -= 1
                groups = _groups(press.untouched, self.options.frames)
                samples += [self._sample(bag, press, group, contact=False) for group in groups]
        return samples

    def _require_described(self, image: UInt8[np.ndarray, 'h w']) -> None:
        described, size = self.options.picture, image.shape[::-1]
        if described and size not in (described, self.options.crop):
            came, wanted = (f'{width}x{height}' for width, height in (size, described))
            raise DatasetError(f'the images have {came} pixels, but the sensor is described with {wanted}')

    def _sample(self, bag: int, press: RecordedPress, frames: Sequence[Frame], *, contact: bool) -> Sample:
        measured = self.measurer.measure([frame.image for frame in frames], pressed=contact)
        return self.shelf.sample(bag, press, measured, frames, self.measurer.reference_id, contact=contact)


def _groups(frames: Sequence[Frame], mode: str) -> list[Sequence[Frame]]:
    """The images of each sample."""
    if mode == 'each':
        return [[frame] for frame in frames]
    return [frames[:1] if mode == 'first' else frames]


def gel_entry(text: str) -> dict[str, Any]:
    """What is known of the gel: its name, or all properties of a simulated gel from its YAML file.

    Raises:
        ConfigurationError: there is no such file, or it has a key that is not a property of a gel.
    """
    if not text.endswith(('.yaml', '.yml')):
        return {'id': text}
    written = {name.removeprefix('gel.'): located.value for name, located in load_mapping(text).items()}
    gel = Gel.from_mapping(written, text)
    return gel.card


def card_entry(bag: CollectionBag, gel: str) -> dict[str, Any]:
    """The card's entry for a bag whose presses were all read."""
    return {
        'id': bag.bag_id,
        'gel': gel,
        'attempts': bag.press_count,
        'problems': bag.problems,
        'clocks': bag.clocks.as_list(),
    }


def _card(builder: Builder, entries: Sequence[Mapping[str, Any]], bags: Sequence[Path]) -> dict[str, Any]:
    options, measurer = builder.options, builder.measurer
    return {
        'format': FORMAT,
        'format_version': FORMAT_VERSION,
        'made_with': f'tactile_nodes {__version__}',
        'flow': {'name': measurer.flow.name, 'options': json.loads(json.dumps(measurer.flow.options))},  # as in a file
        'encoding': {
            'name': measurer.encoding.name,
            'options': measurer.encoding.options,
            'channels': list(measurer.encoding.channels),
        },
        'recipe': measurer.recipe_id,
        'crop_px': crop_of_size(measurer.size),
        'frames': options.frames,
        'without_contact': {'share': options.without_contact, 'presses_with_such_images': builder.untouched_found},
        'labels': {**options.bins.card, 'reading': describe(options.bins)},
        'limits': {name: value if math.isfinite(value) else None for name, value in asdict(options.limits).items()},
        'gel': json.loads(json.dumps(options.gel)),
        'bags': list(entries),
        'bag_names': [path.name for path in bags],
        'left_out': [each.as_dict() for each in builder.left_out],
    }


def _listed(bags: Sequence[Path]) -> str:
    return ', '.join(map(str, bags))


def reasons(left_out: Sequence[LeftOut]) -> str:
    """'10 tried again later, 2 not settled (the first: attempt 1 in bag 2 counts)'"""
    counts = exclusions.counted(left_out)
    if not counts:
        return 'there is none'
    example = left_out[0]
    return f'{", ".join(f"{count} {reason}" for reason, count in counts.items())} (the first: {example.detail})'
