"""A bag as the source of an export: its topics, each message with its stamp, and facts about the whole."""

from __future__ import annotations

import hashlib
from array import array
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from tactile_nodes import __version__
from tactile_nodes.bag.compare import find_topic
from tactile_nodes.bag.content import BagMessage
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bus.topics import FORCE_DISTRIBUTION, FORCE_FIELD, HAND_WRENCH
from tactile_nodes.errors import BagError, ImageError, MessageError
from tactile_nodes.exporting.columns import IMAGE_TYPE, Layout
from tactile_nodes.exporting.resampling import Horizon
from tactile_nodes.exporting.units import SIGNS, STATUS
from tactile_nodes.learning.progress import Bar
from tactile_nodes.messages import types

NOT_TABLES = {
    'sensor_msgs/msg/CompressedImage': 'a compressed image',
    'sensor_msgs/msg/CameraInfo': 'constant',
    'sensor_msgs/msg/PointCloud2': 'a point cloud',
    'tactile_nodes/msg/FlowFeatures': 'large; add it with --topics',
    'tactile_nodes/msg/ForceTorqueCounts': 'lists of any length',
    'tactile_nodes/msg/SerialTraffic': 'bytes of any length',
    'diagnostic_msgs/msg/DiagnosticArray': 'texts',
    'rcl_interfaces/msg/Log': 'texts',
    'rosgraph_msgs/msg/Clock': 'no data',
}
"""Types that are exported only on request, and why."""

TELL_EVERY = 256
_FORCES = (FORCE_DISTRIBUTION.type_name, FORCE_FIELD.type_name)


@dataclass(frozen=True)
class StampedMessage:
    """One message: `stamp_ns` from its header (capture), or when it was published if it has none."""

    topic: str
    stamp_ns: int
    received_ns: int
    message: Any


@dataclass
class Provenance:
    """What the messages of a bag state about their origin, collected while they are read."""

    rows: Counter[str] = field(default_factory=Counter)
    malformed: Counter[str] = field(default_factory=Counter)
    status: Counter[int] = field(default_factory=Counter)
    made_with: dict[str, set[str]] = field(default_factory=dict)
    frames: dict[str, set[str]] = field(default_factory=dict)

    def take(self, stamped: StampedMessage, is_force: bool) -> None:
        """Count one message."""
        self.rows[stamped.topic] += 1
        header = getattr(stamped.message, 'header', None)
        self.frames.setdefault(stamped.topic, set()).add(getattr(header, 'frame_id', ''))
        if is_force:
            self.status[int(stamped.message.status)] += 1
            for name in ('model', 'model_id', 'calibration_id', 'gel', 'reference_id', 'tare_id'):
                found = getattr(stamped.message.provenance, name, '')
                self.made_with.setdefault(name, set()).update({found} if found else ())


class Source:
    """A bag opened for export. `layouts` holds the columns of each topic that is exported.

    Raises:
        BagError: it cannot be read, lacks a requested topic, or holds nothing to export.
    """

    def __init__(
        self, path: Path, topics: Sequence[str] = (), exclude: Sequence[str] = (), *, images: bool = False
    ) -> None:
        self.left_out: dict[str, str] = {}
        self.layouts: dict[str, Layout] = {}
        self.provenance = Provenance()
        self._digest = hashlib.sha256()
        self.bag = BagReader(path)
        try:
            self._choose(topics, exclude, images)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Source:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Close the bag."""
        self.bag.close()

    @property
    def count(self) -> int:
        """The number of messages to read."""
        return sum(self.bag.counts.get(topic, 0) for topic in self.layouts)

    def stamps_ns(self, topic: str) -> list[int]:
        """The stamps of a topic in rising order, read without decoding."""
        return sorted(self._stamp_ns(message) for message in self.bag.messages([topic]))

    def first_stamps_ns(self, topics: Iterable[str]) -> dict[str, int]:
        """The earliest stamp of each topic among its messages that can be read."""
        found: dict[str, int] = {}
        for message in self.bag.messages(topics):
            stamp_ns = self._stamp_ns(message)
            if stamp_ns < found.get(message.topic, stamp_ns + 1) and self._is_readable(message):
                found[message.topic] = stamp_ns
        return found

    def _stamp_ns(self, message: BagMessage) -> int:
        found = self.bag.stamp_ns(message)
        return message.publish_ns if found is None else found

    def _is_readable(self, message: BagMessage) -> bool:
        try:
            self.bag.decode(message)
        except MessageError:
            return False
        return True

    def horizon(self, start_ns: int) -> Horizon:
        """The horizon of all messages stamped from `start_ns` on, read without decoding.

        Latched topics do not count: an old message may come whenever its publisher restarts.
        """
        lasting = [topic for topic in self.layouts if not self.bag.topics[topic].latched]
        received_ns, stamps_ns = array('q'), array('q')
        for message in self.bag.messages(lasting):
            if (stamp_ns := self._stamp_ns(message)) >= start_ns:
                received_ns.append(message.log_ns)
                stamps_ns.append(stamp_ns)
        return Horizon(np.array(received_ns, np.int64), np.array(stamps_ns, np.int64))

    def messages(self, bar: Bar) -> Iterator[StampedMessage]:
        """Every readable message of the exported topics, in the order received; `bar` counts those that were read."""
        self.provenance, self._digest = Provenance(), hashlib.sha256()
        for count, message in enumerate(self.bag.messages(self.layouts), 1):
            if count % TELL_EVERY == 0:
                bar.advance(TELL_EVERY)
            try:
                decoded = self.bag.decode(message)
            except MessageError:
                self.provenance.malformed[message.topic] += 1
                continue
            self._digest.update(message.topic.encode() + b'\0' + message.data)
            found = StampedMessage(message.topic, self._stamp_ns(message), message.log_ns, decoded)
            self.provenance.take(found, self.layouts[message.topic].is_force)
            yield found
        bar.advance(self.count % TELL_EVERY)

    def facts(self) -> dict[str, Any]:
        """The facts about the messages read; complete once all were read."""
        provenance = self.provenance
        return {
            'made_by': f'tactile_nodes {__version__}',
            'bag': self.bag.path.resolve().name,
            'data_fingerprint': self._digest.hexdigest()[:12],
            'signs': SIGNS,
            'status': STATUS,
            'force_messages_of_status': {str(status): count for status, count in sorted(provenance.status.items())},
            **{name: sorted(found) for name, found in provenance.made_with.items()},
            'topics': {topic: self._topic_facts(layout) for topic, layout in self.layouts.items()},
            'topics_left_out': self.left_out,
            'malformed_messages': dict(provenance.malformed),
            'problems': self.bag.problems,
        }

    def _topic_facts(self, layout: Layout) -> dict[str, Any]:
        stamped = self.bag.types.starts_with_header(layout.type_name)
        return {
            'type': layout.type_name,
            'rows': self.provenance.rows[layout.topic],
            'stamp': 'capture, from the header' if stamped else 'time of publication, as it has no header',
            'frames': sorted(self.provenance.frames.get(layout.topic, ())),
            'units': {column.name: column.unit for column in layout.columns if column.unit},
            'constant': {name: texts for name, (_, texts) in layout.constant.items()},
            'fields_left_out': {**layout.left_out, **dict.fromkeys(layout.empty, 'empty in every message')},
        }

    # --- choosing -------------------------------------------------------------------------------------------

    def _choose(self, topics: Sequence[str], exclude: Sequence[str], images: bool) -> None:
        named = {find_topic(self.bag, topic) for topic in topics}
        unwanted = {find_topic(self.bag, topic) for topic in exclude}
        for name, described in sorted(self.bag.topics.items()):
            if reason := self._reason_against(name, described.type_name, named, unwanted, images):
                self.left_out[name] = reason
            else:
                self._lay_out(name)
        if not self.layouts:
            without = ', '.join(f'{name} ({reason})' for name, reason in self.left_out.items())
            raise BagError(f'{self.bag.path} contains nothing to export: {without or "no topics"}')

    def _reason_against(self, name: str, kind: str, named: set[str], unwanted: set[str], images: bool) -> str:
        if name in unwanted or (named and name not in named and not (images and kind == IMAGE_TYPE)):
            return 'not requested'
        if kind == IMAGE_TYPE and not images:
            return 'images; with --images zarr holds them, lerobot those of 8 bits'
        return '' if name in named else NOT_TABLES.get(kind, '')

    def _lay_out(self, name: str) -> None:
        """Set the columns of a topic by its first message with a content; of forces, the first that is not invalid."""
        reason, sensors = 'no messages', self._sensors(name)
        for message in self.bag.messages([name]):
            try:
                first = self.bag.decode(message)
                if _is_empty(first, message.type_name):
                    reason = 'empty in every message'
                    continue
                is_invalid = _is_invalid(first, message.type_name)
                if name not in self.layouts or not is_invalid:
                    self.layouts[name] = Layout.of(name, message.type_name, first, sensors)
                if not is_invalid:
                    return
            except (MessageError, ImageError) as error:
                reason = str(error)
        if name not in self.layouts:
            self.left_out[name] = reason

    def _sensors(self, name: str) -> list[str]:
        """All sensors named in the messages of a hand's wrench, in the sum or missing; none for other topics."""
        found: set[str] = set()
        if self.bag.topics[name].type_name == HAND_WRENCH.type_name:
            for message in self.bag.messages([name]):
                with suppress(MessageError):  # counted when the rows are read
                    decoded = self.bag.decode(message)
                    found.update(decoded.sensors, decoded.missing)
        return sorted(found)


def _is_empty(message: Any, type_name: str) -> bool:
    """Whether a force or a picture has no size. It was published before the size was known; a later one has it."""
    if type_name in _FORCES:
        return not message.rows * message.cols
    return type_name == IMAGE_TYPE and not message.height * message.width


def _is_invalid(message: Any, type_name: str) -> bool:
    """Whether a force is marked invalid."""
    return type_name in _FORCES and bool(message.status == types.ForceDistribution.STATUS_INVALID)
