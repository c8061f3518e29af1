"""The topics of the bus as channels, each received only while it has viewers."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from tactile_nodes.bus.bridge.talk import fits
from tactile_nodes.bus.protocol import Bus, Received
from tactile_nodes.bus.tapping import Post, Tap
from tactile_nodes.errors import MessageError

if TYPE_CHECKING:
    from tactile_nodes.foxglove_view.server import FoxgloveServer


class Showing:
    """Shows the topics that match `topics`. When a viewer comes, all viewers get the latched messages again.

    Args:
        post: runs work in the thread that calls `look`.
        refuse: called once for each topic that cannot be shown.
    """

    def __init__(
        self,
        server: FoxgloveServer,
        bus: Bus,
        node: str,
        topics: tuple[str, ...],
        post: Post,
        refuse: Callable[[str], None],
    ) -> None:
        self.shown = 0
        self._server = server
        self._bus = bus
        self._topics = topics
        self._refuse = refuse
        self._tap = Tap(bus, node, post, self._take)
        self._types: dict[str, str] = {}
        self._refused: set[str] = set()
        self._latched: set[str] = set()
        self._last: dict[str, dict[str, Received]] = {}

    @property
    def offered(self) -> int:
        return len(self._types)

    @property
    def watched(self) -> int:
        return len(self._tap.topics)

    @property
    def dropped(self) -> int:
        """The number of messages dropped because they waited here for too long."""
        return self._tap.dropped

    def look(self) -> None:
        """Update to the present publishers and viewers."""
        ends = [end for end in self._bus.graph().publishers() if fits(end.name, self._topics)]
        found = {end.name: end.type_name for end in ends if end.name not in self._refused}
        self._latched = {end.name for end in ends if end.latched}
        for topic in self._types.keys() - found.keys():
            self._server.withdraw(topic)
            del self._types[topic]
        for topic in sorted(found.keys() - self._types.keys()):
            self._offer(topic, found[topic])
        watched = [(topic, kind) for topic, kind in self._types.items() if self._server.is_watched(topic)]
        self._last = {topic: self._last[topic] for topic, _ in watched if topic in self._last}
        self._tap.keep(watched)

    def welcome(self, topic: str) -> None:
        """Call when a topic has gained or lost a viewer."""
        for received in list(self._last.get(topic, {}).values()):
            self._show(topic, received)
        self.look()

    def close(self) -> None:
        self._tap.close()

    def _offer(self, topic: str, type_name: str) -> None:
        try:
            self._server.offer(topic, type_name)
            self._types[topic] = type_name
        except MessageError as error:
            self._refused.add(topic)
            self._refuse(f'{topic} is not shown: {error}')

    def _take(self, topic: str, received: Received) -> None:
        if topic in self._types:
            if topic in self._latched:
                self._last.setdefault(topic, {})[received.publisher] = received
            self._show(topic, received)

    def _show(self, topic: str, received: Received) -> None:
        self._server.show(topic, received.data, received.source_ns)
        self.shown += 1
