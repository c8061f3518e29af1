"""Subscriptions whose messages are handed over on demand."""

from __future__ import annotations

from collections.abc import Callable

from tactile_nodes.bus.protocol import Bus, Qos, Received
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.topics import Topic
from tactile_nodes.errors import MessageError

QUEUE = 1000  # more than arrives between two polls, so that every frame is counted

Take = Callable[[Received], None]


class Feeds:
    """Subscriptions of `node`; `resolve` gives the full name of a topic. Invalid messages are only counted."""

    def __init__(self, bus: Bus, node: str, resolve: Callable[[str], str]) -> None:
        self.malformed = 0
        self._bus = bus
        self._node = node
        self._resolve = resolve
        self._feeds: list[tuple[Subscription, Take]] = []

    def add(self, topic: Topic, take: Take, keep: int = QUEUE) -> None:
        """Call `take` with the messages of `topic`; of those between two polls, the last `keep`."""
        qos = Qos('queue', keep)
        subscription = self._bus.subscribe(self._resolve(topic.name), topic.type_name, qos, self._node)
        self._feeds.append((subscription, take))

    def drain(self) -> None:
        for subscription, take in self._feeds:
            while (received := subscription.take()) is not None:
                self._hand_over(received, take)

    def close(self) -> None:
        for subscription, _ in self._feeds:
            subscription.close()
        self._feeds.clear()

    def _hand_over(self, received: Received, take: Take) -> None:
        try:
            take(received)
        except MessageError:
            self.malformed += 1
