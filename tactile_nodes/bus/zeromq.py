"""The bus between the processes of one host, over ZeroMQ sockets that only this user can reach.

Every publisher has a socket of its own (ipc://), so a topic's queue never stands behind another's and each keeps the
length that the topic table gives it. A full queue drops; it never makes the publisher wait. One thread a process
receives, answers calls and follows who comes and goes; publishing happens in the caller's thread.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import zmq

from tactile_nodes.bus import wire
from tactile_nodes.bus.calls import CallServer, call_remote, ping_remote
from tactile_nodes.bus.discovery import Meeting, Record, domain_from_environment
from tactile_nodes.bus.inprocess import InProcessBus, LocalPublisher
from tactile_nodes.bus.protocol import Graph, Qos, Received, ServiceHandler
from tactile_nodes.bus.receiving import SHORTEST_QUEUE, ZERO_COPY_BYTES, Hub
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.clock import Clock
from tactile_nodes.errors import BusError, ServiceUnavailableError

_LINGER_MS = 200  # so that the last message of a process that ends still leaves


class ZmqBus(InProcessBus):
    """`Bus` over ZeroMQ; what stays inside the process is handed over as it is."""

    def __init__(self, domain_id: int | None = None, clock: Clock | None = None, folder: Path | None = None) -> None:
        super().__init__(clock)
        self.domain_id = domain_from_environment() if domain_id is None else domain_id
        self.meeting = Meeting(self.uid, self.domain_id, folder)
        self.context = zmq.Context()
        self.context.set(zmq.MAX_SOCKETS, 8192)
        self.foreign = 0
        self._hub = Hub(self)
        self._server = CallServer(self.context, self.meeting.socket_address(0), self._find_service, self._hub)
        self._announce()
        self._hub.start()

    # --- topics ---------------------------------------------------------------------------------------------

    def advertise(self, topic: str, type_name: str, qos: Qos, node: str = '') -> ZmqPublisher:
        publisher = ZmqPublisher(self, topic, type_name, qos, node)
        with self._lock:
            self._check_open()
            self._publishers.append(publisher)
        self._changed()
        return publisher

    def wanted(self) -> dict[tuple[str, str], int]:
        """The topics and types that this process receives, with the longest queue somebody wants."""
        with self._lock:
            found: dict[tuple[str, str], int] = {}
            for entries in self._subscriptions.values():
                for entry in entries:
                    key = (entry.topic, entry.type_name)
                    found[key] = max(found.get(key, 0), entry.qos.depth)
            return found

    def subscriptions_of(self, topic: str, type_name: str) -> list[Subscription]:
        """This process's subscriptions of a topic and type."""
        return [entry for entry in self._subscriptions.get(topic, ()) if entry.type_name == type_name]

    # --- services -------------------------------------------------------------------------------------------

    def call(self, service: str, type_name: str, request: Any, timeout_s: float = 5.0) -> Any:
        if service in self._services:
            return super().call(service, type_name, request, timeout_s)
        for record in self.peers():
            if any(offer.name == service for offer in record.participant.services):
                is_alive = partial(self._meets, record.participant.uid)
                address = record.service_address
                return call_remote(self.context, address, service, type_name, request, timeout_s, is_alive)
        raise ServiceUnavailableError(f'nobody serves {service}; see which services there are: tactile service list')

    def ping(self, uid: str, timeout_s: float = 1.0) -> float | None:
        """The seconds that a participant took to answer; None when it is alive but does not, or is gone."""
        for record in self.peers():
            if record.participant.uid == uid:
                return ping_remote(self.context, record.service_address, timeout_s)
        return 0.0 if uid == self.uid else None

    # --- the graph ------------------------------------------------------------------------------------------

    def graph(self) -> Graph:
        return Graph((self.own_participant(), *(record.participant for record in self.peers())))

    def peers(self) -> list[Record]:
        """All living participants but this one."""
        return self.meeting.look()

    def close(self) -> None:
        if self._closed:
            return
        super().close()
        self._hub.stop()
        self._server.close()
        self.context.destroy(linger=_LINGER_MS)
        self.meeting.leave()

    def greet_newcomers(self) -> None:
        """Have latched publishers give their last message to those who came since."""
        with self._lock:
            latched = [entry for entry in self._publishers if isinstance(entry, ZmqPublisher) and entry.qos.latched]
        for publisher in latched:
            publisher.greet()

    def _meets(self, uid: str) -> bool:
        return any(record.participant.uid == uid for record in self.peers())

    def _changed(self) -> None:
        if not self._closed:
            self._announce()
            self._hub.look_soon()

    def _announce(self) -> None:
        with self._lock:
            publishers = [entry for entry in self._publishers if isinstance(entry, ZmqPublisher)]
            record = Record(
                self.own_participant(),
                {entry.gid: entry.address for entry in publishers},
                tuple(entry.gid for entry in publishers),
                self._server.address,
            )
            self.meeting.announce(record)

    def _find_service(self, name: str, type_name: str) -> ServiceHandler | None:
        offered = self._services.get(name)
        return offered.handler if offered and offered.type_name == type_name else None


class ZmqPublisher(LocalPublisher):
    """Publishes to this process and, when somebody there listens, to the others."""

    def __init__(self, bus: ZmqBus, topic: str, type_name: str, qos: Qos, node: str) -> None:
        super().__init__(bus, topic, type_name, qos, node)
        self._key = wire.type_key(type_name)
        self._listeners = 0
        self._shut = False
        self.address = bus.meeting.socket_address(int(self.gid.rpartition('.')[2]))
        self._socket = bus.context.socket(zmq.XPUB)
        self._socket.set(zmq.SNDHWM, max(qos.depth, SHORTEST_QUEUE))
        self._socket.set(zmq.LINGER, _LINGER_MS)
        self._socket.set(zmq.XPUB_VERBOSER, 1)  # every coming and going is told, not only the first and the last
        self._socket.bind(self.address)

    def close(self) -> None:
        with self._lock:
            if self._shut:
                return
            self._shut = True
            self._socket.close()
        super().close()

    @property
    def listeners(self) -> int:
        """How many would get what is published now: subscriptions of this process, and other processes."""
        self.greet()  # whom we count here, a later look would not take for a newcomer
        return self._listeners + super().listeners

    def greet(self) -> None:
        """Give a latched message to listeners that have come since; the others recognise its number."""
        with self._lock:
            if self._shut:
                return
            before = self._listeners
            self._count_listeners()
            if self._listeners > before and self.last is not None:
                self._transmit(self.last)

    def _send_beyond(self, received: Received) -> None:
        if self._shut:
            raise BusError(f'the publisher of {self.topic} is closed')
        self._count_listeners()
        if self._listeners > 0:
            self._transmit(received)

    def _transmit(self, received: Received) -> None:
        header = wire.pack_header(self.gid, self._key, received.sequence, received.source_ns)
        data = received.data
        self._socket.send(header, zmq.SNDMORE)
        self._socket.send(data, 0, len(data) < ZERO_COPY_BYTES)

    def _count_listeners(self) -> None:
        while int(self._socket.get(zmq.EVENTS)) & zmq.POLLIN:
            self._listeners += 1 if self._socket.recv()[:1] == b'\x01' else -1
