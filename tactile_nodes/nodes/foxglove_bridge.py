"""Shows every topic in Foxglove or Lichtblick on this machine, read-only.

A topic is received only while a panel draws it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import ClassVar

from tactile_nodes.bus.node.arguments import NodeArguments
from tactile_nodes.bus.node.diagnostics import Level
from tactile_nodes.bus.node.node import Node, NodeParams
from tactile_nodes.bus.node.runtime import run_node
from tactile_nodes.bus.protocol import Bus
from tactile_nodes.clock import Clock
from tactile_nodes.foxglove_view.protocol import link
from tactile_nodes.foxglove_view.server import FoxgloveServer
from tactile_nodes.foxglove_view.showing import Showing
from tactile_nodes.params import parameter
from tactile_nodes.paths import share_directory
from tactile_nodes.web.guard import Guests, is_loopback
from tactile_nodes.web.port import listen

LOOK_EVERY_S = 0.2
_REPORT_PERIOD_S = 1.0
ORIGINS = ('https://app.foxglove.dev', 'file://', 'http://localhost:8080', 'http://127.0.0.1:8080')
"""Foxglove in a browser, desktop applications, and Lichtblick served to a browser of this machine."""


@dataclass(frozen=True)
class FoxgloveBridgeParams(NodeParams):
    READ_ONLY: ClassVar[bool] = True

    address: str = parameter(
        '127.0.0.1', 'address to serve on; connections from other machines count as guests, see `guests`'
    )
    port: int = parameter(8765, 'port to serve on, or the next free one; 0: any', minimum=0, maximum=65535)
    origins: tuple[str, ...] = parameter(ORIGINS, 'allowed origins of web pages (docs/foxglove.md)')
    host_names: tuple[str, ...] = parameter((), 'host names, besides addresses, under which it may be reached')
    guests: str = parameter(
        Guests.NONE.value,
        'what other users of this machine, and other machines, may do: nothing, or watch',
        choices=[Guests.NONE.value, Guests.WATCH.value],
    )
    topics: tuple[str, ...] = parameter(('/**',), 'topics to show (* one level, ** any)')


class FoxgloveBridgeNode(Node):
    """Opens the server, and tracks publishers and viewers."""

    NAME = 'foxglove_bridge'
    PARAMS = FoxgloveBridgeParams

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock)
        chosen: FoxgloveBridgeParams = self.params
        listening = listen(chosen.address, chosen.port, 'Foxglove', 'port:= (when launched: foxglove_port:=)')
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
        served, address = self.server.address, self.params.address
        self.log.info(f'serving {served}; open {link(served)} or connect Lichtblick; layout to import: {layout}')
        if self.params.guests == Guests.WATCH.value:
            who = 'every user of this machine' if is_loopback(address) else f'anyone who can reach {address}'
            self.log.warn(f'{who} can watch')
        elif not is_loopback(address):
            self.log.warn(f'{address} is reachable from other machines, but they count as guests: set guests')

    def _on_interest(self, topic: str) -> None:
        """Called in a thread of the server."""
        self.post(lambda: self._showing.welcome(topic))

    def _report(self) -> None:
        shown = self._showing
        self.report(
            'foxglove', Level.OK, '', topics=shown.offered, watched=shown.watched, shown=shown.shown,
            dropped=shown.dropped, turned_away=self.server.door.refused, refused=self.server.complaints.refused,
        )  # fmt: skip


main = partial(run_node, FoxgloveBridgeNode)
