"""Shows the nodes of this bus in a ROS 2 graph, without a local ROS 2 installation; one such node per machine.

Each node appears there under its own name with its own topics, in ``ros2 node list``, ``topic list``, ``topic echo``
and RViz. ``take`` brings topics of the graph to this bus. Parameters and services are not bridged. Needs the extra
`dds`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.arguments import NodeArguments
from tactile_nodes.bus.node.diagnostics import Level
from tactile_nodes.bus.node.node import Node, NodeParams
from tactile_nodes.bus.node.runtime import run_node
from tactile_nodes.bus.protocol import Bus
from tactile_nodes.bus.zeromq.discovery import domain_from_environment
from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.dds.inward import Inward, Wish
from tactile_nodes.dds.opening import open_participant
from tactile_nodes.dds.outward import BRIDGE, Outward, other_bridges
from tactile_nodes.dds.settings import LOCALHOST, RANGE_VARIABLE, SUBNET, Discovery
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.params import parameter

LOOK_EVERY_S = 0.2
_REPORT_PERIOD_S = 1.0


@dataclass(frozen=True)
class DdsBridgeParams(NodeParams):
    READ_ONLY: ClassVar[bool] = True

    discovery_range: str = parameter(
        '',
        f'{LOCALHOST}: this machine only; {SUBNET}: the network too; empty: as {RANGE_VARIABLE}, or {LOCALHOST}',
        choices=('', LOCALHOST, SUBNET),
    )
    peers: tuple[str, ...] = parameter(
        (), f'further machines to contact if {SUBNET} does not find them: names or addresses'
    )
    send: tuple[str, ...] = parameter(('/**',), 'topics to show there (* one level, ** any)')
    take: tuple[str, ...] = parameter(
        (), 'topics to bring here: name@package/msg/Type; the type is needed for names outside the topic table'
    )


class DdsBridgeNode(Node):
    """Opens the participant, and tracks nodes and topics on both sides."""

    NAME = BRIDGE
    PARAMS = DdsBridgeParams

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock)
        chosen: DdsBridgeParams = self.params
        if not isinstance(bus, InProcessBus):
            raise ConfigurationError('this bus is already a ROS 2 graph; no DDS bridge is needed')
        if others := other_bridges(bus.graph(), self.full_name):
            raise ConfigurationError(f'{others[0]} already shows this bus over DDS, with all namespaces; one is enough')
        wishes = [Wish.parse(text) for text in chosen.take if text]
        discovery = Discovery.chosen(chosen.discovery_range, chosen.peers)
        domain_id = domain_from_environment()
        self._participant = open_participant(domain_id, discovery)
        warn = lambda text: self.log.warn(text, once=text)  # noqa: E731
        resolved = [Wish(self.names.resolve(wish.topic), wish.type_name) for wish in wishes]
        self._in = Inward(self._participant, bus, self.full_name, resolved, self.post)
        came = self._in.publishers
        self._out = Outward(self._participant, bus, self.full_name, chosen.send, self.post, warn, came)
        self._look()
        self.create_timer(LOOK_EVERY_S, self._look)
        self.create_timer(_REPORT_PERIOD_S, self._report)
        reach = 'this machine only' if discovery.is_local else 'the network'
        self.log.info(f'shown in DDS domain {domain_id} to {reach}')

    def on_close(self) -> None:
        self._out.close()
        self._in.close()
        self._participant.close()

    def _look(self) -> None:
        nodes = self._out.look()
        nodes[self.full_name] = replace(nodes[self.full_name], readers=self._in.gids)
        self._participant.tell(nodes)
        for line in self._participant.log_lines(self.bus.clock.now_ns() / NS_PER_S):
            self.log.warn(line)

    def _report(self) -> None:
        out, came, sayings = self._out, self._in, self._participant.sayings
        trouble = f'messages that could not be sent: {out.failed}' if out.failed else came.complaint
        self.report(
            'graph', Level.WARN if trouble else Level.OK, trouble, readers=out.readers, sent=out.forwarded,
            dropped=out.dropped, failed=out.failed, taken=came.taken, malformed=came.malformed,
            malformed_packets=sayings.malformed, taken_age_s=came.apart_s,
        )  # fmt: skip


main = partial(run_node, DdsBridgeNode)
