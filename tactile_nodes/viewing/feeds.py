"""What comes in from the bus, handed over when somebody is about to look at it."""

from __future__ import annotations

from collections.abc import Callable

from tactile_nodes.bus.protocol import Bus, Qos, Received
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.topics import Topic
from tactile_nodes.errors import MessageError

QUEUE = 1000  # more than comes between two looks, so that every frame is counted

Take = Callable[[Received], None]


class Feeds:
    """Subscriptions of `node`; `resolve` makes the full name of a topic. Bytes that are no message are counted only."""

    def __init__(self, bus: Bus, node: str, resolve: Callable[[str], str]) -> None:
        self.malformed = 0
        self._bus = bus
        self._node = node
        self._resolve = resolve
        self._feeds: list[tuple[Subscription, Take]] = []

    def add(self, topic: Topic, take: Take, keep: int = QUEUE) -> None:
        """From now on `take` gets what `topic` brings; of what comes between two looks the last `keep`."""
        qos = Qos('queue', keep)
        made = self._bus.subscribe(self._resolve(topic.name), topic.type_name, qos, self._node)
        self._feeds.append((made, take))

    def drain(self) -> None:
        """Hand over all that has come in."""
        for subscription, take in self._feeds:
            while (received := subscription.take()) is not None:
                self._hand_over(received, take)

    def close(self) -> None:
        """Receive no more."""
        for subscription, _ in self._feeds:
            subscription.close()
        self._feeds.clear()

    def _hand_over(self, received: Received, take: Take) -> None:
        try:
            take(received)
        except MessageError:
            self.malformed += 1
