"""The interface of every transport: ZeroMQ, one process and ROS 2 are interchangeable."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

from tactile_nodes import messages
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.clock import Clock
from tactile_nodes.errors import ConfigurationError


@dataclass(frozen=True)
class Qos:
    """How messages of a topic are buffered for a subscriber.

    `latest`: only the newest `depth` messages are kept (a camera image, a force).
    `queue`: up to `depth` messages wait, then the oldest is dropped and counted (force/torque samples).
    `latched`: late subscribers also get the publisher's last message (a rest image).
    `reliable`: messages lost on a network are sent again; used by the ROS 2 bus only.
    """

    keep: Literal['latest', 'queue'] = 'latest'
    depth: int = 1
    latched: bool = False
    reliable: bool = True


class Publisher(Protocol):
    """The sending end of one topic."""

    topic: str
    type_name: str

    @property
    def listeners(self) -> int:
        """The number of receivers of a message published now; each receiving process counts once."""
        ...

    def publish(self, message: Any) -> None:
        """Send `message` to all subscribers. Its arrays become read-only, because nodes of this process share it."""
        ...

    def publish_bytes(self, data: bytes) -> None:
        """Like `publish`, for CDR bytes that exist already (a replayed bag)."""
        ...

    def close(self) -> None:
        """Stop offering the topic; closing twice is harmless."""
        ...


Reply = Callable[[Any], None]
"""Takes the response message of a service call, or the exception that prevented it."""

ServiceHandler = Callable[[Any, Reply], None]
"""Called with a request and a reply function, which may be called at once or later, from any thread."""


class Bus(Protocol):
    """The connection of one process to all others of its domain; `clock` gives the stamps of its messages."""

    clock: Clock

    def advertise(self, topic: str, type_name: str, qos: Qos, node: str = '') -> Publisher:
        """Offer `topic` (a full name, '/skin/force'); a topic may have several publishers."""
        ...

    def subscribe(
        self, topic: str, type_name: str, qos: Qos, node: str = '', on_ready: Callable[[], None] | None = None
    ) -> Subscription:
        """Receive `topic` (a full name) from all its publishers, present and future.

        `on_ready` is called, from any thread, after each received message; it must return at once.
        """
        ...

    def serve(self, service: str, type_name: str, handler: ServiceHandler, node: str = '') -> Closing:
        """Answer calls of `service`."""
        ...

    def call(self, service: str, type_name: str, request: Any, timeout_s: float = 5.0) -> Any:
        """The response of `service` to `request`.

        Raises:
            ServiceUnavailableError: no node offers the service.
            ServiceTimeoutError: no response within `timeout_s`.
            ServiceError: the node that offers it refused or failed.
        """
        ...

    def add_node(self, name: str) -> None:
        """Announce a node of this process to the other participants."""
        ...

    def remove_node(self, name: str) -> None:
        """Undo `add_node`."""
        ...

    def graph(self) -> Graph:
        """All live participants with their publishers, subscriptions and services, as far as this process knows."""
        ...

    def close(self) -> None:
        """Leave the domain; everything created through this bus is closed."""
        ...


class ProcessBus(Bus, Protocol):
    """A bus that reaches other processes, as `open_bus` returns it."""

    uid: str

    def ping(self, uid: str, timeout_s: float = 1.0) -> float | None:
        """The response time of a participant in seconds; None if it did not respond."""
        ...


class Closing(Protocol):
    """Something that can be closed."""

    def close(self) -> None: ...


@dataclass(frozen=True)
class Endpoint:
    """One node's end of a topic or service; `gid` identifies a publisher in its messages."""

    name: str
    type_name: str
    node: str
    latched: bool = False
    gid: str = ''


@dataclass(frozen=True)
class Participant:
    """One process on the bus. A listed one is alive, as reported by the kernel, or by a bridge for another machine."""

    uid: str
    pid: int
    host: str
    nodes: tuple[str, ...] = ()
    publishers: tuple[Endpoint, ...] = ()
    subscriptions: tuple[Endpoint, ...] = ()
    services: tuple[Endpoint, ...] = ()


@dataclass(frozen=True)
class Graph:
    """All participants of a domain."""

    participants: tuple[Participant, ...] = field(default_factory=tuple)

    def nodes(self) -> list[str]:
        """Full names of all nodes, sorted; a name that two nodes share is listed twice."""
        return sorted(node for participant in self.participants for node in participant.nodes)

    def publishers(self, topic: str | None = None) -> list[Endpoint]:
        return [end for peer in self.participants for end in peer.publishers if topic in {None, end.name}]

    def require_unpublished(self, topic: str) -> None:
        """Check that nothing else publishes a topic with one allowed publisher, such as the images of a camera.

        Publishers in a ROS 2 graph do not count, because it lists a killed node for some seconds more.

        Raises:
            ConfigurationError: a live process publishes the topic.
        """
        for peer in self.participants:
            for end in peer.publishers:
                if end.name == topic and peer.pid:
                    raise ConfigurationError(
                        f'{topic} is already published by {end.node}, process {peer.pid} on {peer.host}: stop that '
                        'node first, or give this sensor a namespace or a ROS_DOMAIN_ID of its own'
                    )

    def host_of(self, topic: str) -> str:
        """The machine whose process publishes `topic`; '' if there is no publisher or the machine is not known."""
        hosts = (peer.host for peer in self.participants for end in peer.publishers if end.name == topic)
        return next(hosts, '')

    def subscriptions(self, topic: str | None = None) -> list[Endpoint]:
        return [end for peer in self.participants for end in peer.subscriptions if topic in {None, end.name}]

    def services(self, name: str | None = None) -> list[Endpoint]:
        return [end for peer in self.participants for end in peer.services if name in {None, end.name}]

    def topics(self) -> dict[str, list[str]]:
        """Each topic with the types of its publishers and subscriptions."""
        found: dict[str, set[str]] = {}
        for end in self.publishers() + self.subscriptions():
            found.setdefault(end.name, set()).add(end.type_name)
        return {topic: sorted(found[topic]) for topic in sorted(found)}


class Received:
    """One received message.

    `source_ns` is the time of publication and `received_ns` the time of reception, both on the host's time base.
    `publisher` and `sequence` (from 1) identify it uniquely. Inside one process `message` is the publisher's own
    object, and `data` is encoded on demand. Between processes `data` is received, and `message` is decoded on demand.
    """

    __slots__ = ('_data', '_message', 'publisher', 'received_ns', 'sequence', 'source_ns', 'type_name')

    def __init__(
        self,
        type_name: str,
        publisher: str,
        sequence: int,
        source_ns: int,
        received_ns: int,
        *,
        message: Any = None,
        data: bytes | memoryview | None = None,
    ) -> None:
        self.type_name = type_name
        self.publisher = publisher
        self.sequence = sequence
        self.source_ns = source_ns
        self.received_ns = received_ns
        self._message = message
        self._data = data

    @property
    def message(self) -> Any:
        """The message; it is shared, so do not change it.

        Raises:
            MessageError: the bytes are not a message of the announced type.
        """
        if self._message is None:
            assert self._data is not None
            self._message = messages.decode(self._data, self.type_name)
        return self._message

    @property
    def data(self) -> bytes:
        """The CDR bytes, received or encoded on demand."""
        view = self.view
        return view if isinstance(view, bytes) else bytes(view)

    @property
    def view(self) -> bytes | memoryview:
        """The same as a view, without the copy that `bytes` may need."""
        if self._data is None:
            self._data = messages.encode_view(self._message)
        return self._data
