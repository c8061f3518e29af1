"""The total force and torque on all sensors of a hand, in the frame of the hand, and the slip margin of each contact.

Subscribes to ``force_distribution`` of each sensor; publishes ``hand_wrench`` and, once, ``/tf_static``: the mounting
poses of the sensors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bus import topics
from tactile_nodes.bus.node.arguments import NodeArguments
from tactile_nodes.bus.node.diagnostics import Level
from tactile_nodes.bus.node.node import Node, NodeParams
from tactile_nodes.bus.node.runtime import run_node
from tactile_nodes.bus.protocol import Bus, Qos, Received
from tactile_nodes.clock import Clock
from tactile_nodes.errors import BagError
from tactile_nodes.params import parameter
from tactile_nodes.pipeline.hand_forces import REPLAYED, HandForces
from tactile_nodes.sensors import load_hand
from tactile_nodes.viewing import force_shapes

REPORT_PERIOD_S = 1.0
QUEUE = 1000
"""Forces of a sensor that wait in a replay, which must not lose any."""
WHY = 'no force at this time, an invalid one, or a model without shear'


@dataclass(frozen=True)
class HandWrenchParams(NodeParams):
    hand: str = parameter('two_fingers', 'name of a shipped hand, or its file', read_only=True)
    bag: str = parameter('', 'bag of a replay: each sum waits for all sensors in the bag', read_only=True)


class HandWrenchNode(Node):
    """One sum per frame time, with the stamp of the newest picture in it."""

    NAME = 'hand_wrench'
    PARAMS = HandWrenchParams

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock)
        self._hand = load_hand(self.params.hand)
        self._forces = HandForces(self._hand, *self._replayed()) if self.params.bag else HandForces(self._hand)
        self._in_sums: set[str] = set()  # since the last report: on a busy machine, some sums lack a sensor
        self._sums = 0
        bus.graph().require_unpublished(self.names.resolve(topics.HAND_WRENCH.name))  # else two sums would mix
        self._wrench = self.create_publisher(topics.HAND_WRENCH)
        self._transforms = self.create_publisher(topics.TF_STATIC)
        self._transforms.publish(force_shapes.hand_transforms(self._hand, self.clock.now_ns()))
        for name in self._hand.names:
            there = f'{name}/{topics.FORCE_DISTRIBUTION.name}'
            qos = Qos('queue', QUEUE) if self.params.bag else topics.FORCE_DISTRIBUTION.qos
            self.create_subscription(replace(topics.FORCE_DISTRIBUTION, name=there, qos=qos), self._taking(name))
        self.create_timer(REPORT_PERIOD_S, self._report)

    def _replayed(self) -> tuple[int, dict[str, int]]:
        """How long a sum waits for a sensor that lags, and the time of each sensor's last picture.

        Raises:
            BagError: it cannot be read, or holds pictures of none of the sensors.
        """
        of = {self.names.resolve(f'{name}/{topics.IMAGE.name}'): name for name in self._hand.names}
        with BagReader(self.params.bag) as bag:
            last = {of[topic]: last_ns for topic, last_ns in bag.newest_stamps_ns(of).items()}
            others = sorted(topic for topic in bag.topics if topic.endswith(f'/{topics.IMAGE.name}'))
        if not last:
            raise BagError(
                f'{self.params.bag} holds no {" and no ".join(of)}, but {", ".join(others) or "no pictures at all"}; '
                'choose the hand that was recorded, or replay each sensor alone (tactile launch replay namespace:=)'
            )
        if lacking := [name for name in self._hand.names if name not in last]:
            self.log.warn(f'{self.params.bag} holds no pictures of {", ".join(lacking)}; sums leave them out')
        return REPLAYED, last

    def _taking(self, name: str) -> Callable[[Received], None]:
        return lambda received: self._on_force(name, received)

    def _on_force(self, name: str, received: Received) -> None:
        for wrench in self._forces.add(name, received.message):
            self._wrench.publish(wrench)
            self._in_sums.update(wrench.sensors)
            self._sums += 1

    def _report(self) -> None:
        missing, self._in_sums = ', '.join(name for name in self._hand.names if name not in self._in_sums), set()
        text = f'without {missing}: {WHY}' if missing else f'of all {len(self._hand.sensors)} sensors'
        self.report('sum', Level.WARN if missing else Level.OK, text, sums=self._sums)


main = partial(run_node, HandWrenchNode)
