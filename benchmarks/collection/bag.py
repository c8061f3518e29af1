"""The bag of a collection in simulated time: as rig node and recorder write it, but without the bus between them."""

from __future__ import annotations

import struct
from collections import Counter
from pathlib import Path
from typing import Any

from tactile_nodes import conversions, messages
from tactile_nodes.bag.metadata import BagTopic
from tactile_nodes.bag.writer import BagLimits, BagWriter
from tactile_nodes.bus.topics import (
    FORCE_TORQUE,
    PRESS,
    PRESS_IMAGE,
    REFERENCE_IMAGE,
    RIG_STATE,
    ROSOUT,
    SYNC_EDGE,
    Topic,
)
from tactile_nodes.clock import NS_PER_S, Clock, SystemClock
from tactile_nodes.collection.plan.journal import Entry
from tactile_nodes.collection.press.cycle import Record
from tactile_nodes.collection.press.surface import Surface
from tactile_nodes.collection.readings import Picture
from tactile_nodes.collection.run import run_messages
from tactile_nodes.drivers.cnc.contract import CncStatus, Switched
from tactile_nodes.drivers.force_torque.contract import Sample
from tactile_nodes.messages import time_from_ns, types

FILE_BYTES = 2_000_000_000
WAITING_BYTES = 64 << 20  # wait for the disk above this; simulated time stands still meanwhile
SENSOR_FRAME, MACHINE_FRAME, SURFACE_FRAME = 'force_torque_sensor', 'rig', 'gel_surface'
CAMERA_FRAME = 'gel_camera_optical_frame'
HEAD_BYTES, STAMP, WRENCH = 4, struct.Struct('<iI'), struct.Struct('<6d')  # of a WrenchStamped in CDR
RECORDED = (FORCE_TORQUE, RIG_STATE, SYNC_EDGE, PRESS, PRESS_IMAGE, REFERENCE_IMAGE, ROSOUT)


class CollectionBag:
    """Records the measurements of a run.

    Args:
        folder: new folder of the bag.
        clock: simulated clock of the run, for the receive times.
        plan_id: name of the plan.
        indenter: name of the indenter, for the presses.
        gel_mm: the gel's centre in machine coordinates.
        compression: compression of the bag.

    Attributes:
        counts, bytes: messages and their bytes by topic, before compression.

    Raises:
        BagError: the folder exists or cannot be written.
    """

    def __init__(
        self, folder: Path, clock: Clock, plan_id: str, indenter: str, gel_mm: tuple[float, float], compression: str
    ) -> None:
        self.counts: Counter[str] = Counter()
        self.bytes: Counter[str] = Counter()
        self.press = 0
        self.surface: Surface | None = None
        self._clock, self._plan_id, self._indenter, self._gel_mm = clock, plan_id, indenter, gel_mm
        self._edges = 0
        self._sample = bytearray()
        self._writer = BagWriter(folder, compression=compression, limits=BagLimits(file_bytes=FILE_BYTES))
        for topic in RECORDED:
            self._writer.add_topic(
                BagTopic.of_type(_full(topic), topic.type_name, depth=topic.qos.depth, latched=topic.qos.latched)
            )

    def sample(self, sample: Sample) -> None:
        """Add a force sample. Millions of them differ only in stamp and wrench, so only these bytes are replaced."""
        if not self._sample:
            self._sample = bytearray(messages.encode(run_messages.sample_message(sample, SENSOR_FRAME)))
        STAMP.pack_into(self._sample, HEAD_BYTES, *divmod(sample.stamp_ns, NS_PER_S))
        WRENCH.pack_into(self._sample, len(self._sample) - WRENCH.size, *sample.wrench)
        self._put(_full(FORCE_TORQUE), bytes(self._sample))

    def status(self, status: CncStatus) -> None:
        """Add the state of the machine."""
        words = status.state.value
        message = run_messages.state_message(status, self.press, self.surface, self._gel_mm, words, MACHINE_FRAME)
        self._write(RIG_STATE, message)

    def switched(self, switched: Switched) -> None:
        """Add an edge of the digital line."""
        self._edges += 1
        self._write(SYNC_EDGE, run_messages.edge_message(switched, self._edges, MACHINE_FRAME, 'press'))

    def record(self, record: Record) -> None:
        """Add an attempt, with its images."""
        for frame in (*record.rest, *record.frames):
            self._image(PRESS_IMAGE, frame.image, frame.stamp_ns)
        self._write(PRESS, run_messages.press_message(record, self._plan_id, self._indenter, SURFACE_FRAME))
        self._wait_for_the_disk()

    def suspect(self, entry: Entry, reason: str) -> None:
        """Mark a recorded press as suspect."""
        message = run_messages.suspect_message(entry, self._plan_id, reason, self._clock.now_ns(), SURFACE_FRAME)
        self._write(PRESS, message)

    def rest_image(self, image: Picture, at_ns: int) -> None:
        """Add a rest image."""
        self._image(REFERENCE_IMAGE, image, at_ns)

    def say(self, text: str) -> None:
        """Add a log line."""
        stamp = time_from_ns(self._clock.now_ns())
        self._write(ROSOUT, types.Log(stamp=stamp, level=types.Log.INFO, name='rig', msg=text))

    def close(self) -> None:
        """Write the waiting messages. Raises BagError."""
        self._writer.close()

    def _image(self, topic: Topic, image: Picture, stamp_ns: int) -> None:
        self._write(topic, conversions.image_message(image, conversions.header(stamp_ns, CAMERA_FRAME)))

    def _write(self, topic: Topic, message: Any) -> None:
        self._put(_full(topic), messages.encode(message))

    def _put(self, name: str, data: bytes) -> None:
        now_ns = self._clock.now_ns()
        self.counts[name] += 1
        self.bytes[name] += len(data)
        self._writer.write(name, data, now_ns, now_ns, self.counts[name])

    def _wait_for_the_disk(self) -> None:
        given, real = sum(self.bytes.values()), SystemClock()
        while given - self._writer.totals.bytes > WAITING_BYTES and self._writer.failure is None:
            real.sleep_until(real.now_ns() + NS_PER_S // 50)


def _full(topic: Topic) -> str:
    return '/' + topic.name.lstrip('/')
