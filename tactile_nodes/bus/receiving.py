"""The receiving half of the ZeroMQ bus: one thread a process that takes in messages and calls and meets the others."""

from __future__ import annotations

import contextlib
import os
import threading
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import zmq

from tactile_nodes.bus import wire
from tactile_nodes.bus.discovery import LOOK_EVERY_S, Record
from tactile_nodes.bus.protocol import Received
from tactile_nodes.clock import monotonic_s
from tactile_nodes.errors import MessageError

if TYPE_CHECKING:
    from tactile_nodes.bus.zeromq import ZmqBus

SHORTEST_QUEUE = 8
ZERO_COPY_BYTES = 65536  # below, a copy is cheaper than keeping ZeroMQ's buffer alive
_CHECK_LIVES_EVERY_S = 0.5


class Hub(threading.Thread):
    """Owns all sockets that receive. Others reach it by `post` and `look_soon`."""

    def __init__(self, bus: ZmqBus) -> None:
        super().__init__(name='bus', daemon=True)
        self._bus = bus
        self._running = True
        self._look_now = True
        self._seen_ns = -1
        self._next_look_s = self._next_check_s = 0.0
        self._poller = zmq.Poller()
        self._on_readable: dict[Any, Callable[[], None]] = {}
        self._receivers: dict[tuple[str, str], Receiver] = {}
        self._posted: deque[Callable[[], None]] = deque()
        self._woken, self._waker = os.pipe()
        os.set_blocking(self._woken, False)
        os.set_blocking(self._waker, False)
        self.watch(self._woken, self._do_posted)

    def watch(self, socket: Any, on_readable: Callable[[], None]) -> None:
        """Call `on_readable` in this thread whenever there is something to read; before `start` or in this thread."""
        self._poller.register(socket, zmq.POLLIN)
        self._on_readable[socket] = on_readable

    def post(self, action: Callable[[], None]) -> None:
        """Do something in this thread, soon."""
        self._posted.append(action)
        try:
            os.write(self._waker, b'!')
        except BlockingIOError:  # a full pipe wakes as well as a fuller one
            return

    def look_soon(self) -> None:
        """What this process wants has changed."""
        self._look_now = True
        if self._running:
            self.post(lambda: None)

    def stop(self) -> None:
        """End the thread; nothing is received afterwards."""
        self.post(self._end)
        self.join()
        os.close(self._woken)
        os.close(self._waker)

    def run(self) -> None:
        while self._running:
            for socket, _ in self._poller.poll(round(LOOK_EVERY_S * 1000)):
                self._on_readable[socket]()
            if self._look_now or monotonic_s() >= self._next_look_s:
                self._look_around()

    def _end(self) -> None:
        self._running = False

    def _do_posted(self) -> None:
        with contextlib.suppress(BlockingIOError):  # somebody else's byte was read before
            os.read(self._woken, 4096)
        while self._posted:
            self._posted.popleft()()

    def _look_around(self) -> None:
        now_s = monotonic_s()
        self._next_look_s = now_s + LOOK_EVERY_S
        self._bus.greet_newcomers()
        changed_ns = self._bus.meeting.changed_ns()
        if self._look_now or changed_ns != self._seen_ns or now_s >= self._next_check_s:
            self._look_now = False
            self._seen_ns = changed_ns
            self._next_check_s = now_s + _CHECK_LIVES_EVERY_S
            self._connect(self._bus.peers())

    def _connect(self, peers: list[Record]) -> None:
        wanted = self._bus.wanted()
        for key in self._receivers.keys() - wanted.keys():
            self._drop(key)
        for key, depth in wanted.items():
            if key not in self._receivers:
                self._add(key, depth)
            self._receivers[key].connect_to(_addresses(peers, *key))

    def _add(self, key: tuple[str, str], depth: int) -> None:
        receiver = self._receivers[key] = Receiver(self._bus, *key, depth)
        self.watch(receiver.socket, receiver.drain)

    def _drop(self, key: tuple[str, str]) -> None:
        receiver = self._receivers.pop(key)
        self._poller.unregister(receiver.socket)
        del self._on_readable[receiver.socket]
        receiver.socket.close()


class Receiver:
    """Receives one topic from all publishers of other processes. Used by the hub's thread alone."""

    def __init__(self, bus: ZmqBus, topic: str, type_name: str, depth: int) -> None:
        self.topic = topic
        self.type_name = type_name
        self.socket = bus.context.socket(zmq.SUB)
        self.socket.set(zmq.RCVHWM, max(depth, SHORTEST_QUEUE))
        self.socket.set(zmq.LINGER, 0)
        self.socket.subscribe(b'')
        self._bus = bus
        self._key = wire.type_key(type_name)
        self._connected: set[str] = set()
        self._newest: dict[str, int] = {}
        self._large = False

    def connect_to(self, addresses: dict[str, str]) -> None:
        """Be connected to exactly these publishers, gid to address."""
        wanted = set(addresses.values())
        for address in wanted - self._connected:
            self.socket.connect(address)
        for address in self._connected - wanted:
            self.socket.disconnect(address)
        self._connected = wanted
        self._newest = {gid: number for gid, number in self._newest.items() if gid in addresses}

    def drain(self) -> None:
        """Take what has come in, without waiting."""
        for _ in range(SHORTEST_QUEUE):  # then let the others have their turn
            try:
                frames = self.socket.recv_multipart(zmq.NOBLOCK, copy=not self._large)
            except zmq.Again:
                return
            self._accept([frame.buffer if isinstance(frame, zmq.Frame) else frame for frame in frames])

    def _accept(self, frames: list[Any]) -> None:
        now_ns = self._bus.clock.now_ns()
        try:
            header = self._header_of(frames)
        except MessageError:
            self._count_foreign()
            return
        if header.sequence <= self._newest.get(header.gid, 0):
            return  # a latched message, sent again for somebody else
        self._newest[header.gid] = header.sequence
        self._large = len(frames[1]) >= ZERO_COPY_BYTES
        received = Received(self.type_name, header.gid, header.sequence, header.source_ns, now_ns, data=frames[1])
        self._bus.deliver(self.topic, received)

    def _header_of(self, frames: list[Any]) -> wire.Header:
        if len(frames) != 2:
            raise MessageError(f'a message of {len(frames)} frames')
        header = wire.unpack_header(frames[0])
        if header.type_key != self._key:
            raise MessageError('a message of another type, or of another version of it')
        return header

    def _count_foreign(self) -> None:
        self._bus.foreign += 1
        for subscription in self._bus.subscriptions_of(self.topic, self.type_name):
            subscription.malformed += 1


def _addresses(peers: list[Record], topic: str, type_name: str) -> dict[str, str]:
    """Where a topic is published, gid to address."""
    return {
        gid: record.addresses[gid]
        for record in peers
        for gid, end in zip(record.gids, record.participant.publishers, strict=False)
        if end.name == topic and end.type_name == type_name and gid in record.addresses
    }
