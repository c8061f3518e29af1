"""The bus inside one process: a subscriber gets the publisher's own message object."""

from __future__ import annotations

import itertools
import os
import secrets
import socket
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from typing import Any, TypeVar

from tactile_nodes import messages
from tactile_nodes.bus.freezing import freeze_arrays
from tactile_nodes.bus.protocol import Endpoint, Graph, Participant, Qos, Received, ServiceHandler
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.clock import Clock, SystemClock
from tactile_nodes.errors import BusError, ServiceError, ServiceTimeoutError, ServiceUnavailableError, TactileError

AnyPublisher = TypeVar('AnyPublisher', bound='LocalPublisher')


def new_uid() -> str:
    """A globally unique name for a participant: eight characters."""
    return secrets.token_hex(4)


class InProcessBus:
    """A bus whose participants all live in this process. Wider transports contain it."""

    def __init__(self, clock: Clock | None = None) -> None:
        self.clock = clock or SystemClock()
        self.uid = new_uid()
        self._lock = threading.RLock()
        self._closed = False
        self._publishers: list[LocalPublisher] = []
        self._subscriptions: dict[str, list[Subscription]] = {}
        self._services: dict[str, _LocalService] = {}
        self._nodes: list[str] = []
        self._numbers = itertools.count(1)

    # --- topics ---------------------------------------------------------------------------------------------

    def advertise(self, topic: str, type_name: str, qos: Qos, node: str = '') -> LocalPublisher:
        require_full(topic)
        return self._offer(LocalPublisher(self, topic, type_name, qos, node))

    def subscribe(
        self, topic: str, type_name: str, qos: Qos, node: str = '', on_ready: Callable[[], None] | None = None
    ) -> Subscription:
        require_full(topic)
        return self._listen(Subscription(topic, type_name, qos, node, on_ready, self._forget_subscription))

    def _listen(self, subscription: Subscription) -> Subscription:
        messages.message_class(subscription.type_name)
        with self._lock:
            self._check_open()
            # A new list instead of an append, because `deliver` iterates over the old one without the lock.
            self._subscriptions[subscription.topic] = [*self._subscriptions.get(subscription.topic, ()), subscription]
            key = (subscription.topic, subscription.type_name)
            latched = [each.last for each in self._publishers if (each.topic, each.type_name) == key]
        for received in latched:
            if received is not None:
                subscription.put(received)
        self._changed()
        return subscription

    def deliver(self, topic: str, received: Received) -> None:
        """Pass `received` to the subscriptions of `topic` in this process that expect its type."""
        for subscription in self._subscriptions.get(topic, ()):
            if subscription.type_name == received.type_name:
                subscription.put(received)

    def count_listeners(self, topic: str, type_name: str) -> int:
        return sum(entry.type_name == type_name for entry in self._subscriptions.get(topic, ()))

    # --- services -------------------------------------------------------------------------------------------

    def serve(self, service: str, type_name: str, handler: ServiceHandler, node: str = '') -> _LocalService:
        offered = _LocalService(self, service, type_name, handler, node)
        with self._lock:
            self._check_open()
            if service in self._services:
                raise BusError(f'the service {service} is already offered by {self._services[service].node}')
            self._services[service] = offered
        self._changed()
        return offered

    def call(self, service: str, type_name: str, request: Any, timeout_s: float = 5.0) -> Any:
        self._check_open()
        offered = self._services.get(service)
        if offered is None:
            raise ServiceUnavailableError(f'no node offers the service {service}; see: tactile service list')
        require_type(service, offered.type_name, type_name)
        answer: Future[Any] = Future()
        offered.handler(request, answer_to(answer))
        try:
            return answer.result(timeout_s)
        except FutureTimeoutError as error:
            raise ServiceTimeoutError(f'{offered.node} did not respond to {service} within {timeout_s:g} s') from error
        except TactileError as error:
            raise ServiceError(f'{service}: {error}') from error

    # --- the graph ------------------------------------------------------------------------------------------

    def add_node(self, name: str) -> None:
        with self._lock:
            self._nodes.append(name)
        self._changed()

    def remove_node(self, name: str) -> None:
        with self._lock:
            if name in self._nodes:
                self._nodes.remove(name)
        self._changed()

    def graph(self) -> Graph:
        return Graph((self.own_participant(),))

    def own_participant(self) -> Participant:
        """This process as other participants see it."""
        with self._lock:
            subscriptions = [entry for entries in self._subscriptions.values() for entry in entries]
            return Participant(
                self.uid,
                os.getpid(),
                socket.gethostname(),
                tuple(self._nodes),
                tuple(
                    Endpoint(p.topic, p.type_name, p.node, p.qos.latched, p.gid)
                    for p in self._publishers
                    if not p.relays
                ),
                tuple(Endpoint(s.topic, s.type_name, s.node) for s in subscriptions),
                tuple(Endpoint(s.name, s.type_name, s.node) for s in self._services.values()),
            )

    def close(self) -> None:
        self._close_ends()

    def _close_ends(self) -> bool:
        """Close what was created through this bus; false if it was closed before."""
        with self._lock:
            if self._closed:
                return False
            self._closed = True
            ends: Iterable[Any] = [
                *self._publishers,
                *(entry for entries in self._subscriptions.values() for entry in entries),
                *self._services.values(),
            ]
        for end in ends:
            end.close()
        return True

    # --- for the ends and for wider transports ---------------------------------------------------------------

    def next_number(self) -> int:
        """A number that this participant has not used yet."""
        return next(self._numbers)

    def _offer(self, publisher: AnyPublisher) -> AnyPublisher:
        with self._lock:
            if self._closed:
                publisher.close()
            self._check_open()
            self._publishers.append(publisher)
        self._changed()
        return publisher

    def _changed(self) -> None:
        """Called when this participant changed; a wider transport informs the others."""

    def _forget_publisher(self, publisher: LocalPublisher) -> None:
        with self._lock:
            if publisher in self._publishers:
                self._publishers.remove(publisher)
        self._changed()

    def _forget_subscription(self, subscription: Subscription) -> None:
        with self._lock:
            left = [entry for entry in self._subscriptions.get(subscription.topic, ()) if entry is not subscription]
            self._subscriptions[subscription.topic] = left
        self._changed()

    def _forget_service(self, service: _LocalService) -> None:
        with self._lock:
            if self._services.get(service.name) is service:
                del self._services[service.name]
        self._changed()

    def _check_open(self) -> None:
        if self._closed:
            raise BusError('the bus is closed')


class LocalPublisher:
    """Publishes to the subscriptions of its own process; wider transports also send `data` to other processes."""

    relays = False
    """Whether it republishes messages of another machine, and so is not this process's own publisher."""

    def __init__(self, bus: InProcessBus, topic: str, type_name: str, qos: Qos, node: str) -> None:
        messages.message_class(type_name)
        self.topic = topic
        self.type_name = type_name
        self.qos = qos
        self.node = node
        self.last: Received | None = None
        self.sequence = 0
        self.number = bus.next_number()
        self.gid = f'{bus.uid}.{self.number}'
        self._bus = bus
        self._lock = threading.Lock()
        self._shut = False

    def publish(self, message: Any) -> None:
        if message.__msgtype__ != self.type_name:
            raise BusError(f'{self.topic} carries {self.type_name}, not {messages.type_name(message)}')
        freeze_arrays(message)
        self._send(message, None)

    def publish_bytes(self, data: bytes) -> None:
        self._send(None, data)

    @property
    def listeners(self) -> int:
        """The number of subscriptions that would get a message published now."""
        return self._bus.count_listeners(self.topic, self.type_name)

    def close(self) -> None:
        with self._lock:
            if self._shut:
                return
            self._shut = True
            self._close_socket()
        self._bus._forget_publisher(self)

    def _send(self, message: Any, data: bytes | None) -> None:
        with self._lock:  # so that messages leave in sequence
            self._check_open()
            now_ns = self._bus.clock.now_ns()
            number = self.sequence + 1
            received = Received(self.type_name, self.gid, number, now_ns, now_ns, message=message, data=data)
            if self.qos.latched:
                assert received.view  # refuses a message that cannot be encoded before it is delivered
            self.sequence = number
            self._deliver(received)

    def _deliver(self, received: Received) -> None:
        if self.qos.latched:
            self.last = received
        self._bus.deliver(self.topic, received)
        self._send_beyond(received)

    def _check_open(self) -> None:
        if self._shut:
            raise BusError(f'the publisher of {self.topic} is closed')

    def _send_beyond(self, received: Received) -> None:
        """Send to other processes; does nothing here."""

    def _close_socket(self) -> None:
        """Close the socket; there is none here."""


class _LocalService:
    def __init__(self, bus: InProcessBus, name: str, type_name: str, handler: ServiceHandler, node: str) -> None:
        self.name = name
        self.type_name = type_name
        self.handler = handler
        self.node = node
        self._bus = bus

    def close(self) -> None:
        self._bus._forget_service(self)


def require_full(topic: str) -> None:
    """Raise a BusError if the name of a topic is relative, as those of the topic table: no node uses it as it is."""
    if not topic.startswith('/'):
        raise BusError(f'{topic!r} is not the full name of a topic, which begins with a slash: /{topic}')


def require_type(service: str, served: str, wanted: str) -> None:
    """Raise a ServiceError if a service does not have the type that the caller expects."""
    if served != wanted:
        raise ServiceError(f'{service} is a {served}, not a {wanted}')


def answer_to(answer: Future[Any]) -> Callable[[Any], None]:
    """A `Reply` that sets the result of `answer`."""

    def reply(response: Any) -> None:
        if isinstance(response, Exception):
            answer.set_exception(response)
        else:
            answer.set_result(response)

    return reply
