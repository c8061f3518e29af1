"""Example controller on the force topic: moves down until the gel measures 0.2 N, holds, moves up, and ends.

Subscribes to ``force_distribution``; drives the machine of a rig; offers ``~/stop`` and ``~/acknowledge``
(std_srvs/Trigger), which answers the question after a run that was cut off. It gives up, with the tip lifted, if the
force is invalid, old or too large (docs/robots.md). On the bus it is called ``rig``, like the node that collects. Both
drive the same machine with the same device file, and must not run at the same time.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import ClassVar

from tactile_nodes.bus import topics
from tactile_nodes.bus.node.arguments import NodeArguments
from tactile_nodes.bus.node.diagnostics import Level
from tactile_nodes.bus.node.node import Node, NodeParams
from tactile_nodes.bus.node.runtime import run_node
from tactile_nodes.bus.protocol import Bus, Received
from tactile_nodes.clock import Clock
from tactile_nodes.collection.press.guarded import Felt
from tactile_nodes.collection.run.guarded_run import GuardedRun, GuardedRunSettings
from tactile_nodes.collection.run.person import Person
from tactile_nodes.collection.station import LEAVE_S, NOT_UP_YET

QUESTION_S = 0.5


@dataclass(frozen=True)
class GuardedApproachParams(GuardedRunSettings, NodeParams):
    READ_ONLY: ClassVar[bool] = True


class GuardedApproachNode(Node):
    """The approach runs in its own thread; the node's thread receives forces and answers services."""

    NAME = 'rig'
    PARAMS = GuardedApproachParams
    END_WITHIN_S = LEAVE_S + 1.0

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock or bus.clock)  # devices do not follow a simulated time
        self._felt: Felt | None = None
        answer = f"tactile service call {self.full_name}/acknowledge std_srvs/srv/Trigger '{{}}'"
        self._person = Person(answer, lambda _: None, self.clock)  # reported by the timer
        self._guarded = GuardedRun(self.params, self.clock, lambda: self._felt, self._person)
        self.create_subscription(topics.FORCE_DISTRIBUTION, self._on_force)
        self.create_trigger('~/stop', self._stop_approach)
        self.create_trigger('~/acknowledge', self._person.acknowledge)
        self.create_timer(QUESTION_S, self._report_question)
        self._thread = self.run_beside('approach', self._approach)

    def stop(self) -> None:
        """Also ends the approach at once: when this node closes, the sensor may already be gone."""
        self._guarded.stop()
        super().stop()

    def on_close(self) -> None:
        self._guarded.stop()
        if not self._guarded.close(self._thread, LEAVE_S):
            self.log.warn(NOT_UP_YET)

    def _on_force(self, received: Received) -> None:
        self._felt = Felt.of(received.message)

    def _approach(self) -> None:
        self.report('approach', Level.OK, str(self._guarded.run() or 'stopped on request'))
        self.stop()

    def _report_question(self) -> None:
        if question := self._person.question:
            self.report('approach', Level.WARN, question)

    def _stop_approach(self) -> str:
        self._guarded.stop()
        return 'stopping: the tip is lifted, and the approach ends'


main = partial(run_node, GuardedApproachNode)
