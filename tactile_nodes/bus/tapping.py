"""Forwards messages to clients outside the bus; a topic is received only while a client wants it."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from tactile_nodes.bus.protocol import Bus, Qos, Received
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.topics import default_qos
from tactile_nodes.errors import BusError

Key = tuple[str, str]
"""Full name and type of a topic."""
Post = Callable[[Callable[[], None]], None]
"""Runs work in a certain thread, soon."""
_SHORTEST_QUEUE = 16  # a waiting bridge must not lose messages that a direct subscriber would get


class Tap:
    """Subscriptions of `node` that come and go; `post` runs work in the thread in which `take` is called.

    Args:
        take: called with the full name of a topic and a message, in order of arrival.
    """

    def __init__(self, bus: Bus, node: str, post: Post, take: Callable[[str, Received], None]) -> None:
        self._bus = bus
        self._node = node
        self._post = post
        self._take = take
        self._subscriptions: dict[Key, Subscription] = {}
        self._woken = False

    @property
    def topics(self) -> frozenset[Key]:
        return frozenset(self._subscriptions)

    @property
    def dropped(self) -> int:
        """The number of dropped messages of the topics received now."""
        return sum(subscription.dropped for subscription in self._subscriptions.values())

    def keep(self, wanted: Iterable[Key]) -> None:
        """Receive exactly the topics in `wanted` from now on. A new subscription gets the latched message again.

        Raises:
            BusError: one of them cannot be received; the others are.
        """
        keys = set(wanted)
        failure: BusError | None = None
        for key in self._subscriptions.keys() - keys:
            self._subscriptions.pop(key).close()
        for key in sorted(keys - self._subscriptions.keys()):
            topic, type_name = key
            qos = Qos('queue', max(default_qos(topic).depth, _SHORTEST_QUEUE))
            try:
                self._subscriptions[key] = self._bus.subscribe(topic, type_name, qos, self._node, self._wake)
            except BusError as error:
                failure = error
            self._wake()
        if failure is not None:
            raise failure

    def close(self) -> None:
        self.keep(())

    def _wake(self) -> None:
        if not self._woken:
            self._woken = True
            self._post(self._drain)

    def _drain(self) -> None:
        self._woken = False  # before taking, so that later messages wake it again
        for (topic, _), subscription in list(self._subscriptions.items()):
            while (received := subscription.take()) is not None:
                self._take(topic, received)
