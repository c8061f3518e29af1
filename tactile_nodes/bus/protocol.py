"""What every transport offers: the seam at which ZeroMQ, one process and ROS 2 are exchanged for each other."""

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
    """How a topic is kept for a subscriber.

    `latest`: only the newest `depth` messages count; older ones give way (a camera image, a force).
    `queue`: every message counts; up to `depth` wait, then the oldest is dropped and counted (force/torque samples).
    `latched`: the publisher's last message is also given to those who come later (a rest image).
    `reliable`: what is lost on a network is sent again; of meaning on the ROS 2 bus alone.
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
        """How many would get what is published now; a process that receives counts once."""
        ...

    def publish(self, message: Any) -> None:
        """Hand `message` to every subscriber; its arrays become read-only, because nodes of this process share it."""
        ...

    def publish_bytes(self, data: bytes) -> None:
        """The same for CDR bytes that are already there (a replayed bag)."""
        ...

    def close(self) -> None:
        """Stop offering the topic; closing twice is harmless."""
        ...


Reply = Callable[[Any], None]
"""Takes the response message of a service call, or the exception that kept it from being made."""

ServiceHandler = Callable[[Any, Reply], None]
"""Called with a request and with the function to answer it, at once or later, from any thread."""


class Bus(Protocol):
    """One process's connection to all others of its domain; `clock` gives the stamps of its messages."""

    clock: Clock

    def advertise(self, topic: str, type_name: str, qos: Qos, node: str = '') -> Publisher:
        """Offer `topic` (a full name, '/skin/force'); several publishers of a topic are welcome."""
        ...

    def subscribe(
        self, topic: str, type_name: str, qos: Qos, node: str = '', on_ready: Callable[[], None] | None = None
    ) -> Subscription:
        """Receive `topic` from all its publishers, present and future.

        `on_ready` is called, from any thread, after each message that came in; it must return at once.
        """
        ...

    def serve(self, service: str, type_name: str, handler: ServiceHandler, node: str = '') -> Closing:
        """Answer calls of `service`."""
        ...

    def call(self, service: str, type_name: str, request: Any, timeout_s: float = 5.0) -> Any:
        """The response of `service` to `request`.

        Raises:
            ServiceUnavailableError: nobody serves it.
            ServiceTimeoutError: no answer within `timeout_s`.
            ServiceError: the node that serves it refused or failed.
        """
        ...

    def add_node(self, name: str) -> None:
        """Tell the others of a node of this process."""
        ...

    def remove_node(self, name: str) -> None:
        """Take back `add_node`."""
        ...

    def graph(self) -> Graph:
        """Who is alive, and what they offer and receive, as far as this process knows."""
        ...

    def close(self) -> None:
        """Leave; whatever was created through this bus ends with it."""
        ...


class ProcessBus(Bus, Protocol):
    """A bus that reaches beyond its process, as `open_bus` gives it."""

    uid: str

    def ping(self, uid: str, timeout_s: float = 1.0) -> float | None:
        """The seconds that a participant took to answer; None when it did not."""
        ...


class Closing(Protocol):
    """Something that can be closed."""

    def close(self) -> None: ...


@dataclass(frozen=True)
class Endpoint:
    """One node's end of a topic or service; `gid` is the name under which a publisher's messages come in."""

    name: str
    type_name: str
    node: str
    latched: bool = False
    gid: str = ''


@dataclass(frozen=True)
class Participant:
    """One process on the bus. One that is listed is alive: the kernel says so, or, of another machine's, a bridge."""

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
        """For what one node alone may publish, as a camera's pictures: of two by turns nobody could make sense.

        Ends of a ROS 2 graph do not count, which is told late: a camera that was killed is in it for seconds.

        Raises:
            ConfigurationError: a process that is there publishes it.
        """
        for peer in self.participants:
            for end in peer.publishers:
                if end.name == topic and peer.pid:
                    raise ConfigurationError(
                        f'{topic} is already published by {end.node} of process {peer.pid}: stop that node first, or '
                        'give this sensor a namespace or a ROS_DOMAIN_ID of its own'
                    )

    def host_of(self, topic: str) -> str:
        """The machine whose process publishes `topic`; '' of nobody, or where the graph does not tell."""
        hosts = (peer.host for peer in self.participants for end in peer.publishers if end.name == topic)
        return next(hosts, '')

    def subscriptions(self, topic: str | None = None) -> list[Endpoint]:
        return [end for peer in self.participants for end in peer.subscriptions if topic in {None, end.name}]

    def services(self, name: str | None = None) -> list[Endpoint]:
        return [end for peer in self.participants for end in peer.services if name in {None, end.name}]

    def topics(self) -> dict[str, list[str]]:
        """Each topic with the types that it is published or subscribed as."""
        found: dict[str, set[str]] = {}
        for end in self.publishers() + self.subscriptions():
            found.setdefault(end.name, set()).add(end.type_name)
        return {topic: sorted(found[topic]) for topic in sorted(found)}


class Received:
    """One message as it came in.

    `source_ns` is when it was published, `received_ns` when it came in, both on the host's time base; `publisher`
    and `sequence` (from 1) name it uniquely. Inside one process `message` is the publisher's own object and `data` is
    encoded only if somebody asks; between processes it is the other way round.
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
        """The message; shared, so not to be changed.

        Raises:
            MessageError: the bytes are no message of the announced type.
        """
        if self._message is None:
            assert self._data is not None
            self._message = messages.decode(self._data, self.type_name)
        return self._message

    @property
    def data(self) -> bytes:
        """The CDR bytes that travelled (or would have)."""
        view = self.view
        return view if isinstance(view, bytes) else bytes(view)

    @property
    def view(self) -> bytes | memoryview:
        """The same without the copy that making `bytes` of it may cost."""
        if self._data is None:
            self._data = messages.encode_view(self._message)
        return self._data
