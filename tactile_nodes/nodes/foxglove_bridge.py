"""Shows every topic in Foxglove or Lichtblick on this machine; nothing can be changed from there.

A topic is received only while a panel draws it.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

from tactile_nodes.bus.node.arguments import NodeArguments
from tactile_nodes.bus.node.diagnostics import Level
from tactile_nodes.bus.node.node import Node, NodeParams
from tactile_nodes.bus.node.runtime import run_node
from tactile_nodes.bus.protocol import Bus
from tactile_nodes.clock import Clock
from tactile_nodes.foxglove_view.server import FoxgloveServer
from tactile_nodes.foxglove_view.showing import Showing
from tactile_nodes.params import parameter
from tactile_nodes.paths import share_directory
from tactile_nodes.web.guard import Guests, is_loopback
from tactile_nodes.web.port import listen

LOOK_EVERY_S = 0.2
_REPORT_PERIOD_S = 1.0
ORIGINS = ('https://app.foxglove.dev', 'file://', 'http://localhost:8080', 'http://127.0.0.1:8080')
"""Foxglove in a browser, applications of the desktop, and Lichtblick as it is served to a browser of this machine."""


@dataclass(frozen=True)
class FoxgloveBridgeParams(NodeParams):
    """Parameters of the Foxglove bridge."""

    address: str = parameter(
        '127.0.0.1', 'address to serve at; from other machines only guests come, see there', read_only=True
    )
    port: int = parameter(
        8765, 'port to serve at, or the next one that is free; 0: any', minimum=0, maximum=65535, read_only=True
    )
    origins: tuple[str, ...] = parameter(
        ORIGINS, 'where pages in a browser may come from that look (docs/foxglove.md)', read_only=True
    )
    host_names: tuple[str, ...] = parameter((), 'names, besides addresses, to be reached by', read_only=True)
    guests: str = parameter(
        Guests.NONE.value,
        'what other accounts of this machine, and other machines, may: nothing, or watch',
        choices=[Guests.NONE.value, Guests.WATCH.value],
        read_only=True,
    )
    topics: tuple[str, ...] = parameter(('/**',), 'topics to show (* one level, ** any)', read_only=True)


class FoxgloveBridgeNode(Node):
    """Opens the server, and looks at who publishes and who watches."""

    NAME = 'foxglove_bridge'
    PARAMS = FoxgloveBridgeParams

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock)
        chosen: FoxgloveBridgeParams = self.params
        listening = listen(chosen.address, chosen.port, 'Foxglove', 'port:=')
        self.server = FoxgloveServer(
            listening, self._on_interest, self.log.warn, chosen.origins, chosen.host_names,
            guests=chosen.guests == Guests.WATCH.value,
        )  # fmt: skip
        warn = lambda text: self.log.warn(text, once=text)  # noqa: E731
        self._showing = Showing(self.server, bus, self.full_name, chosen.topics, self.post, warn)
        self._showing.look()
        self.create_timer(LOOK_EVERY_S, self._showing.look)
        self.create_timer(_REPORT_PERIOD_S, self._report)
        self._announce()

    def on_close(self) -> None:
        self._showing.close()
        self.server.close()

    def _announce(self) -> None:
        layout = share_directory() / 'config' / 'foxglove' / 'tactile.json'
        server, address = self.server, self.params.address
        self.log.info(
            f'serving {server.address}; open {server.link} or connect Lichtblick; a layout to import: {layout}'
        )
        if self.params.guests == Guests.WATCH.value:
            who = 'every account of this machine' if is_loopback(address) else f'anyone who reaches {address}'
            self.log.warn(f'{who} can watch')
        elif not is_loopback(address):
            self.log.warn(f'{address} is open to other machines, but only guests come from there: set guests')

    def _on_interest(self, topic: str) -> None:
        """In a thread of the server's."""
        self.post(lambda: self._showing.welcome(topic))

    def _report(self) -> None:
        shown = self._showing
        self.report(
            'foxglove', Level.OK, '', topics=shown.offered, watched=shown.watched, shown=shown.shown,
            dropped=shown.dropped, turned_away=self.server.door.refused, refused=self.server.complaints.refused,
        )  # fmt: skip


def main() -> int:
    """The program ``foxglove_bridge_node``."""
    return run_node(FoxgloveBridgeNode)


if __name__ == '__main__':
    sys.exit(main())
