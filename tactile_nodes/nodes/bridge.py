"""Joins the bus of this machine with those of others, over one TCP port; one such node a machine.

One side listens, the others connect; for all to see all, each listens, and connects to those before it. Topics are sent
when somebody over there wants them; services, those of parameters too, can be called from there; the nodes over there
are in ``tactile node list``. Keys: ``tactile keys create NAME`` on each side, then give each the other's public key.
Needs the extra `bridge`.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

from tactile_nodes.bus.bridge.bridge import Bridge
from tactile_nodes.bus.bridge.keys import read_pair, read_public
from tactile_nodes.bus.bridge.link import PLAIN_TCP, Address, Security, open_session
from tactile_nodes.bus.bridge.talk import VERSION, Choice
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

    listen: str = parameter('', 'host:port to listen at (0.0.0.0:7460: all networks)', read_only=True)
    connect: str = parameter('', 'host:port of the bridges of other machines, with commas between', read_only=True)
    key: str = parameter('', "name or path of this machine's own keys (tactile keys create NAME)", read_only=True)
    peers: tuple[str, ...] = parameter(
        (), 'public keys of the other machines that may connect: names or paths', read_only=True
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
        listen = Address.parse(chosen.listen) if chosen.listen else None
        connect = tuple(map(Address.parse, filter(None, chosen.connect.replace(' ', '').split(','))))
        if not (listen or connect):
            raise ConfigurationError('set listen or connect to host:port, say -p connect:=192.168.0.7:7460')
        security = _security(chosen)
        session = open_session(listen, connect, security, chosen.plain_tcp)
        self._bridge = Bridge(bus, session, Choice(chosen.send, chosen.receive, chosen.serve))
        self.create_timer(_CHECK_PERIOD_S, self._report)
        words = 'with keys' if security.own else 'WITHOUT KEYS'
        ends = [f'listens at {listen}'] if listen else []
        ends += [f'connects to {", ".join(map(str, connect))}'] if connect else []
        self.log.info(f'{" and ".join(ends)}, {words}')

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
        for version in set(self._bridge.strangers.values()):
            words = f'a machine there speaks version {version} of the bridge, and this one {VERSION}: update the older'
            self.report('version', Level.WARN, words)

    def _alone(self) -> str:
        if not self.params.connect:
            return f'nobody is connected at {self.params.listen}'
        return f'no answer from {self.params.connect}; it keeps trying: does the bridge there run, and allow our key?'


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
