"""The bus inside one process: a message goes from publisher to subscriber as the object it is."""

from __future__ import annotations

import dataclasses
import itertools
import os
import secrets
import socket
import threading
from collections import defaultdict
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from typing import Any

import numpy as np

from tactile_nodes import messages
from tactile_nodes.bus.protocol import Endpoint, Graph, Participant, Qos, Received, ServiceHandler
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.clock import Clock, SystemClock
from tactile_nodes.errors import BusError, ServiceError, ServiceTimeoutError, ServiceUnavailableError


def new_uid() -> str:
    """A name for a participant, unique for all purposes: eight characters."""
    return secrets.token_hex(4)


class InProcessBus:
    """A bus whose participants all live in this process; also the inner half of every wider transport."""

    def __init__(self, clock: Clock | None = None) -> None:
        self.clock = clock or SystemClock()
        self.uid = new_uid()
        self._lock = threading.RLock()
        self._closed = False
        self._publishers: list[LocalPublisher] = []
        self._subscriptions: dict[str, list[Subscription]] = defaultdict(list)
        self._services: dict[str, _LocalService] = {}
        self._nodes: list[str] = []
        self._numbers = itertools.count(1)

    # --- topics ---------------------------------------------------------------------------------------------

    def advertise(self, topic: str, type_name: str, qos: Qos, node: str = '') -> LocalPublisher:
        publisher = LocalPublisher(self, topic, type_name, qos, node)
        with self._lock:
            self._check_open()
            self._publishers.append(publisher)
        self._changed()
        return publisher

    def subscribe(
        self, topic: str, type_name: str, qos: Qos, node: str = '', on_ready: Callable[[], None] | None = None
    ) -> Subscription:
        messages.message_class(type_name)
        made = Subscription(topic, type_name, qos, node, on_ready, self._forget_subscription)
        with self._lock:
            self._check_open()
            # A new list instead of an append: `deliver` walks the old one without taking the lock.
            self._subscriptions[topic] = [*self._subscriptions[topic], made]
            latched = [publisher.last for publisher in self._publishers if _feeds(publisher, made)]
        for received in latched:
            if received is not None:
                made.put(received)
        self._changed()
        return made

    def deliver(self, topic: str, received: Received) -> None:
        """Hand `received` to this process's subscriptions of `topic` that expect its type."""
        for subscription in self._subscriptions.get(topic, ()):
            if subscription.type_name == received.type_name:
                subscription.put(received)

    def count_listeners(self, topic: str, type_name: str) -> int:
        """This process's subscriptions of a topic and type."""
        return sum(entry.type_name == type_name for entry in self._subscriptions.get(topic, ()))

    # --- services -------------------------------------------------------------------------------------------

    def serve(self, service: str, type_name: str, handler: ServiceHandler, node: str = '') -> _LocalService:
        offered = _LocalService(self, service, type_name, handler, node)
        with self._lock:
            self._check_open()
            if service in self._services:
                raise BusError(f'the service {service} is already served by {self._services[service].node}')
            self._services[service] = offered
        self._changed()
        return offered

    def call(self, service: str, type_name: str, request: Any, timeout_s: float = 5.0) -> Any:
        offered = self._services.get(service)
        if offered is None:
            raise ServiceUnavailableError(
                f'nobody serves {service}; see which services there are: tactile service list'
            )
        if offered.type_name != type_name:
            raise ServiceError(f'{service} is a {offered.type_name}, not a {type_name}')
        answer: Future[Any] = Future()
        offered.handler(request, answer_to(answer))
        try:
            return answer.result(timeout_s)
        except FutureTimeoutError as error:
            raise ServiceTimeoutError(f'{offered.node} did not answer {service} within {timeout_s:g} s') from error

    # --- the graph ------------------------------------------------------------------------------------------

    def add_node(self, name: str) -> None:
        """Announce a node of this process."""
        with self._lock:
            self._nodes.append(name)
        self._changed()

    def remove_node(self, name: str) -> None:
        """Take back `add_node`."""
        with self._lock:
            if name in self._nodes:
                self._nodes.remove(name)
        self._changed()

    def graph(self) -> Graph:
        return Graph((self.own_participant(),))

    def own_participant(self) -> Participant:
        """This process as others see it."""
        with self._lock:
            subscriptions = [entry for entries in self._subscriptions.values() for entry in entries]
            return Participant(
                self.uid,
                os.getpid(),
                socket.gethostname(),
                tuple(self._nodes),
                tuple(Endpoint(p.topic, p.type_name, p.node, p.qos.latched) for p in self._publishers),
                tuple(Endpoint(s.topic, s.type_name, s.node) for s in subscriptions),
                tuple(Endpoint(s.name, s.type_name, s.node) for s in self._services.values()),
            )

    def close(self) -> None:
        with self._lock:
            self._closed = True
            ends: Iterable[Any] = [
                *self._publishers,
                *(entry for entries in self._subscriptions.values() for entry in entries),
                *self._services.values(),
            ]
        for end in ends:
            end.close()

    # --- for the ends and for wider transports ---------------------------------------------------------------

    def next_number(self) -> int:
        """A number that this participant has not used yet."""
        return next(self._numbers)

    def _changed(self) -> None:
        """Something about this participant changed; a wider transport tells the others."""

    def _forget_publisher(self, publisher: LocalPublisher) -> None:
        with self._lock:
            if publisher in self._publishers:
                self._publishers.remove(publisher)
        self._changed()

    def _forget_subscription(self, subscription: Subscription) -> None:
        with self._lock:
            left = [entry for entry in self._subscriptions[subscription.topic] if entry is not subscription]
            self._subscriptions[subscription.topic] = left
        self._changed()

    def _forget_service(self, service: _LocalService) -> None:
        with self._lock:
            self._services.pop(service.name, None)
        self._changed()

    def _check_open(self) -> None:
        if self._closed:
            raise BusError('the bus is closed')


class LocalPublisher:
    """Publishes to the subscriptions of its own process; wider transports send `data` on besides."""

    def __init__(self, bus: InProcessBus, topic: str, type_name: str, qos: Qos, node: str) -> None:
        messages.message_class(type_name)
        self.topic = topic
        self.type_name = type_name
        self.qos = qos
        self.node = node
        self.last: Received | None = None
        self.sequence = 0
        self.gid = f'{bus.uid}.{bus.next_number()}'
        self._bus = bus
        self._lock = threading.Lock()

    def publish(self, message: Any) -> None:
        if messages.type_name(message) != self.type_name:
            raise BusError(f'{self.topic} carries {self.type_name}, not {messages.type_name(message)}')
        _freeze_arrays(message)
        self._send(message, None)

    def publish_bytes(self, data: bytes) -> None:
        self._send(None, data)

    def close(self) -> None:
        self._bus._forget_publisher(self)

    @property
    def listeners(self) -> int:
        """How many subscriptions would get what is published now."""
        return self._bus.count_listeners(self.topic, self.type_name)

    def _send(self, message: Any, data: bytes | None) -> None:
        with self._lock:  # so that messages leave in the order of their numbers
            self.sequence += 1
            now_ns = self._bus.clock.now_ns()
            received = Received(self.type_name, self.gid, self.sequence, now_ns, now_ns, message=message, data=data)
            self.last = received if self.qos.latched else None
            self._bus.deliver(self.topic, received)
            self._send_beyond(received)

    def _send_beyond(self, received: Received) -> None:
        """Send to other processes; there are none here."""


class _LocalService:
    def __init__(self, bus: InProcessBus, name: str, type_name: str, handler: ServiceHandler, node: str) -> None:
        self.name = name
        self.type_name = type_name
        self.handler = handler
        self.node = node
        self._bus = bus

    def close(self) -> None:
        self._bus._forget_service(self)


def answer_to(answer: Future[Any]) -> Callable[[Any], None]:
    """A `Reply` that fulfils `answer`."""

    def reply(response: Any) -> None:
        if isinstance(response, Exception):
            answer.set_exception(response)
        else:
            answer.set_result(response)

    return reply


def _feeds(publisher: LocalPublisher, subscription: Subscription) -> bool:
    return publisher.topic == subscription.topic and publisher.type_name == subscription.type_name


def _freeze_arrays(message: Any) -> None:
    for field in dataclasses.fields(message):
        value = getattr(message, field.name)
        if isinstance(value, np.ndarray):
            value.flags.writeable = False
