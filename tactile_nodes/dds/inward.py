"""Topics of a ROS 2 graph for the nodes of the bus, such as an independent force sensor or the state of a robot."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from tactile_nodes import messages
from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus, LocalPublisher
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.bus.tapping import Post
from tactile_nodes.clock import NS_PER_S
from tactile_nodes.errors import ConfigurationError, MessageError

if TYPE_CHECKING:
    from tactile_nodes.dds.endpoints import CdrReader
    from tactile_nodes.dds.participant import Participant

_CLOCKS_APART_S = 0.5
_KEPT = 100  # samples of a robot's sensor at 1 kHz, while the bridge waits for its turn


@dataclass(frozen=True)
class Wish:
    """A topic to receive: its name as written, and its type."""

    topic: str
    type_name: str

    @classmethod
    def parse(cls, text: str) -> Wish:
        """Parse '/robot/wrench@geometry_msgs/msg/WrenchStamped'; the type is optional for names in the topic table.

        Raises:
            ConfigurationError: the type is missing, or does not exist.
        """
        name, _, kind = text.partition('@')
        topic = topics.in_table(name)
        kind = kind or (topic.type_name if topic else '')
        try:
            messages.message_class(kind)
        except MessageError as error:
            raise ConfigurationError(
                f'{text!r} is not a topic with a type; use topic@package/msg/Type, e.g. '
                '/robot/wrench@geometry_msgs/msg/WrenchStamped'
            ) from error
        return cls(name, kind)


class Inward:
    """Publishes messages of the graph on the bus, as `node`; bytes that are not a message are only counted."""

    def __init__(
        self, participant: Participant, bus: InProcessBus, node: str, wishes: Iterable[Wish], post: Post
    ) -> None:
        self.taken = 0
        self._clock = bus.clock
        self._apart_ns = 0
        self._flows = [_Flow(self, participant, bus, node, wish, post) for wish in wishes]

    @property
    def gids(self) -> tuple[bytes, ...]:
        return tuple(flow.reader.gid for flow in self._flows)

    def publishers(self) -> frozenset[str]:
        """The gids of its publishers on the bus."""
        return frozenset(publisher.gid for flow in self._flows for publisher in flow.publishers.values())

    @property
    def malformed(self) -> int:
        return sum(flow.reader.malformed for flow in self._flows)

    @property
    def apart_s(self) -> float:
        """The age of the last message by its header, on the clock of this bus; 0 if none was stamped."""
        return self._apart_ns / NS_PER_S

    @property
    def complaint(self) -> str:
        """Why received messages should not be compared with measurements made here; empty if they can be."""
        if abs(self.apart_s) < _CLOCKS_APART_S:
            return ''
        return f'messages are stamped {self.apart_s:+.3f} s before their arrival: the clocks differ'

    def pass_on(self, publisher: LocalPublisher, data: bytes) -> None:
        """Publish the data. Raises MessageError: they are not a message of that type."""
        message = messages.decode(data, publisher.type_name)
        stamp_ns = messages.stamp_ns(message.header.stamp) if hasattr(message, 'header') else 0
        # A stamp that is not set, or that of a latched message of before, is no clock that differs.
        if stamp_ns and not topics.default_qos(publisher.topic).latched:
            self._apart_ns = self._clock.now_ns() - stamp_ns
        publisher.publish_bytes(data)
        self.taken += 1

    def close(self) -> None:
        for publisher in [publisher for flow in self._flows for publisher in flow.publishers.values()]:
            publisher.close()
        self._flows.clear()


class _Flow:
    """A topic; each latched writer has its own publisher here, as the bus keeps the last message of each publisher."""

    def __init__(
        self, inward: Inward, participant: Participant, bus: InProcessBus, node: str, wish: Wish, post: Post
    ) -> None:
        # Not reliable, so that it matches every publisher. Only latched ones, which are reliable in ROS 2, send again.
        usual = topics.default_qos(wish.topic)
        self._qos = qos = Qos('queue', max(usual.depth, _KEPT), latched=usual.latched, reliable=usual.latched)
        self._inward = inward
        self._offer = partial(bus.advertise, wish.topic, wish.type_name, qos, node)
        self.publishers = {0: self._offer()}
        self.reader: CdrReader = participant.reader(wish.topic, wish.type_name, qos, lambda: post(self.drain))

    def drain(self) -> None:
        """Pass on received messages; called in the thread in which `post` runs work."""
        while found := self.reader.take():
            for writer, data in found:
                try:
                    self._inward.pass_on(self._publisher_of(writer if self._qos.latched else 0), data)
                except MessageError:
                    self.reader.malformed += 1

    def _publisher_of(self, writer: int) -> LocalPublisher:
        if writer not in self.publishers:
            for gone in self.publishers.keys() - {0} - self.reader.writers:
                self.publishers.pop(gone).close()
            self.publishers[writer] = self._offer()
        return self.publishers[writer]
