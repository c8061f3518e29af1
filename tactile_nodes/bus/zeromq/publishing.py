"""The publishing half of the ZeroMQ bus: a socket a topic, used in the thread of whoever publishes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import zmq

from tactile_nodes.bus.inprocess import LocalPublisher
from tactile_nodes.bus.protocol import Qos, Received
from tactile_nodes.bus.zeromq import wire
from tactile_nodes.bus.zeromq.calls import bind_again
from tactile_nodes.bus.zeromq.receiving import SHORTEST_QUEUE
from tactile_nodes.bus.zeromq.records import Outlet
from tactile_nodes.bus.zeromq.sockets import Longest, longest_message, open_socket
from tactile_nodes.errors import BusError, MessageError

if TYPE_CHECKING:
    from tactile_nodes.bus.zeromq.host_bus import ZmqBus

LARGE_BYTES = 65536  # below, a copy is cheaper than a second frame
_WORDS_AT_ONCE = 100  # of subscribers: so many that come together are noticed at one look, others at the next
_WORDS = 1  # of one subscriber that wait: who says ten thousand at once shall not hold up what is published
_LINGER_MS = 200  # so that the last message of a process that ends still leaves


class ZmqPublisher(LocalPublisher):
    """Publishes to this process and, when somebody there listens, to the others."""

    def __init__(self, bus: ZmqBus, topic: str, type_name: str, qos: Qos, node: str) -> None:
        super().__init__(bus, topic, type_name, qos, node)
        self._meeting = bus.meeting
        self._key = wire.type_key(type_name)
        self._longest = longest_message(type_name)
        self._sender = self.gid.encode()
        self._listeners = 0
        self.address = self._meeting.socket_address(self.number)
        try:
            self._socket = _bound(bus.context, self.address, max(qos.depth, SHORTEST_QUEUE))
        except zmq.ZMQError as error:
            raise BusError(f'cannot publish {topic} at {self.address}: {error.strerror}') from error

    def outlet(self) -> Outlet:
        """What a subscriber must know of it."""
        return Outlet(self.gid, self.topic, self.type_name, self.address, self.qos.latched)

    def bind_again(self) -> None:
        """Be reachable once more after the folder of the sockets was removed."""
        with self._lock:
            if not self._shut:
                address = self._meeting.socket_address(self.number)
                bind_again(self._socket, self.address, address)
                self.address = address

    def greet(self) -> None:
        """Give a latched message to listeners that have come since; the others recognise its number."""
        with self._lock:
            if not self._shut and self._count_listeners() and self.last is not None and self._fits(self.last):
                self._transmit(self.last)

    @property
    def listeners(self) -> int:
        """How many would get what is published now: subscriptions of this process, and other processes."""
        self.greet()
        return self._listeners + super().listeners

    def _send_beyond(self, received: Received) -> None:
        if self._listeners > 0:  # counted at each look around, so that publishing need not
            if not self._fits(received):
                raise BusError(
                    f'{self.topic}: a {self.type_name} of {len(received.view)} bytes is not sent to other processes, '
                    f'whose limit is {self._longest}; publish smaller messages'
                )
            self._transmit(received)

    def _fits(self, received: Received) -> bool:
        """Whether the others take it in; who sent more would be cut off by them."""
        return len(received.view) <= self._longest

    def _transmit(self, received: Received) -> None:
        header = wire.pack_header(self._sender, self._key, received.sequence, received.source_ns)
        data = received.view
        if len(data) < LARGE_BYTES:
            self._socket.send(b''.join((header, data)))
        else:
            self._socket.send(header, zmq.SNDMORE)
            self._socket.send(data)

    def _count_listeners(self) -> bool:
        """Take in who came and went; whether somebody came."""
        came = False
        for _ in range(_WORDS_AT_ONCE):
            if not int(self._socket.get(zmq.EVENTS)) & zmq.POLLIN:
                break
            message = self._socket.recv_multipart()
            if message == [b'\x01']:
                self._listeners += 1
                came = True
            elif message == [b'\x00']:
                self._listeners = max(0, self._listeners - 1)
        return came

    def _close_socket(self) -> None:
        self._socket.close()


class ZmqRelay(ZmqPublisher):
    """Speaks on this host in the name of a publisher of another machine, so that loops and doubles are recognised."""

    relays = True

    def __init__(self, bus: ZmqBus, outlet: Outlet) -> None:
        super().__init__(bus, outlet.topic, outlet.type_name, Qos('queue', 100, outlet.latched), '')
        self.gid = outlet.gid
        self._sender = self.gid.encode()

    def repeat(self, sequence: int, source_ns: int, data: bytes) -> None:
        """Publish what the other said as its message number `sequence`.

        Raises:
            MessageError: it is longer than any message of its type.
        """
        if len(data) > self._longest:
            raise MessageError(f'{self.topic}: a message of {len(data)} bytes')
        with self._lock:
            if not self._shut and sequence > self.sequence:
                self.sequence = sequence
                now_ns = self._bus.clock.now_ns()
                self._deliver(Received(self.type_name, self.gid, sequence, source_ns, now_ns, data=data))


def _bound(context: zmq.Context[Any], address: str, depth: int) -> Any:
    socket = open_socket(context, zmq.XPUB, Longest.WORD)
    try:
        socket.set(zmq.RCVHWM, _WORDS)
        socket.set(zmq.SNDHWM, depth)
        socket.set(zmq.LINGER, _LINGER_MS)
        socket.set(zmq.XPUB_VERBOSER, 1)  # every coming and going is reported, not only the first and the last
        socket.bind(address)
    except zmq.ZMQError:
        socket.close()
        raise
    return socket
