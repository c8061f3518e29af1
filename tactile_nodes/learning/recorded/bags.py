"""Reads collection bags, and matches presses with their images by capture stamps.

A bag holds more images than fit in memory, so it is read once, as a stream. A press is assembled when the next press
message and a later image have arrived, and older messages are dropped. Receive times are not used, only stamps: a
recorder that stood still receives one topic after the other. If a recorder had another clock, its stamps are first
converted to the rig's clock (`clocks`).
"""

from __future__ import annotations

import hashlib
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactile_nodes.bag.content import BagMessage
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bus.topics import FORCE_TORQUE, PRESS, PRESS_IMAGE, REFERENCE_IMAGE, RIG_STATE, Topic
from tactile_nodes.conversions import image_array
from tactile_nodes.errors import DatasetError, ImageError, MessageError, NoPressesError, TactileError
from tactile_nodes.learning.recorded.clocks import Clocks, bag_clocks, first_frame, topics_of
from tactile_nodes.learning.recorded.forces import ForceSamples
from tactile_nodes.messages import stamp_ns, types
from tactile_nodes.shapes import UInt8

STATE_REACH_NS = 500_000_000
"""A rig state further than this from an image's stamp says nothing about where the tip was at that time."""


@dataclass(frozen=True)
class Frame:
    """An image and its capture time on the rig's clock."""

    stamp_ns: int
    image: UInt8[np.ndarray, 'h w']


@dataclass(frozen=True)
class RecordedPress:
    """One attempt as recorded in a bag, with the images of its window in order of their stamps.

    `untouched` are images of the untouched gel, for samples without force. `before` are those of them that were taken
    between the previous window and this one, and show where the camera stood. `reference` is the last rest image before
    the window. `held` is the number of images of the window in the bag by the rig's stamps, before any correction.
    """

    message: types.Press
    frames: tuple[Frame, ...]
    untouched: tuple[Frame, ...]
    before: tuple[Frame, ...]
    reference: Frame | None
    held: int

    @property
    def window_ns(self) -> tuple[int, int]:
        return stamp_ns(self.message.window_start), stamp_ns(self.message.window_end)


@dataclass
class Span:
    """Successive rig states, at most `STATE_REACH_NS` from one to the next, that all had the tip in the gel, or none.

    A rig that is paused for hours sends states all the time, and adds no span.
    """

    first_ns: int
    last_ns: int
    in_gel: bool

    def goes_on(self, stamp: int, in_gel: bool) -> bool:
        """Whether a state belongs to it."""
        return in_gel == self.in_gel and self.first_ns <= stamp <= self.last_ns + STATE_REACH_NS

    def apart_ns(self, stamp: int) -> int:
        """Time from a stamp to its nearest state, 0 within."""
        return max(self.first_ns - stamp, stamp - self.last_ns, 0)


class Aligner:
    """Takes the messages of one bag, and assembles presses in the order of their messages.

    The messages of a topic must be in order. Those of different topics need not be.
    """

    def __init__(self, clocks: Clocks | None = None) -> None:
        self.odd: Counter[str] = Counter()
        self.clocks = clocks or Clocks()
        self._uncorrected_ns: dict[int, int] = {}
        self._slack_ns = 0
        self._samples: ForceSamples | None = None
        self._frames: dict[int, np.ndarray] = {}
        self._references: dict[int, np.ndarray] = {}
        self._spans: list[Span] = []
        self._waiting: deque[types.Press] = deque()
        self._last_end_ns = self._newest_ns = 0

    def take_image(self, message: types.Image) -> None:
        """Take one image of a window, or from before it."""
        self._newest_ns = max(self._newest_ns, self._keep(message, self._frames, 'images recorded twice'))

    def take_reference(self, message: types.Image) -> None:
        """Take one rest image. The latched image may be repeated in each bag."""
        self._keep(message, self._references, '')

    def take_state(self, message: types.RigState) -> None:
        """Take one position of the tip."""
        stamp, in_gel = stamp_ns(message.header.stamp), message.depth > 0
        if self._spans and self._spans[-1].goes_on(stamp, in_gel):
            self._spans[-1].last_ns = max(self._spans[-1].last_ns, stamp)
        else:
            self._spans.append(Span(stamp, stamp, in_gel))

    def take_sample(self, message: types.WrenchStamped) -> None:
        """Take one force sample of a sensor whose clock is corrected: the force of presses is computed again."""
        self._samples = self._samples or ForceSamples()
        uncorrected_ns = stamp_ns(message.header.stamp)
        corrected_ns = self.clocks.corrected_ns(uncorrected_ns, message.header.frame_id)
        self._samples.take(uncorrected_ns, corrected_ns, message.wrench.force.z)

    def take_press(self, message: types.Press) -> None:
        """Take one finished press."""
        self._waiting.append(message)

    def assembled(self, *, over: bool = False) -> Iterator[RecordedPress]:
        """The presses that are complete by now; `over`: all, because no more images come."""
        while self._waiting and (over or self._is_complete(self._waiting[0])):
            yield self._aligned(self._waiting.popleft())

    def _is_complete(self, message: types.Press) -> bool:
        return len(self._waiting) > 1 and self._newest_ns > stamp_ns(message.window_end)

    @property
    def left_over(self) -> int:
        """Number of images that belong to no press: an interrupted collection leaves some after its last press."""
        return len(self._frames)

    def _keep(self, message: types.Image, kept: dict[int, np.ndarray], twice: str) -> int:
        """Keep an image; returns its stamp."""
        uncorrected_ns = stamp_ns(message.header.stamp)
        stamp = self.clocks.corrected_ns(uncorrected_ns, message.header.frame_id)
        if stamp in kept and twice:
            self.odd[twice] += 1
        try:
            kept.setdefault(stamp, image_array(message))
            self._uncorrected_ns[stamp] = uncorrected_ns
            self._slack_ns = max(self._slack_ns, self.clocks.error_ns(message.header.frame_id))
        except ImageError as error:
            self.odd[f'images that cannot be read ({error})'] += 1
        return stamp

    def _aligned(self, message: types.Press) -> RecordedPress:
        start_ns, end_ns = stamp_ns(message.window_start), stamp_ns(message.window_end)
        stamps = sorted(self._frames)
        inside = self._within(stamps, start_ns, end_ns, message.frames)
        before = [each for each in stamps if self._last_end_ns < each < start_ns and each not in inside]
        untouched = tuple(Frame(each, self._frames[each]) for each in before if self._is_untouched(each))
        if touched := len(before) - len(untouched):
            self.odd['images between windows with the tip in the gel'] += touched
        held = sum(start_ns <= self._uncorrected_ns[each] <= end_ns for each in stamps)
        renewed = message if self._samples is None else self._samples.renewed(message)
        frames = tuple(Frame(each, self._frames[each]) for each in inside)
        pressed = RecordedPress(renewed, frames, untouched, untouched, self._reference_at(start_ns), held)
        self._forget(max([end_ns, *inside]))
        return pressed

    def _within(self, stamps: list[int], start_ns: int, end_ns: int, wanted: int) -> list[int]:
        """Stamps in a window. If some are missing, also stamps that a corrected clock puts right beside it."""
        inside = [each for each in stamps if start_ns <= each <= end_ns]
        beside = [each for each in stamps if 0 < max(start_ns - each, each - end_ns) <= self._slack_ns]
        beside.sort(key=lambda each: max(start_ns - each, each - end_ns))
        return sorted([*inside, *beside[: max(0, wanted - len(inside))]])

    def _is_untouched(self, stamp: int) -> bool:
        """Whether the tip was above the gel, if known. An interrupted press leaves contact images without window."""
        nearest = min(self._spans, key=lambda each: each.apart_ns(stamp), default=None)
        return nearest is None or nearest.apart_ns(stamp) > STATE_REACH_NS or not nearest.in_gel

    def _reference_at(self, stamp: int) -> Frame | None:
        usable = max((each for each in self._references if each <= stamp), default=None)
        if usable is None:
            return None
        self._references = {each: image for each, image in self._references.items() if each >= usable}
        return Frame(usable, self._references[usable])

    def _forget(self, end_ns: int) -> None:
        self._last_end_ns = max(self._last_end_ns, end_ns)
        self._frames = {each: image for each, image in self._frames.items() if each > end_ns}
        self._uncorrected_ns = {each: self._uncorrected_ns[each] for each in self._frames}
        if self._samples is not None:
            self._samples.forget(end_ns)
        self._spans = [each for each in self._spans if each.last_ns > end_ns - STATE_REACH_NS]


class CollectionBag:
    """A bag with presses of one sensor.

    `bag_id` identifies the bag by its content: 12 hexadecimal digits of a SHA-256 over its press messages. It is known
    once all presses were read.

    Raises:
        BagError: it cannot be read.
        NoPressesError: it holds no presses, or no images of them.
        DatasetError: it holds presses of several sensors and none was chosen, or presses of another release.
    """

    def __init__(self, path: Path, namespace: str | None = None, reference: str | None = None) -> None:
        self.path = path
        self.malformed = 0
        self._digest = hashlib.sha256()
        self._reader = BagReader(path)
        try:
            self.clocks = bag_clocks(self._reader, namespace, reference)
            self.aligner = Aligner(self.clocks)
            self._takers = self._chosen(namespace)
            self._require_ours(PRESS.type_name)
        except TactileError:
            self.close()
            raise
        self._press_topic = next(iter(self._takers))

    def __enter__(self) -> CollectionBag:
        return self

    def __exit__(self, *args: object) -> None:
        self.close()

    def close(self) -> None:
        """Close its files."""
        self._reader.close()

    def _chosen(self, namespace: str | None) -> dict[str, Callable[[Any], None]]:
        """The handler for the messages of each topic in the bag."""
        takers: dict[str, Callable[[Any], None]] = {
            self._topic(PRESS, namespace, needed=True): self.aligner.take_press,
            self._topic(PRESS_IMAGE, namespace, needed=True): self.aligner.take_image,
            self._topic(REFERENCE_IMAGE, namespace): self.aligner.take_reference,
            self._topic(RIG_STATE, namespace): self.aligner.take_state,
        }
        if any(clock.corrects for clock in self.clocks.others):
            samples = self._topic(FORCE_TORQUE, namespace)
            if samples and self.clocks.corrects(first_frame(self._reader, [samples], '')):
                takers[samples] = self.aligner.take_sample
        return takers

    @property
    def press_count(self) -> int:
        return self._reader.counts[self._press_topic]

    @property
    def bag_id(self) -> str:
        return self._digest.hexdigest()[:12]

    @property
    def problems(self) -> list[str]:
        """A sentence for each problem in the bag."""
        odd = [f'{fault}: {count}' for fault, count in self.aligner.odd.items()]
        if self.malformed:
            odd.append(f'messages that do not match their type: {self.malformed}')
        if self.aligner.left_over:
            odd.append(f'images after the last press: {self.aligner.left_over}')
        return [*self._reader.problems, *odd]

    def presses(self) -> Iterator[RecordedPress]:
        """All attempts in the bag, in order."""
        for message in self._reader.messages([name for name in self._takers if name]):
            self._take(message)
            yield from self.aligner.assembled()
        yield from self.aligner.assembled(over=True)

    def _take(self, message: BagMessage) -> None:
        try:
            decoded = self._reader.decode(message)
        except MessageError:
            self.malformed += 1
            return
        if message.topic == self._press_topic:
            self._digest.update(message.data)
        self._takers[message.topic](decoded)

    def _require_ours(self, type_name: str) -> None:
        if not self._reader.types.is_ours(type_name):
            raise DatasetError(
                f'{self.path} holds {type_name} as another release defines it; build the data set with the release '
                'that recorded the bag'
            )

    def _topic(self, topic: Topic, namespace: str | None, *, needed: bool = False) -> str:
        found = topics_of(self._reader, topic, namespace)
        if len(found) > 1:
            raise DatasetError(
                f'{self.path} holds the topic {topic.name} of several sensors, {", ".join(found)}; choose one with '
                '--namespace (which a launch does not have: use tactile calibrate instead)'
            )
        if needed and not found:
            raise NoPressesError(
                f'{self.path} holds no topic {topic.name} ({topic.type_name})'
                f'{"" if namespace is None else f" in the namespace {namespace}"}; give a bag of a collection'
            )
        return found[0] if found else ''


def open_bags(
    paths: Sequence[Path],
    stack: ExitStack,
    tell: Callable[[str], None],
    namespace: str | None = None,
    reference: str | None = None,
) -> list[CollectionBag]:
    """The bags with presses; the stack closes them. `tell` names those without, and clocks that cannot be compared.

    A run that ended before its rig was ready leaves such a bag beside those of the runs that pressed.

    Raises:
        BagError, DatasetError: a bag cannot be read or used, or none holds presses.
    """
    opened: list[CollectionBag] = []
    without: list[NoPressesError] = []
    for path in paths:
        try:
            opened.append(stack.enter_context(CollectionBag(path, namespace, reference)))
        except NoPressesError as error:
            without.append(error)
    if without and not opened:
        raise without[0]
    for each in without:
        tell(f'left out: {each}')
    for bag in opened:
        for warning in bag.clocks.warnings:
            tell(f'{bag.path}: {warning}; its stamps are used as they are')
    return opened
