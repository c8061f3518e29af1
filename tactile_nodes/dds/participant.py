"""One participant of a ROS 2 graph: its writers, its readers, and the nodes that it announces."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from cyclonedds.core import DDSException, Listener, Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from tactile_nodes.bus.protocol import Qos as BusQos
from tactile_nodes.dds.confining import confine, open_sockets
from tactile_nodes.dds.endpoints import CdrReader, CdrWriter, reader_qos, writer_qos
from tactile_nodes.dds.idl_types import idl_type
from tactile_nodes.dds.names import DISCOVERY, PARTICIPANT_DATA, NodeEnds, dds_topic, split_name
from tactile_nodes.dds.sayings import Sayings, cyclone_log
from tactile_nodes.dds.settings import Discovery
from tactile_nodes.errors import BusError
from tactile_nodes.messages import encode, message_class

_ENTITIES, _NODE, _GID = (
    f'rmw_dds_common/msg/{name}' for name in ('ParticipantEntitiesInfo', 'NodeEntitiesInfo', 'Gid')
)
_DISCOVERY_QOS = BusQos('latest', 1, latched=True)


class Participant:
    """Joins the DDS domain `domain_id`; at most one for each process and domain.

    Raises:
        BusError: it cannot be joined.
    """

    def __init__(self, domain_id: int, discovery: Discovery) -> None:
        before = open_sockets()
        self.sayings = Sayings()
        self._log = cyclone_log()
        self._log.lines()  # of an earlier participant
        try:
            with self._log.taken():
                config = discovery.config()
                self._domain = Domain(domain_id, config) if config else None
                self._participant = DomainParticipant(domain_id, Qos(Policy.Userdata(PARTICIPANT_DATA)))
        except DDSException as error:
            raise BusError(
                f'cannot join DDS domain {domain_id} ({"; ".join([str(error), *self._log.lines()])}). '
                'Do 33 participants run on this machine, or another in this process?'
            ) from error
        if discovery.is_local:
            confine(before)
        self._topics: dict[tuple[str, str], Topic[Any]] = {}
        self._announced: Mapping[str, NodeEnds] | None = None
        self._discovery = CdrWriter(self._written(DISCOVERY, _ENTITIES, writer_qos(_ENTITIES, _DISCOVERY_QOS)))

    @property
    def gid(self) -> bytes:
        """Its identifier in the graph."""
        return bytes(self._participant.guid.bytes)

    def writer(self, topic: str, type_name: str, qos: BusQos, lifespan_s: float | None = None) -> CdrWriter:
        """Offer a topic (a full name, '/skin/wrench').

        Raises:
            BusError, MessageError: it cannot be offered.
        """
        return CdrWriter(self._written(dds_topic(topic), type_name, writer_qos(type_name, qos, lifespan_s)))

    def reader(self, topic: str, type_name: str, qos: BusQos, on_data: Callable[[], None]) -> CdrReader:
        """Receive a topic; `on_data` is called in another thread when data have arrived.

        Raises:
            BusError, MessageError: it cannot be received.
        """
        dds = dds_topic(topic)
        try:
            about = self._topic(dds, type_name)
            listener = Listener(on_data_available=lambda _: on_data())
            return CdrReader(DataReader(self._participant, about, reader_qos(type_name, qos), listener))
        except DDSException as error:
            raise BusError(f'cannot receive {topic} over DDS: {error}') from error

    def tell(self, nodes: Mapping[str, NodeEnds]) -> None:
        """Announce the nodes (full names) of this participant, with their readers and writers."""
        if nodes != self._announced:
            self._announced = dict(nodes)
            self._discovery.write(encode(entities_info(self.gid, nodes)))

    def log_lines(self, now_s: float) -> list[str]:
        """The lines of Cyclone's log that are due now."""
        for line in self._log.lines():
            self.sayings.take(line)
        return self.sayings.due(now_s)

    def close(self) -> None:
        """Leave, and inform the others. Writers and readers still held elsewhere are closed too."""
        self._topics.clear()
        self._participant._delete(self._participant._ref)
        self._domain = None

    def _written(self, dds: str, type_name: str, qos: Qos) -> DataWriter[Any]:
        try:
            return DataWriter(self._participant, self._topic(dds, type_name), qos)
        except DDSException as error:
            raise BusError(f'cannot offer {dds} over DDS: {error}') from error

    def _topic(self, dds: str, type_name: str) -> Topic[Any]:
        key = (dds, type_name)
        if key not in self._topics:
            self._topics[key] = Topic(self._participant, dds, idl_type(type_name))
        return self._topics[key]


def entities_info(participant: bytes, nodes: Mapping[str, NodeEnds]) -> Any:
    """The announcement of a participant: a rmw_dds_common/ParticipantEntitiesInfo, with gids of 16 bytes (Jazzy)."""
    announced = [
        message_class(_NODE)(
            *split_name(name), [_gid(end) for end in ends.readers], [_gid(end) for end in ends.writers]
        )
        for name, ends in sorted(nodes.items())
    ]
    return message_class(_ENTITIES)(_gid(participant), announced)


def _gid(data: bytes) -> Any:
    return message_class(_GID)(np.frombuffer(data, np.uint8))
