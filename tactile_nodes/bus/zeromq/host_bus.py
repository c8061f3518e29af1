"""The bus between the processes of one host, over ZeroMQ sockets that only this user can reach.

Every publisher has a socket of its own (ipc://), so a topic's queue never stands behind another's and each keeps the
length that the topic table gives it. A full queue drops; it never makes the publisher wait. One thread a process
receives, answers calls and follows who comes and goes; publishing happens in the caller's thread.
"""

from __future__ import annotations

import contextlib
import ctypes
import resource
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Protocol, cast

import zmq

from tactile_nodes.bus.inprocess import InProcessBus, require_full, require_type
from tactile_nodes.bus.protocol import Graph, Participant, Qos, ServiceHandler
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.zeromq.calls import CallServer, call_remote, is_bound, ping_remote
from tactile_nodes.bus.zeromq.discovery import Meeting, domain_from_environment
from tactile_nodes.bus.zeromq.publishing import ZmqPublisher, ZmqRelay
from tactile_nodes.bus.zeromq.receiving import Hub, Key
from tactile_nodes.bus.zeromq.records import Outlet, Record
from tactile_nodes.clock import Clock
from tactile_nodes.errors import BusError, ServiceUnavailableError

_MANY_FILES = 8192  # each connection is one
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # malloc.h


class FarSide(Protocol):
    """Whom a bridge speaks for: nodes of another machine."""

    def participants(self) -> tuple[Participant, ...]:
        """Those who are reachable now."""
        ...

    def service(self, name: str, type_name: str) -> ServiceHandler | None:
        """What passes calls of a service on to them, if one of them serves it."""
        ...


class ZmqBus(InProcessBus):
    """`Bus` over ZeroMQ; what stays inside the process is handed over as it is.

    Raises:
        BusError, ConfigurationError: the folder of the sockets cannot be used.
    """

    def __init__(self, domain_id: int | None = None, clock: Clock | None = None, folder: Path | None = None) -> None:
        super().__init__(clock)
        self.domain_id = domain_from_environment() if domain_id is None else domain_id
        self.meeting = Meeting(self.uid, self.domain_id, folder)
        _allow_many_files()
        _keep_memory()
        self.context = zmq.Context()
        self.context.set(zmq.MAX_SOCKETS, _MANY_FILES)
        self.foreign = 0
        self._far: FarSide | None = None
        self._hub = Hub(self)
        try:
            self.server = CallServer(self.context, self.meeting.socket_address(0), self._find_service, self._hub)
            self.announce()
        except BaseException:
            self._hub.stop()
            self.context.destroy(linger=0)
            self.meeting.leave()
            raise
        self._hub.start()
        self._hub.look_soon()

    @property
    def malformed(self) -> int:
        """Frames and files from anybody that were none of ours, and were dropped."""
        return self.foreign + self.server.malformed + self.meeting.malformed

    # --- topics ---------------------------------------------------------------------------------------------

    def advertise(self, topic: str, type_name: str, qos: Qos, node: str = '') -> ZmqPublisher:
        require_full(topic)
        self._check_open()
        return self._offer(ZmqPublisher(self, topic, type_name, qos, node))

    def relay(self, outlet: Outlet) -> ZmqRelay:
        """Repeat on this host what a publisher of another machine says, in its name."""
        self._check_open()
        return self._offer(ZmqRelay(self, outlet))

    def follow(self, outlet: Outlet, qos: Qos, node: str, on_ready: Callable[[], None]) -> Subscription:
        """Receive the messages of one publisher alone."""
        key = (outlet.topic, outlet.type_name)
        return self._listen(Subscription(*key, qos, node, on_ready, self._forget_subscription, outlet.gid))

    def _listen(self, subscription: Subscription) -> Subscription:
        super()._listen(subscription)
        self._hub.post(lambda: self._hub.welcome(subscription))
        return subscription

    def wanted(self) -> dict[Key, int]:
        """The topics and types that this process receives, with the longest queue somebody wants."""
        with self._lock:
            found: dict[Key, int] = {}
            for entries in self._subscriptions.values():
                for entry in entries:
                    key = (entry.topic, entry.type_name)
                    found[key] = max(found.get(key, 0), entry.qos.depth)
            return found

    def subscriptions_of(self, topic: str, type_name: str) -> list[Subscription]:
        return [entry for entry in self._subscriptions.get(topic, ()) if entry.type_name == type_name]

    # --- services -------------------------------------------------------------------------------------------

    def call(self, service: str, type_name: str, request: Any, timeout_s: float = 5.0) -> Any:
        self._check_open()
        if service in self._services:
            return super().call(service, type_name, request, timeout_s)
        return self._call(self._server_of(service, type_name, beyond=True), service, type_name, request, timeout_s)

    def call_here(self, service: str, type_name: str, request: Any, timeout_s: float) -> Any:
        """The same for services of this host only. Raises what `call` raises."""
        self._check_open()
        if service in self._services:
            return super().call(service, type_name, request, timeout_s)
        return self._call(self._server_of(service, type_name, beyond=False), service, type_name, request, timeout_s)

    def _call(self, record: Record, service: str, type_name: str, request: Any, timeout_s: float) -> Any:
        is_alive = partial(self._meets, record.participant.uid)
        return call_remote(self.context, record.service_address, service, type_name, request, timeout_s, is_alive)

    def ping(self, uid: str, timeout_s: float = 1.0) -> float | None:
        """The seconds that a participant took to answer; None when it is alive but does not, or is gone."""
        for record in self.peers():
            if record.participant.uid == uid:
                return ping_remote(self.context, record.service_address, timeout_s)
        return 0.0 if uid == self.uid else None

    def _server_of(self, service: str, type_name: str, *, beyond: bool) -> Record:
        """Who answers `service`: somebody on this host rather than a bridge to another (`beyond`)."""
        records = self.peers()
        offers = [(record, record.participant) for record in records]
        offers += [(record, far) for record in records for far in record.remotes if beyond]
        for record, participant in offers:
            for offer in participant.services:
                if offer.name == service:
                    require_type(service, offer.type_name, type_name)
                    return record
        raise ServiceUnavailableError(f'no node offers the service {service}; see: tactile service list')

    # --- the graph ------------------------------------------------------------------------------------------

    def graph(self) -> Graph:
        records = self.peers()
        found = {self.uid: self.own_participant()}
        found |= {record.participant.uid: record.participant for record in records}
        for far in (*self._remotes(), *(far for record in records for far in record.remotes)):
            found.setdefault(far.uid, far)  # two bridges may speak for the same ones
        return Graph(tuple(found.values()))

    def peers(self) -> list[Record]:
        """All living participants of this host but this one."""
        return self.meeting.look()

    def attach(self, far: FarSide | None) -> None:
        """Speak for the nodes of another machine, or cease to."""
        self._far = far
        self.tell()

    def tell(self) -> None:
        """Tell the others that those whom we speak for have changed."""
        self._changed()

    def close(self) -> None:
        if not self._close_ends():
            return
        self._hub.stop()
        self.context.term()  # ends calls that other threads still make
        self.meeting.leave()

    # --- for the hub ----------------------------------------------------------------------------------------

    def greet_newcomers(self) -> None:
        """Have latched publishers give their last message to those who came since."""
        for publisher in self._sockets():
            publisher.greet()

    def stay_present(self) -> None:
        """Put back what was removed of our files, or written over.

        Raises:
            BusError, ConfigurationError: the folder cannot be used.
        """
        if not (self.meeting.is_present() and self._is_reachable()):
            self.rejoin()
        elif not self.meeting.is_announced():
            self.announce()

    def rejoin(self) -> None:
        """Be found again after files of ours were removed; connections that stand are not touched.

        Raises:
            BusError, ConfigurationError: the folder cannot be used.
        """
        self.meeting.enter()
        self.server.bind_again(self.meeting.socket_address(0))
        for publisher in self._sockets():
            publisher.bind_again()
        self.announce()

    def announce(self) -> None:
        """Tell the others what we offer and receive."""
        with self._lock:
            record = Record(self.own_participant(), self.outlets(), self.server.address, self._remotes())
            self.meeting.announce(record)

    def outlets(self) -> tuple[Outlet, ...]:
        """Where the messages of this process can be had, those that it repeats included."""
        return tuple(publisher.outlet() for publisher in self._sockets())

    def _is_reachable(self) -> bool:
        return all(is_bound(address) for address in (self.server.address, *(end.address for end in self._sockets())))

    def _sockets(self) -> list[ZmqPublisher]:
        with self._lock:
            return cast(list[ZmqPublisher], list(self._publishers))

    def _remotes(self) -> tuple[Participant, ...]:
        return self._far.participants() if self._far is not None else ()

    def _meets(self, uid: str) -> bool:
        return any(record.participant.uid == uid for record in self.peers())

    def _changed(self) -> None:
        if not self._closed:
            with contextlib.suppress(BusError):  # the disk is full: the hub says so, and tries again (`stay_present`)
                self.announce()
            self._hub.look_soon()

    def _find_service(self, name: str, type_name: str) -> ServiceHandler | None:
        offered = self._services.get(name)
        if offered is not None:
            return offered.handler if offered.type_name == type_name else None
        return self._far.service(name, type_name) if self._far is not None else None


def _allow_many_files() -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft < _MANY_FILES and (hard == resource.RLIM_INFINITY or soft < hard):
        wanted = _MANY_FILES if hard == resource.RLIM_INFINITY else min(hard, _MANY_FILES)
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


def _keep_memory() -> None:
    """Have glibc keep what is freed instead of giving it back and asking for it again with each image.

    Each new page costs a fault; the 48 pages of a 440x440 image, in both processes and more than once, were measured
    at 150 µs in processes that also use other large arrays.
    """
    set_option = getattr(ctypes.CDLL(None), 'mallopt', None)  # another C library has its own ways
    if set_option is not None:
        set_option(_M_MMAP_THRESHOLD, 16 << 20)
        set_option(_M_TRIM_THRESHOLD, 64 << 20)
