"""The live view in the browser: a page on this machine with picture, motion, force, health and a few buttons.

Subscribes to ``/diagnostics``, ``/rosout``, ``calibration_state``, ``force_distribution`` and
``true_force_distribution``, and, while a page is open, ``image_raw``, ``flow_features`` and ``force_field``. For a hand
it subscribes to these topics of each sensor, and ``hand_wrench``.
"""

from __future__ import annotations

import platform
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

from tactile_nodes.bus import topics
from tactile_nodes.bus.node.arguments import NodeArguments
from tactile_nodes.bus.node.diagnostics import Level
from tactile_nodes.bus.node.node import Node, NodeParams
from tactile_nodes.bus.node.runtime import run_node
from tactile_nodes.bus.protocol import Bus, Graph, Received
from tactile_nodes.clock import Clock
from tactile_nodes.params import parameter
from tactile_nodes.sensors import load_hand
from tactile_nodes.viewing.feeds import Feeds
from tactile_nodes.web import guard, port
from tactile_nodes.web.controls import Controls, Outcome
from tactile_nodes.web.guard import Guests
from tactile_nodes.web.scene import Scene
from tactile_nodes.web.server import PageServer

LOOK_EVERY_S = 0.5
UNWATCHED_EVERY_S = 0.25  # often enough that the last force is a fresh one (`scene.FRESH_S`)
IMAGES = 4  # kept between two polls


@dataclass(frozen=True)
class LiveViewParams(NodeParams):
    READ_ONLY: ClassVar[bool] = True

    address: str = parameter(
        '127.0.0.1', 'address to serve on; connections from other machines count as guests, see `guests`'
    )
    port: int = parameter(7470, 'port to serve on, or the next free one; 0: any', minimum=0, maximum=65535)
    host_names: tuple[str, ...] = parameter((), 'host names, besides addresses, under which it may be reached')
    guests: str = parameter(
        Guests.NONE.value,
        'what other users of this machine, and other machines, may do: nothing, watch, or also act',
        choices=[each.value for each in Guests],
    )
    rate_hz: float = parameter(30.0, 'updates per second', minimum=1.0, maximum=60.0)
    hand: str = parameter('', 'show the sensors of this hand (name or file); empty: the sensor of the namespace')
    viewers: int = parameter(16, 'most pages that may watch at the same time', minimum=1, maximum=100)


@dataclass
class _Shown:
    """One sensor: its incoming messages, and its view."""

    name: str
    scene: Scene
    controls: Controls
    health: Feeds
    forces: Feeds
    pictures: Feeds
    force_topic: str
    watched: bool = False


class LiveViewNode(Node):
    """Shows incoming messages to the viewers; without viewers, it receives no pictures, and looks at forces rarely."""

    NAME = 'live_view'
    PARAMS = LiveViewParams

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock)
        chosen: LiveViewParams = self.params
        hand = load_hand(chosen.hand) if chosen.hand else None
        sensors, left_out = (hand.names, hand.refused) if hand else (('',), ())
        self._sensors = {name: self._feed(name) for name in sensors}
        self._sums = Feeds(bus, self.full_name, self.names.resolve)
        if hand:
            self._sums.add(topics.HAND_WRENCH, self._on_hand, keep=1)
        self.server = PageServer(
            port.listen(chosen.address, chosen.port), self._act, lambda: self.post(self._look), self.log.warn,
            Guests(chosen.guests), chosen.host_names, chosen.viewers, sensors, left_out,
        )  # fmt: skip
        self._announce()
        self.create_timer(1.0 / chosen.rate_hz, lambda: self._show(watched=True))
        self.create_timer(UNWATCHED_EVERY_S, lambda: self._show(watched=False))
        self.create_timer(LOOK_EVERY_S, self._look)

    def on_close(self) -> None:
        self.server.close()
        self._sums.close()
        for each in self._sensors.values():
            for feeds in (each.pictures, each.forces, each.health):
                feeds.close()

    def _feed(self, name: str) -> _Shown:
        namespace = f'{self.names.namespace.rstrip("/")}/{name}' if name else self.names.namespace
        scene = Scene(namespace, self.bus.clock.now_ns())

        def resolve(topic: str) -> str:
            return self.names.resolve(f'{name}/{topic}' if name and not topic.startswith('/') else topic)

        health, forces, pictures = (Feeds(self.bus, self.full_name, resolve) for _ in range(3))
        health.add(topics.DIAGNOSTICS, scene.add_diagnostics)
        health.add(topics.ROSOUT, scene.add_log)
        health.add(topics.CALIBRATION_STATE, scene.add_calibration)
        forces.add(topics.TRUE_FORCE, scene.add_truth)
        forces.add(topics.FORCE_DISTRIBUTION, scene.add_force)
        force_topic = resolve(topics.FORCE_DISTRIBUTION.name)
        return _Shown(name, scene, Controls(self.bus, namespace), health, forces, pictures, force_topic)

    def _announce(self) -> None:
        self.log.info(f'the live view is at {self.server.url}')
        guests, is_alone = Guests(self.params.guests), guard.is_loopback(self.params.address)
        if guests is not Guests.NONE:
            may = 'watch and press the buttons' if guests is Guests.ACT else 'watch'
            who = 'every user of this machine' if is_alone else f'anyone who can reach {self.params.address}'
            self.log.warn(f'{who} can {may}')
        elif not is_alone:
            self.log.warn(
                f'{self.params.address} is reachable from other machines, but they count as guests: set guests'
            )

    def _on_hand(self, received: Received) -> None:
        for each in self._sensors.values():
            each.scene.hand = received.message

    def _look(self) -> None:
        """Report the number of viewers, and the nodes that the buttons control."""
        server, watching = self.server, self.server.watching
        self.report(
            'page', Level.OK, f'{server.url}, viewers: {watching}', viewers=watching,
            turned_away=server.door.refused, refused=server.complaints.refused,
        )  # fmt: skip
        graph = self.bus.graph() if watching else Graph()
        for each in self._sensors.values():
            self._look_at(each, graph)

    def _look_at(self, each: _Shown, graph: Graph) -> None:
        watching = self.server.watching_of(each.name) > 0
        each.health.drain()
        if watching:
            each.scene.controls, host = each.controls.available(graph), graph.host_of(each.force_topic)
            each.scene.host = host if host != platform.node() else ''
        if watching != each.watched:
            each.watched = watching
            self._open(each.scene, each.pictures) if watching else each.pictures.close()

    def _open(self, scene: Scene, pictures: Feeds) -> None:
        scene.look_again()
        pictures.add(topics.IMAGE, scene.add_image, keep=IMAGES)
        pictures.add(topics.FLOW_FEATURES, scene.add_motion, keep=IMAGES)
        pictures.add(topics.FORCE_FIELD, scene.add_field, keep=IMAGES)

    def _show(self, *, watched: bool) -> None:
        """Take in what has come of the sensors that are watched, or of the others, of which only forces are kept."""
        shown = [each for each in self._sensors.values() if each.watched is watched]
        if shown:
            self._sums.drain()
        for each in shown:
            self._show_of(each)

    def _show_of(self, each: _Shown) -> None:
        each.forces.drain()  # first: messages that belong to a force are published before or right after it
        each.pictures.drain()
        each.scene.view.malformed = each.forces.malformed + each.pictures.malformed
        now_ns = self.bus.clock.now_ns()
        if each.watched and self.server.has_room_for(each.name) and each.scene.is_due(now_ns):
            self.server.show(each.scene.packet(now_ns), each.name)
        elif samples := each.scene.samples():
            self.server.remember(samples, each.name)

    def _act(self, action: str, insist: bool, sensor: str) -> Outcome:
        """Called in a thread of the server."""
        each = self._sensors[sensor]
        outcome = each.controls.act(action, each.scene.touching_n(self.bus.clock.now_ns()), insist=insist)
        self.log.info(f'{action!r}, requested on the page: {outcome.text}')
        return outcome


main = partial(run_node, LiveViewNode)
