"""Joins the bus of this machine with that of another, over one TCP port; one such node a machine.

One side listens, the other connects. Topics are sent when somebody over there wants them; services, those of
parameters too, can be called from there; the nodes over there are in ``tactile node list``. Keys: ``tactile keys create
NAME`` on each side, then give each the other's public key.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

from tactile_nodes.bus.bridge.bridge import Bridge
from tactile_nodes.bus.bridge.keys import read_pair, read_public
from tactile_nodes.bus.bridge.link import PLAIN_TCP, Address, Link, Security
from tactile_nodes.bus.bridge.talk import Choice
from tactile_nodes.bus.node.arguments import NodeArguments
from tactile_nodes.bus.node.diagnostics import Level
from tactile_nodes.bus.node.node import Node, NodeParams
from tactile_nodes.bus.node.runtime import run_node
from tactile_nodes.bus.protocol import Bus
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.clock import Clock
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.params import parameter

_CHECK_PERIOD_S = 1.0
_CLOCKS_APART_MS = 5.0


@dataclass(frozen=True)
class BridgeParams(NodeParams):
    """Parameters of the bridge node."""

    listen: str = parameter(
        '', 'host:port to listen at (0.0.0.0:7460: all networks); or else set connect', read_only=True
    )
    connect: str = parameter('', "host:port of the other machine's bridge; or else set listen", read_only=True)
    key: str = parameter('', "name or path of this machine's own keys (tactile keys create NAME)", read_only=True)
    peers: tuple[str, ...] = parameter(
        (), 'public keys of the other machines that may connect: names, paths or keys', read_only=True
    )
    plain_tcp: str = parameter(
        '', f'to do without keys on a network, in words: {PLAIN_TCP}', choices=('', PLAIN_TCP), read_only=True
    )
    send: tuple[str, ...] = parameter(('/**',), 'topics that others may have (* one level, ** any)', read_only=True)
    receive: tuple[str, ...] = parameter(('/**',), 'topics to take from others', read_only=True)
    serve: tuple[str, ...] = parameter(('/**',), 'services that others may call', read_only=True)


class BridgeNode(Node):
    """Starts the bridge, and says how it is."""

    NAME = 'bridge'
    PARAMS = BridgeParams

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock)
        chosen = self.params
        if not isinstance(bus, ZmqBus):
            raise ConfigurationError('a bridge needs the bus between processes')
        if bool(chosen.listen) == bool(chosen.connect):
            raise ConfigurationError('set either listen or connect to host:port, say -p connect:=192.168.0.7:7460')
        self._place = Address.parse(chosen.listen or chosen.connect)
        security = _security(chosen)
        link = Link(
            self._place, listens=bool(chosen.listen), name=bus.uid, security=security, plain_tcp=chosen.plain_tcp
        )
        self._bridge = Bridge(bus, link, Choice(chosen.send, chosen.receive, chosen.serve))
        self._refused = 0
        self.create_timer(_CHECK_PERIOD_S, self._report)
        words = 'with keys' if security.own else 'WITHOUT KEYS'
        self.log.info(f'{"listens at" if chosen.listen else "connects to"} {self._place}, {words}')

    def on_close(self) -> None:
        self._bridge.close()

    def _report(self) -> None:
        connected = self._bridge.connected()
        if not connected:
            self.report('connection', Level.WARN, self._alone())
        for host, clock in connected:
            apart_ms = (clock.ahead_ns or 0) / 1e6
            level = Level.WARN if abs(apart_ms) > _CLOCKS_APART_MS else Level.OK
            words = 'their clock and ours are apart: let chrony or PTP set both' if level else 'connected'
            self.report(
                'connection', level, f'{host}: {words}', clock_ahead_ms=apart_ms, malformed=self._bridge.malformed
            )
        if self._bridge.refused > self._refused:
            self._refused = self._bridge.refused
            self.report('keys', Level.WARN, 'somebody was kept out whose key is not among the parameter peers')

    def _alone(self) -> str:
        if self.params.listen:
            return f'nobody is connected at {self._place}'
        return f'no answer from {self._place}; it keeps trying: does the bridge there run, and allow our key?'


def _security(chosen: BridgeParams) -> Security:
    if not chosen.key:
        return Security()
    if not chosen.peers:
        raise ConfigurationError('set peers to the public keys of the other machines; theirs print: tactile keys show')
    return Security(read_pair(chosen.key), tuple(map(read_public, chosen.peers)))


def main() -> int:
    """The program ``bridge_node``."""
    return run_node(BridgeNode)


if __name__ == '__main__':
    sys.exit(main())
