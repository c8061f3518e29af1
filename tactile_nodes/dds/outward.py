"""The nodes of the bus in a ROS 2 graph: each has its name there, and each of its topics its own writer."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from tactile_nodes.bus import topics
from tactile_nodes.bus.bridge.talk import fits
from tactile_nodes.bus.protocol import Bus, Endpoint, Graph, Received
from tactile_nodes.bus.tapping import Post, Tap
from tactile_nodes.dds.names import NodeEnds
from tactile_nodes.errors import BusError, ConfigurationError, MessageError

if TYPE_CHECKING:
    from tactile_nodes.dds.endpoints import CdrWriter
    from tactile_nodes.dds.participant import Participant

BRIDGE = 'dds_bridge'
_ROSOUT_LIFESPAN_S = 10.0  # rmw_qos_profile_rosout_default


class Outward:
    """Sends topics that match `send` to the graph; a topic without readers there is not received from the bus.

    Args:
        post: runs work in the thread that calls `look`.
        refuse: called once for each publisher that cannot be bridged.
        came: returns the gids of publishers whose messages came from the graph, and are not sent back.
    """

    def __init__(
        self,
        participant: Participant,
        bus: Bus,
        node: str,
        send: tuple[str, ...],
        post: Post,
        refuse: Callable[[str], None],
        came: Callable[[], frozenset[str]],
    ) -> None:
        self.forwarded = self.failed = 0
        self._participant = participant
        self._bus = bus
        self._send = send
        self._refuse = refuse
        self._came = came
        self._tap = Tap(bus, node, post, self._take)
        self._ends: dict[str, Endpoint] = {}
        self._writers: dict[str, CdrWriter] = {}
        self._refused: set[str] = set()
        self._unknown: set[str] = set()

    @property
    def readers(self) -> int:
        return sum(writer.readers for writer in self._writers.values())

    @property
    def dropped(self) -> int:
        """Messages dropped because a reader was too far behind, or because they waited here for too long."""
        return self._tap.dropped + sum(writer.dropped for writer in self._writers.values())

    def look(self) -> dict[str, NodeEnds]:
        """Update to the present publishers on the bus and readers in the graph. Returns the nodes shown there."""
        graph, came = self._bus.graph(), self._came()
        ends = {end.gid: end for end in graph.publishers() if end.gid not in {'', *came} and fits(end.name, self._send)}
        for gid in self._writers.keys() - ends.keys():
            del self._writers[gid]
        for gid in ends.keys() - self._writers.keys() - self._refused:
            self._offer(gid, ends[gid])
        self._ends = ends
        self._unknown.clear()
        self._tap.keep((ends[gid].name, ends[gid].type_name) for gid in self._writers if self._is_wanted(gid))
        return self._nodes(graph.nodes())

    def close(self) -> None:
        self._tap.close()
        self._writers.clear()

    def _offer(self, gid: str, end: Endpoint) -> None:
        table = topics.default_qos(end.name)
        rosout = end.name == topics.ROSOUT.name  # as in ROS 2, late subscribers get earlier messages
        qos = replace(table, latched=end.latched or rosout)
        try:
            lifespan_s = _ROSOUT_LIFESPAN_S if rosout else None
            self._writers[gid] = self._participant.writer(end.name, end.type_name, qos, lifespan_s)
        except (BusError, MessageError) as error:
            self._refused.add(gid)
            self._refuse(f'{end.name} of {end.node} is not shown: {error}')

    def _is_wanted(self, gid: str) -> bool:
        end = self._ends[gid]
        return end.latched or end.name == topics.ROSOUT.name or self._writers[gid].readers > 0

    def _nodes(self, names: list[str]) -> dict[str, NodeEnds]:
        gids: dict[str, list[bytes]] = defaultdict(list, {name: [] for name in names})
        for gid, writer in self._writers.items():
            gids[self._ends[gid].node].append(writer.gid)
        return {name: NodeEnds(tuple(sorted(found))) for name, found in gids.items() if name}

    def _take(self, topic: str, received: Received) -> None:
        del topic
        gid = received.publisher
        if gid not in self._writers and gid not in self._unknown:
            self.look()  # a new node whose first messages must not be lost
            self._unknown.add(gid)
        writer = self._writers.get(gid)
        if writer is None:
            return
        try:
            writer.write(received.view)
            self.forwarded += 1
        except BusError:
            self.failed += 1


def other_bridges(graph: Graph, own: str) -> list[str]:
    """The bridges of this kind on this bus, except the one with the full name `own`.

    Raises:
        ConfigurationError: that one was renamed, and the others, which know a bridge by its name, would not see it.
    """
    if own.rpartition('/')[2] != BRIDGE:
        raise ConfigurationError(
            f'a DDS bridge must be called {BRIDGE}, because others know it by this name: leave out the remap __node:='
            f'{own.rpartition("/")[2]}; a namespace is allowed'
        )
    found = [node for node in graph.nodes() if node.rpartition('/')[2] == BRIDGE]
    found.remove(own)
    return found
