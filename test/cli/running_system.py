"""What the tests of the command line share: a node to look at, and what a command did."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass

from tactile_nodes.bus import topics
from tactile_nodes.bus.node.arguments import NodeArguments
from tactile_nodes.bus.node.node import Node, NodeParams
from tactile_nodes.bus.protocol import Bus
from tactile_nodes.clock import Clock, monotonic_s
from tactile_nodes.params import parameter

DOMAIN = 17


def wait_until(condition: Callable[[], object], timeout_s: float = 30.0) -> None:
    """Return when `condition` holds; fail when it does not come to."""
    end_s = monotonic_s() + timeout_s
    while not condition():
        assert monotonic_s() < end_s, 'it did not come to that in time'
        threading.Event().wait(0.005)


@dataclass
class Ended:
    """What a command did."""

    status: int
    out: str
    err: str


Tactile = Callable[..., Ended]


@dataclass(frozen=True)
class LampParams(NodeParams):
    """Parameters to look at and change."""

    level: float = parameter(0.5, 'how bright', minimum=0.0, maximum=1.0)
    serial: str = parameter('00012345', 'which one', read_only=True)
    colour: str = parameter('on', 'its name')
    steps: tuple[int, ...] = parameter((1, 2), 'where to stop')


class LampNode(Node):
    """A node with parameters and a service."""

    NAME = 'lamp'
    PARAMS = LampParams

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock)
        self.create_publisher(topics.WRENCH)
        self.create_trigger('~/blink', lambda: 'blinked')
