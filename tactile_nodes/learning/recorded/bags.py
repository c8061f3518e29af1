"""Collection bags in, presses with their images out: what belongs together by its capture stamps.

A bag is read once, as a stream, and holds more images than memory does, so a press is put together as soon as the
next one is told, and what lies before it is forgotten. Receive times say nothing here; only stamps do, brought to the
rig's clock first where a recorder had another (`clocks`).
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from jaxtyping import UInt8

from tactile_nodes.bag.content import BagMessage
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bus.topics import FORCE_TORQUE, PRESS, PRESS_IMAGE, REFERENCE_IMAGE, RIG_STATE, Topic
from tactile_nodes.conversions import image_array
from tactile_nodes.errors import DatasetError, ImageError, MessageError, TactileError
from tactile_nodes.learning.recorded.clocks import Clocks, bag_clocks
from tactile_nodes.learning.recorded.forces import ForceSamples
from tactile_nodes.messages import stamp_ns, types

STATE_REACH_NS = 500_000_000
"""A rig state older or newer than this says nothing of where the tip was when an image was taken."""


@dataclass(frozen=True)
class Frame:
    """An image and when it was captured, on the rig's clock."""

    stamp_ns: int
    image: UInt8[np.ndarray, 'h w']


@dataclass(frozen=True)
class RecordedPress:
    """One attempt as a bag tells it, with the images of its window in order of their stamps.

    `untouched` are the images between the window before and this one, in which nothing touches the gel.
    `reference` is the last rest image from before the window. `held` counts the images that the bag holds of the window
    by the stamps that the rig saw, before any correction.
    """

    told: types.Press
    frames: tuple[Frame, ...]
    untouched: tuple[Frame, ...]
    reference: Frame | None
    held: int

    @property
    def window_ns(self) -> tuple[int, int]:
        return stamp_ns(self.told.window_start), stamp_ns(self.told.window_end)


class Aligner:
    """Takes the messages of one bag in any order within a press, and gives the presses in the order they were told."""

    def __init__(self, clocks: Clocks | None = None) -> None:
        self.odd: Counter[str] = Counter()
        self.clocks = clocks or Clocks()
        self._told_ns: dict[int, int] = {}
        self._slack_ns = 0
        self._samples: ForceSamples | None = None
        self._frames: dict[int, np.ndarray] = {}
        self._references: dict[int, np.ndarray] = {}
        self._depths: dict[int, float] = {}
        self._waiting: types.Press | None = None
        self._last_end_ns = 0

    def take_image(self, message: types.Image) -> None:
        """One image of a window, or from before it."""
        self._keep(message, self._frames, 'images recorded twice')

    def take_reference(self, message: types.Image) -> None:
        """One rest image; the latched one may come again in each bag."""
        self._keep(message, self._references, '')

    def take_state(self, message: types.RigState) -> None:
        """Where the tip was."""
        self._depths[stamp_ns(message.header.stamp)] = message.depth

    def take_sample(self, message: types.WrenchStamped) -> None:
        """One force sample of a sensor whose clock is corrected: presses get their force anew."""
        self._samples = self._samples or ForceSamples()
        told_ns = stamp_ns(message.header.stamp)
        corrected_ns = self.clocks.corrected_ns(told_ns, message.header.frame_id)
        self._samples.take(told_ns, corrected_ns, message.wrench.force.z)

    def take_press(self, message: types.Press) -> RecordedPress | None:
        """One press that is over; returns the one before, for which nothing more is to come."""
        finished = self.finish()
        self._waiting = message
        return finished

    def finish(self) -> RecordedPress | None:
        """The press that still waits for images, if there is one."""
        if self._waiting is None:
            return None
        finished, self._waiting = self._aligned(self._waiting), None
        return finished

    @property
    def left_over(self) -> int:
        """Images that belong to no press: those after the last one, as an interrupted collection leaves them."""
        return len(self._frames)

    def _keep(self, message: types.Image, kept: dict[int, np.ndarray], twice: str) -> None:
        told_ns = stamp_ns(message.header.stamp)
        stamp = self.clocks.corrected_ns(told_ns, message.header.frame_id)
        if stamp in kept and twice:
            self.odd[twice] += 1
        try:
            kept.setdefault(stamp, image_array(message))
            self._told_ns[stamp] = told_ns
            self._slack_ns = max(self._slack_ns, self.clocks.error_ns(message.header.frame_id))
        except ImageError as error:
            self.odd[f'images that cannot be read ({error})'] += 1

    def _aligned(self, told: types.Press) -> RecordedPress:
        start_ns, end_ns = stamp_ns(told.window_start), stamp_ns(told.window_end)
        stamps = sorted(self._frames)
        inside = self._within(stamps, start_ns, end_ns, told.frames)
        before = [each for each in stamps if self._last_end_ns < each < start_ns and each not in inside]
        untouched = tuple(Frame(each, self._frames[each]) for each in before if self._is_untouched(each))
        if touched := len(before) - len(untouched):
            self.odd['images between windows with the tip in the gel'] += touched
        held = sum(start_ns <= self._told_ns[each] <= end_ns for each in stamps)
        renewed = told if self._samples is None else self._samples.renewed(told)
        frames = tuple(Frame(each, self._frames[each]) for each in inside)
        pressed = RecordedPress(renewed, frames, untouched, self._reference_at(start_ns), held)
        self._forget(max([end_ns, *inside]))
        return pressed

    def _within(self, stamps: list[int], start_ns: int, end_ns: int, wanted: int) -> list[int]:
        """Those in a window; if some are missing, also those that a corrected clock puts just beside it."""
        inside = [each for each in stamps if start_ns <= each <= end_ns]
        beside = [each for each in stamps if 0 < max(start_ns - each, each - end_ns) <= self._slack_ns]
        beside.sort(key=lambda each: max(start_ns - each, each - end_ns))
        return sorted([*inside, *beside[: max(0, wanted - len(inside))]])

    def _is_untouched(self, stamp: int) -> bool:
        """Whether the tip was above the gel, as far as told; a press cut short leaves images of it without a window."""
        nearest = min(self._depths, key=lambda each: abs(each - stamp), default=None)
        if nearest is None or abs(nearest - stamp) > STATE_REACH_NS:
            return True
        return not self._depths[nearest] > 0

    def _reference_at(self, stamp: int) -> Frame | None:
        usable = max((each for each in self._references if each <= stamp), default=None)
        if usable is None:
            return None
        self._references = {each: image for each, image in self._references.items() if each >= usable}
        return Frame(usable, self._references[usable])

    def _forget(self, end_ns: int) -> None:
        self._last_end_ns = max(self._last_end_ns, end_ns)
        self._frames = {each: image for each, image in self._frames.items() if each > end_ns}
        self._told_ns = {each: self._told_ns[each] for each in self._frames}
        if self._samples is not None:
            self._samples.forget(end_ns)
        self._depths = {each: depth for each, depth in self._depths.items() if each > end_ns - STATE_REACH_NS}


class CollectionBag:
    """A bag with presses in it, of one sensor.

    `bag_id` names it by what it tells: 12 hexadecimal digits of a SHA-256 over its press messages; known once all
    presses were read.

    Raises:
        BagError: it cannot be read.
        DatasetError: it holds no presses, or those of several sensors and none was chosen.
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

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Close its files."""
        self._reader.close()

    def _chosen(self, namespace: str | None) -> dict[str, Callable[[Any], RecordedPress | None]]:
        """What takes the messages of each topic that is there."""
        takers: dict[str, Callable[[Any], RecordedPress | None]] = {
            self._topic(PRESS, namespace, needed=True): self.aligner.take_press,
            self._topic(PRESS_IMAGE, namespace, needed=True): self.aligner.take_image,
            self._topic(REFERENCE_IMAGE, namespace): self.aligner.take_reference,
            self._topic(RIG_STATE, namespace): self.aligner.take_state,
        }
        if any(clock.corrects for clock in self.clocks.others):
            samples = self._topic(FORCE_TORQUE, namespace)
            if samples and self.clocks.corrects(self._frame_of(samples)):
                takers[samples] = self.aligner.take_sample
        return takers

    def _frame_of(self, topic: str) -> str:
        """The frame of a topic's first message."""
        first = next(self._reader.messages([topic]), None)
        return '' if first is None else str(self._reader.decode(first).header.frame_id)

    @property
    def press_count(self) -> int:
        return self._reader.counts[self._press_topic]

    @property
    def bag_id(self) -> str:
        return self._digest.hexdigest()[:12]

    @property
    def problems(self) -> list[str]:
        """A sentence for each thing in the bag that is not as it should be."""
        odd = [f'{count} {what}' for what, count in self.aligner.odd.items()]
        if self.malformed:
            odd.append(f'{self.malformed} messages that do not match their type')
        if self.aligner.left_over:
            odd.append(f'{self.aligner.left_over} images after the last press')
        return [*self._reader.problems, *odd]

    def presses(self) -> Iterator[RecordedPress]:
        """Every attempt that the bag tells of, in its order."""
        for message in self._reader.messages([name for name in self._takers if name]):
            if finished := self._take(message):
                yield finished
        if finished := self.aligner.finish():
            yield finished

    def _take(self, message: BagMessage) -> RecordedPress | None:
        try:
            decoded = self._reader.decode(message)
        except MessageError:
            self.malformed += 1
            return None
        if message.topic == self._press_topic:
            self._digest.update(message.data)
        return self._takers[message.topic](decoded)

    def _require_ours(self, type_name: str) -> None:
        if not self._reader.types.is_ours(type_name):
            raise DatasetError(
                f'{self.path} holds {type_name} as another release defines it; build the data set with the release '
                'that recorded the bag'
            )

    def _topic(self, topic: Topic, namespace: str | None, *, needed: bool = False) -> str:
        wanted = None if namespace is None else '/'.join(['', *filter(None, namespace.split('/')), topic.name])
        found = sorted(
            name
            for name, described in self._reader.topics.items()
            if described.type_name == topic.type_name
            and name.rpartition('/')[2] == topic.name
            and wanted in (None, name)
        )
        if len(found) > 1:
            raise DatasetError(
                f'{self.path} holds the topic {topic.name} of several sensors, {", ".join(found)}; choose one with '
                '--namespace'
            )
        if needed and not found:
            raise DatasetError(
                f'{self.path} holds no topic {wanted or topic.name} ({topic.type_name}); give a bag of a collection'
            )
        return found[0] if found else ''
