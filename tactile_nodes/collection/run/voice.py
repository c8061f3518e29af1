"""Publishes the measurements of a run, each as a message on its topic."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from tactile_nodes import conversions
from tactile_nodes.bus.protocol import Publisher
from tactile_nodes.bus.topics import (
    FORCE_TORQUE,
    FORCE_TORQUE_COUNTS,
    PRESS,
    PRESS_IMAGE,
    REFERENCE_IMAGE,
    RIG_STATE,
    SERIAL_TRAFFIC,
    SYNC_EDGE,
    Topic,
)
from tactile_nodes.clock import Clock
from tactile_nodes.collection.plan.journal import Entry
from tactile_nodes.collection.plan.plan import Point
from tactile_nodes.collection.press.cycle import Record
from tactile_nodes.collection.press.surface import Surface
from tactile_nodes.collection.readings import Picture
from tactile_nodes.collection.run import run_messages
from tactile_nodes.collection.run.run_messages import Batch, counts_message
from tactile_nodes.drivers.cnc.contract import CncStatus, Switched
from tactile_nodes.drivers.force_torque.contract import Sample

TOPICS = (FORCE_TORQUE, FORCE_TORQUE_COUNTS, SERIAL_TRAFFIC, RIG_STATE, SYNC_EDGE, PRESS, PRESS_IMAGE, REFERENCE_IMAGE)
LINE = 'press'
MOST_TRAFFIC = 20_000  # pieces that wait for a subscriber: some minutes
BETWEEN = 0  # press number in the rig's state while there is no press

Piece = tuple[str, int, bytes]
"""Bytes as they were sent and received, see `drivers.cnc.contract.Traffic`."""


@dataclass(frozen=True)
class Names:
    """Names in messages: frames, plan, indenter, the source of the force samples, the port of the machine."""

    sensor_frame: str
    machine_frame: str
    surface_frame: str
    camera_frame: str
    plan_id: str
    indenter: str
    source: str
    port: str = ''


class Voice:
    """Publishes the measurements of a run.

    Args:
        publishers: one for each of `TOPICS`.
        names: frames and names in the messages.
        clock: the host's.
        gel_mm: the gel's centre in machine coordinates.
        warn: receives warnings for a person about data that was not recorded.
    """

    def __init__(
        self,
        publishers: dict[Topic, Publisher],
        names: Names,
        clock: Clock,
        gel_mm: tuple[float, float],
        warn: Callable[[str], None],
    ) -> None:
        self._publishers = publishers
        self._names = names
        self._clock = clock
        self._gel_mm = gel_mm
        self._warn = warn
        self._edges = 0
        self._batch = Batch()
        self._traffic: deque[Piece] = deque()
        self._traffic_dropped = self._traffic_warned = 0  # bytes
        self._publishing_traffic = threading.Lock()
        self.unheard_ns = 0
        """Stamp of the last force sample without a subscriber."""

    @property
    def is_recorded(self) -> bool:
        """Whether all topics of a press have subscribers."""
        return all(self._publishers[topic].listeners for topic in (PRESS, PRESS_IMAGE, FORCE_TORQUE))

    def sample(self, sample: Sample) -> None:
        publisher = self._publishers[FORCE_TORQUE]
        if not publisher.listeners:
            self.unheard_ns = sample.stamp_ns
        publisher.publish(run_messages.sample_message(sample, self._names.sensor_frame))
        self._count(self._batch.add(sample))
        self._tell_traffic()

    def passed(self, way: str, stamp_ns: int, data: bytes) -> None:
        """Bytes to or from the machine (`Traffic`); only stored here, because the sender of a stop must not wait.

        Called by one thread at a time. If too many pieces wait, the oldest is dropped.
        """
        if len(self._traffic) >= MOST_TRAFFIC:
            self._traffic_dropped += len(self._traffic.popleft()[2])
        self._traffic.append((way, stamp_ns, data))

    def the_rest(self) -> None:
        """Publish the remaining samples and bytes, after the devices were closed."""
        self._count(self._batch.rest())
        self._tell_traffic()
        self._warn_of_dropped()

    def status(self, status: CncStatus, now: Point | None, surface: Surface | None) -> None:
        """Publish the state of the machine, and the current press."""
        press = BETWEEN if now is None else now.press
        words, frame = status.state.value, self._names.machine_frame
        message = run_messages.state_message(status, press, surface, self._gel_mm, words, frame)
        self._publishers[RIG_STATE].publish(message)
        self._tell_traffic()

    def switched(self, switched: Switched) -> None:
        self._edges += 1
        edge = run_messages.edge_message(switched, self._edges, self._names.machine_frame, LINE)
        self._publishers[SYNC_EDGE].publish(edge)

    def record(self, record: Record) -> None:
        """Publish an attempt, after its images."""
        for frame in (*record.rest, *record.frames):
            self._image(PRESS_IMAGE, frame.image, frame.stamp_ns)
        names = self._names
        self._publishers[PRESS].publish(
            run_messages.press_message(record, names.plan_id, names.indenter, names.surface_frame)
        )

    def suspect(self, entry: Entry, reason: str) -> None:
        names, now_ns = self._names, self._clock.now_ns()
        message = run_messages.suspect_message(entry, names.plan_id, reason, now_ns, names.surface_frame)
        self._publishers[PRESS].publish(message)

    def rest_image(self, image: Picture, at_ns: int) -> None:
        self._image(REFERENCE_IMAGE, image, at_ns)

    def _count(self, samples: Sequence[Sample]) -> None:
        if samples:
            message = counts_message(samples, self._names.sensor_frame, self._names.source)
            self._publishers[FORCE_TORQUE_COUNTS].publish(message)

    def _tell_traffic(self) -> None:
        """Publish the stored bytes once there is a subscriber, also those of opening the machine."""
        publisher, names = self._publishers[SERIAL_TRAFFIC], self._names
        with self._publishing_traffic:
            if publisher.listeners:
                self._warn_of_dropped()
            while publisher.listeners and self._traffic:
                way, stamp_ns, data = self._traffic.popleft()
                publisher.publish(
                    run_messages.traffic_message(way == '>', stamp_ns, data, names.port, names.machine_frame)
                )

    def _warn_of_dropped(self) -> None:
        """Warn of dropped bytes; called when there is a subscriber again, or when the run is over."""
        if dropped := self._traffic_dropped - self._traffic_warned:
            self._traffic_warned += dropped
            self._warn(
                f'{dropped} bytes to or from the machine were not recorded: {SERIAL_TRAFFIC.name} had no subscriber, '
                f'and at most {MOST_TRAFFIC} pieces are buffered; start the recorder earlier'
            )

    def _image(self, topic: Topic, image: Picture, stamp_ns: int) -> None:
        head = conversions.header(stamp_ns, self._names.camera_frame)
        self._publishers[topic].publish(conversions.image_message(image, head))
