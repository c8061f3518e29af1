"""The receiving half of the ZeroMQ bus: one thread a process that takes in messages and calls and meets the others."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING

import zmq

from tactile_nodes.bus.protocol import Received
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.zeromq import wire
from tactile_nodes.bus.zeromq.discovery import LOOK_EVERY_S
from tactile_nodes.bus.zeromq.loop import Loop
from tactile_nodes.bus.zeromq.records import Outlet, Record
from tactile_nodes.bus.zeromq.sockets import longest_message, open_socket
from tactile_nodes.clock import monotonic_s, thread_s
from tactile_nodes.errors import MessageError, TactileError

if TYPE_CHECKING:
    from tactile_nodes.bus.zeromq.host_bus import ZmqBus

SHORTEST_QUEUE = 8
_CHECK_LIVES_EVERY_S = 0.5
_LOOK_AT_MOST = 20  # looking takes a twentieth of a processor, however many there are to look at,
_LOOK_AT_ONCE = 4  # or a quarter when this process itself has changed what it wants
_LEAVE_AFTER_S = 1.0  # what a publisher that has gone sent last may still be on its way

Key = tuple[str, str]
"""Topic and type."""


class Hub(Loop):
    """Owns all sockets that receive, and follows who comes and goes."""

    def __init__(self, bus: ZmqBus) -> None:
        super().__init__('bus')
        self._bus = bus
        self._look_now = True
        self._looked_at_ns = -1
        self._next_look_s = self._earliest_look_s = self._next_check_s = 0.0
        self._receivers: dict[Key, Receiver] = {}
        self._trouble = ''

    def look_soon(self) -> None:
        """What this process wants has changed."""
        self.post(self._look_at_once)

    def welcome(self, subscription: Subscription) -> None:
        """Give the latched messages that came before `subscription` was made; in this thread."""
        receiver = self._receivers.get((subscription.topic, subscription.type_name))
        for received in receiver.latched.values() if receiver is not None else ():
            subscription.put(received)

    def wait_ms(self) -> int:
        return max(0, math.ceil((self._next_look_s - monotonic_s()) * 1000))

    def tick(self) -> None:
        if monotonic_s() >= self._next_look_s:
            self._look_around()

    def finish(self) -> None:
        for key in list(self._receivers):
            self._drop(key)
        self._bus.server.close()

    def _look_at_once(self) -> None:
        self._look_now = True
        self._next_look_s = min(self._next_look_s, self._earliest_look_s)

    def _look_around(self) -> None:
        used_s = thread_s()
        self._bus.greet_newcomers()
        changed_ns = self._bus.meeting.changed_ns()
        check_lives = monotonic_s() >= self._next_check_s
        if self._look_now or check_lives or changed_ns != self._looked_at_ns:
            self._look_now = False
            self._looked_at_ns = changed_ns
            self._connect(self._bus.meeting.look(trusting=not check_lives))
        now_s, cost_s = monotonic_s(), thread_s() - used_s
        pause_s = max(LOOK_EVERY_S, _LOOK_AT_MOST * cost_s)
        self._next_look_s = now_s + pause_s
        self._earliest_look_s = now_s + _LOOK_AT_ONCE * cost_s
        if check_lives:
            self._stay_present()
            self._next_check_s = now_s + max(_CHECK_LIVES_EVERY_S, pause_s)

    def _stay_present(self) -> None:
        """Come back when our files were removed: at logout, or by what tidies temporary folders."""
        try:
            self._bus.stay_present()
            trouble = ''
        except TactileError as error:  # tried again at the next round
            trouble = str(error)
        if trouble and trouble != self._trouble:
            sys.stderr.write(f'{trouble}\n')
        self._trouble = trouble

    def _connect(self, peers: list[Record]) -> None:
        wanted = self._bus.wanted()
        for key in self._receivers.keys() - wanted.keys():
            self._drop(key)
        offered: dict[Key, list[Outlet]] = {}
        for outlet in (outlet for record in peers for outlet in record.outlets):
            offered.setdefault((outlet.topic, outlet.type_name), []).append(outlet)
        for key, depth in wanted.items():
            if key not in self._receivers:
                receiver = self._receivers[key] = Receiver(self._bus, *key, depth)
                self.watch(receiver.socket, receiver.take_in)
            self._receivers[key].connect_to(offered.get(key, []))

    def _drop(self, key: Key) -> None:
        receiver = self._receivers.pop(key)
        self.forget(receiver.socket)
        receiver.socket.close()


class Receiver:
    """Receives one topic from all publishers of other processes. Used by the hub's thread alone."""

    def __init__(self, bus: ZmqBus, topic: str, type_name: str, depth: int) -> None:
        self.topic = topic
        self.type_name = type_name
        self.socket = open_socket(bus.context, zmq.SUB, longest_message(type_name))
        self.socket.set(zmq.RCVHWM, max(depth, SHORTEST_QUEUE))
        self.socket.set(zmq.LINGER, 0)
        self.socket.subscribe(b'')
        self._bus = bus
        self._key = wire.type_key(type_name)
        self._connected: dict[str, Outlet] = {}
        self._leaving_s: dict[str, float] = {}
        self._senders: dict[bytes, Outlet] = {}
        self._other: set[str] = set()
        self.latched: dict[str, Received] = {}  # the last message of each latched publisher

    def connect_to(self, outlets: list[Outlet]) -> None:
        """Be connected to these, and for a moment still to those who have gone."""
        now_s = monotonic_s()
        wanted = {outlet.address: outlet for outlet in self._one_each(outlets)}
        for address in wanted:
            self._leaving_s.pop(address, None)
            if address not in self._connected:
                self.socket.connect(address)
        for address in self._connected.keys() - wanted.keys():
            is_over = now_s > self._leaving_s.setdefault(address, now_s) + _LEAVE_AFTER_S
            if is_over and not self.socket.poll(0):  # what still waits would be lost
                self.socket.disconnect(address)
                del self._leaving_s[address], self._connected[address]
        self._connected.update(wanted)
        self._senders = {outlet.gid.encode(): outlet for outlet in self._connected.values()}
        for gone in self.latched.keys() - {outlet.gid for outlet in outlets}:
            del self.latched[gone]

    def _one_each(self, outlets: list[Outlet]) -> Iterable[Outlet]:
        """One way to each publisher: by two, what the quicker one brings would overtake, and so lose, the slower's."""
        chosen: dict[str, Outlet] = {}
        for outlet in outlets:
            stays = outlet.address in self._connected and outlet.address not in self._leaving_s
            if stays or outlet.gid not in chosen:
                chosen[outlet.gid] = outlet
        return chosen.values()

    def take_in(self) -> None:
        """Take one message, without waiting; then the others have their turn, and who waited for this one."""
        try:
            frame = self.socket.recv(zmq.NOBLOCK, copy=False)  # it knows at once whether more follow
            rest = self._rest() if frame.more else []
        except zmq.Again:
            return
        now_ns = self._bus.clock.now_ns()
        first = memoryview(frame.bytes)
        try:
            header, outlet = self._header_of(first)
            data = _data_of(first, rest)
        except MessageError:
            self._count_foreign()
            return
        received = Received(self.type_name, outlet.gid, header.sequence, header.source_ns, now_ns, data=data)
        if outlet.latched:
            self.latched[outlet.gid] = received
        self._bus.deliver(self.topic, received)

    def _rest(self) -> list[zmq.Frame]:
        found = [self.socket.recv(zmq.NOBLOCK, copy=False)]
        while found[-1].more:
            found.append(self.socket.recv(zmq.NOBLOCK, copy=False))
        return found

    def _header_of(self, first: memoryview) -> tuple[wire.Header, Outlet]:
        header = wire.unpack_header(first)
        outlet = self._senders.get(header.gid)
        if outlet is None:
            raise MessageError('a message of an unannounced publisher')
        if header.type_key != self._key:
            if outlet.address not in self._other:
                self._other.add(outlet.address)
                sys.stderr.write(f'{self.topic} has another version of {self.type_name}: update the older program\n')
            raise MessageError('a message of another type, or of another version of it')
        return header, outlet

    def _count_foreign(self) -> None:
        self._bus.foreign += 1
        for subscription in self._bus.subscriptions_of(self.topic, self.type_name):
            subscription.malformed += 1


def _data_of(first: memoryview, rest: list[zmq.Frame]) -> memoryview:
    """The bytes behind the header, in the same frame or in the next."""
    if not rest and len(first) > wire.HEADER_SIZE:
        return first[wire.HEADER_SIZE :]
    if len(rest) != 1 or len(first) != wire.HEADER_SIZE:
        raise MessageError(f'a message of {1 + len(rest)} frames')
    return rest[0].buffer
