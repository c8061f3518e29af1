"""The live view in the browser: a page on this machine, with picture, motion, force, health and a few buttons.

Subscribes ``/diagnostics``, ``/rosout``, ``calibration_state``, ``force_distribution`` and ``true_force_distribution``,
and, while somebody watches, ``image_raw``, ``flow_features`` and ``force_field``.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

from tactile_nodes.bus import topics
from tactile_nodes.bus.node.arguments import NodeArguments
from tactile_nodes.bus.node.diagnostics import Level
from tactile_nodes.bus.node.node import Node, NodeParams
from tactile_nodes.bus.node.runtime import run_node
from tactile_nodes.bus.protocol import Bus
from tactile_nodes.clock import Clock
from tactile_nodes.params import parameter
from tactile_nodes.viewing.feeds import Feeds
from tactile_nodes.web import guard
from tactile_nodes.web.controls import Controls, Outcome
from tactile_nodes.web.guard import Guests
from tactile_nodes.web.opening import open_page
from tactile_nodes.web.scene import Scene

LOOK_EVERY_S = 0.5
IMAGES = 4  # kept between two looks


@dataclass(frozen=True)
class LiveViewParams(NodeParams):
    """Parameters of the live view."""

    address: str = parameter(
        '127.0.0.1', 'address to serve at; from other machines only guests come, see there', read_only=True
    )
    port: int = parameter(
        7470, 'port to serve at, or the next free one; 0: any', minimum=0, maximum=65535, read_only=True
    )
    host_names: tuple[str, ...] = parameter((), 'names, besides addresses, to be reached by', read_only=True)
    guests: str = parameter(
        Guests.NONE.value,
        'what other accounts of this machine, and other machines, may: nothing, watch, or act as well',
        choices=[each.value for each in Guests],
        read_only=True,
    )
    rate_hz: float = parameter(30.0, 'looks a second', minimum=1.0, maximum=60.0, read_only=True)
    viewers: int = parameter(16, 'pages at most that watch at once', minimum=1, maximum=100, read_only=True)


class LiveViewNode(Node):
    """Looks at what has come in, and shows it to those who watch; while nobody does, it takes in no pictures."""

    NAME = 'live_view'
    PARAMS = LiveViewParams

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock)
        chosen: LiveViewParams = self.params
        self._scene = Scene(self.names.namespace, bus.clock.now_ns())
        self._controls = Controls(bus, self.names.namespace)
        self._health = Feeds(bus, self.full_name, self.names.resolve)
        self._health.add(topics.DIAGNOSTICS, self._scene.add_diagnostics)
        self._health.add(topics.ROSOUT, self._scene.add_log)
        self._health.add(topics.CALIBRATION_STATE, self._scene.add_calibration)
        self._forces = Feeds(bus, self.full_name, self.names.resolve)
        self._forces.add(topics.TRUE_FORCE, self._scene.add_truth)
        self._forces.add(topics.FORCE_DISTRIBUTION, self._scene.add_force)
        self._pictures = Feeds(bus, self.full_name, self.names.resolve)
        self._watched = False
        self.server = open_page(
            chosen.address, chosen.port, self._act, lambda: self.post(self._look), self.log.warn,
            Guests(chosen.guests), chosen.host_names, chosen.viewers,
        )  # fmt: skip
        self._announce()
        self.create_timer(1.0 / chosen.rate_hz, self._show)
        self.create_timer(LOOK_EVERY_S, self._look)

    def on_close(self) -> None:
        self.server.close()
        for feeds in (self._pictures, self._forces, self._health):
            feeds.close()

    def _announce(self) -> None:
        self.log.info(f'the live view is at {self.server.url}')
        guests, is_alone = Guests(self.params.guests), guard.is_loopback(self.params.address)
        if guests is not Guests.NONE:
            may = 'watch and press the buttons' if guests is Guests.ACT else 'watch'
            who = 'every account of this machine' if is_alone else f'anyone who reaches {self.params.address}'
            self.log.warn(f'{who} can {may}')
        elif not is_alone:
            self.log.warn(
                f'{self.params.address} is open to other machines, but only guests come from there: set guests'
            )

    def _look(self) -> None:
        """Who watches, and whom the buttons would reach."""
        server, watching = self.server, self.server.watching
        self.report(
            'page', Level.OK, f'{server.url}, {watching or "nobody"} watching', viewers=watching,
            turned_away=server.door.refused, refused=server.complaints.refused,
        )  # fmt: skip
        self._health.drain()
        if watching:
            self._scene.controls = self._controls.available()
        if bool(watching) != self._watched:
            self._watched = bool(watching)
            self._open() if watching else self._pictures.close()

    def _open(self) -> None:
        self._scene.look_again()
        self._pictures.add(topics.IMAGE, self._scene.add_image, keep=IMAGES)
        self._pictures.add(topics.FLOW_FEATURES, self._scene.add_motion, keep=IMAGES)
        self._pictures.add(topics.FORCE_FIELD, self._scene.add_field, keep=IMAGES)

    def _show(self) -> None:
        self._forces.drain()  # first: what belongs to a force is published before or right after it
        self._pictures.drain()
        self._scene.view.malformed = self._forces.malformed + self._pictures.malformed
        now_ns = self.bus.clock.now_ns()
        if self._watched and self.server.has_room and self._scene.is_due(now_ns):
            self.server.show(self._scene.packet(now_ns, self.server.watching))
        elif samples := self._scene.samples():
            self.server.remember(samples)

    def _act(self, action: str, insist: bool) -> Outcome:
        """In a thread of the server's."""
        outcome = self._controls.act(action, self._scene.touching_n(self.bus.clock.now_ns()), insist=insist)
        self.log.info(f'{action!r}, asked for on the page: {outcome.text}')
        return outcome


def main() -> int:
    """The program ``live_view_node``."""
    return run_node(LiveViewNode)


if __name__ == '__main__':
    sys.exit(main())
