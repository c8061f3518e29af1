"""Connects the bus of this machine with those of other machines, over one TCP port; one such node per machine.

One side listens, the others connect. For a full mesh, each listens and connects to those before it, or searches
the network for the others (``discover``). Topics are sent if the other side subscribes to them. Services, including
parameter services, can be called from there. Remote nodes are listed by ``tactile node list``. Keys: run ``tactile keys
create NAME`` on each side, then copy each public key to the other side. Needs the extra `bridge`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import ClassVar

from tactile_nodes.bus.bridge.bridge import Bridge
from tactile_nodes.bus.bridge.finding import AGAIN_WITHIN, Finder, Group
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
    READ_ONLY: ClassVar[bool] = True

    listen: str = parameter('', 'host:port to listen on (0.0.0.0:7460: all networks)')
    connect: str = parameter('', 'host:port of the bridges of other machines, separated by commas')
    discover: bool = parameter(False, 'find the bridges of this network that listen on the same port, by multicast')
    key: str = parameter('', "name or path of this machine's own keys (tactile keys create NAME)")
    peers: tuple[str, ...] = parameter((), 'public keys of the other machines that may connect: names or paths')
    plain_tcp: str = parameter('', f'to use a network without keys, set this to: {PLAIN_TCP}', choices=('', PLAIN_TCP))
    send: tuple[str, ...] = parameter(('/**',), 'topics that others may receive (* one level, ** any)')
    receive: tuple[str, ...] = parameter(('/**',), 'topics to take from others')
    serve: tuple[str, ...] = parameter(('/**',), 'services that others may call')


class BridgeNode(Node):
    """Starts the bridge, and reports its state."""

    NAME = 'bridge'
    PARAMS = BridgeParams

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock)
        chosen = self.params
        if not isinstance(bus, ZmqBus):
            raise ConfigurationError('a bridge needs the bus between processes (TACTILE_BUS=zeromq)')
        self._host_bus = bus
        self._listen = Address.parse(chosen.listen) if chosen.listen else None
        self._connect = list(map(Address.parse, filter(None, chosen.connect.replace(' ', '').split(','))))
        if not (self._listen or self._connect):
            raise ConfigurationError('set listen or connect to host:port, e.g. -p connect:=192.168.0.7:7460')
        if chosen.discover and not self._listen:
            raise ConfigurationError('discover also needs listen, e.g. -p listen:=0.0.0.0:7460')
        self._security = _security(chosen)
        self._group = Group(self._listen) if chosen.discover and self._listen else None
        self._bridge, self._reopens, self._strange = self._opened(), False, False
        self._finder = Finder(self._group, self._security, chosen.plain_tcp) if self._group else None
        self.create_timer(_CHECK_PERIOD_S, self._report)
        if self._finder is not None:
            self.create_timer(_CHECK_PERIOD_S, self._find)
        self._say_ends()

    def _opened(self, further: Mapping[str, object] = MappingProxyType({})) -> Bridge:
        chosen, further = self.params, {**(self._group.settings() if self._group else {}), **further}
        session = open_session(self._listen, self._connect, self._security, chosen.plain_tcp, further)
        return Bridge(self._host_bus, session, Choice(chosen.send, chosen.receive, chosen.serve))

    def _say_ends(self) -> None:
        ends = [f'listens on {self._listen}'] if self._listen else []
        ends += ['searches for others'] if self._group else []
        ends += [f'connects to {", ".join(map(str, self._connect))}'] if self._connect else []
        self.log.info(f'{", ".join(ends)}; {"with keys" if self._security.own else "WITHOUT KEYS"}')

    def on_close(self) -> None:
        if self._finder is not None:
            self._finder.close()
        self._bridge.close()

    @property
    def outlived(self) -> bool:
        return super().outlived or not self._bridge.closed or (self._finder is not None and self._finder.trying)

    def _find(self) -> None:
        """Also connect to bridges that were found and are older than this one."""
        if self._finder is not None and not self._reopens:
            if not (missing := self._finder.missing(self._bridge.linked())):
                return
            self._connect += [each for each in missing if each not in self._connect]
            self._bridge.close()
            self._reopens = True
        if self._reopens and self._bridge.closed:
            self._bridge = self._opened(AGAIN_WITHIN)
            self._reopens = False
            self._say_ends()

    def _report(self) -> None:
        if connected := self._bridge.connected():
            self._report_connected([(host, (clock.ahead_ns or 0) / 1e6) for host, clock in connected])
        else:
            self.report('connection', Level.WARN, self._alone())
        versions = sorted(set(self._bridge.strangers.values()))
        if versions or self._strange:
            words = [f'a machine there has version {each} of the bridge, this one has {VERSION}' for each in versions]
            text = f'{"; ".join(words)}: update the older one' if versions else 'all machines have the same version'
            self.report('version', Level.WARN if versions else Level.OK, text)
        self._strange = bool(versions)

    def _report_connected(self, machines: list[tuple[str, float]]) -> None:
        """One report on all machines: `clock_ahead_ms` is that of the clock that is furthest off."""
        differ = 'the clocks of both machines differ: synchronize them with chrony or PTP'
        texts = [f'{host}: {differ if abs(ms) > _CLOCKS_APART_MS else "connected"}' for host, ms in machines]
        furthest_ms = max((ms for _, ms in machines), key=abs)
        level = Level.WARN if abs(furthest_ms) > _CLOCKS_APART_MS else Level.OK
        self.report('connection', level, '; '.join(texts), clock_ahead_ms=furthest_ms, malformed=self._bridge.malformed)

    def _alone(self) -> str:
        if self._group:
            return f'no bridge found that listens on port {self._group.listen.port} and allows our key; still searching'
        if not self._connect:
            return f'no bridge is connected to {self._listen}'
        ends = ', '.join(map(str, self._connect))
        return f'no response from {ends}; still trying: does the bridge run there, and does it allow our key?'


def _security(chosen: BridgeParams) -> Security:
    if not chosen.key:
        if chosen.peers:
            raise ConfigurationError(
                "peers has no effect without key: set key to the name of this machine's own keys (tactile keys create "
                'NAME), or leave peers out'
            )
        return Security()
    if not chosen.peers:
        raise ConfigurationError(
            'set peers to the public keys of the other machines; print them there with: tactile keys show NAME'
        )
    return Security(read_pair(chosen.key), tuple(map(read_public, chosen.peers)))


main = partial(run_node, BridgeNode)
