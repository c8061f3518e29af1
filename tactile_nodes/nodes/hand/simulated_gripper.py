"""A simulated gripper with two simulated gels, and an object between them that is pulled out.

Subscribes to ``gripper_command``; publishes ``joint_states``, and ``held`` of each finger, which the simulated cameras
follow (``contact: held`` in the file of the hand). It does not publish the force, which the gels have to measure.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

from tactile_nodes import conversions
from tactile_nodes.bus import topics
from tactile_nodes.bus.node.arguments import NodeArguments
from tactile_nodes.bus.node.diagnostics import Level
from tactile_nodes.bus.node.node import Node, NodeParams
from tactile_nodes.bus.node.runtime import run_node
from tactile_nodes.bus.protocol import Bus, Received
from tactile_nodes.clock import Clock
from tactile_nodes.emulators.gripper import Gripper, GripperSettings, finger_of, pull_along, touches
from tactile_nodes.params import parameter
from tactile_nodes.sensors import load_gripper

PERIOD_S = 0.005
STATES_PERIOD_S = 0.01
REPORT_PERIOD_S = 1.0


@dataclass(frozen=True)
class SimulatedGripperParams(GripperSettings, NodeParams):
    hand: str = parameter('gripping_fingers', 'name of a hand of two sensors, or its file', read_only=True)


class SimulatedGripperNode(Node):
    """Advances the simulated world 200 times per second."""

    NAME = 'simulated_gripper'
    PARAMS = SimulatedGripperParams

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock or bus.clock)  # devices do not follow a simulated time
        hand = load_gripper(self.params.hand)
        fingers = [finger_of(each) for each in hand.sensors]
        self._gripper = Gripper(self.params, fingers, self.clock.now_ns())
        self._along = [pull_along(each) for each in hand.sensors]
        places = [f'{name}/{topics.HELD.name}' for name in hand.names]
        self._held = [self.create_publisher(replace(topics.HELD, name=each)) for each in places]
        self._states = self.create_publisher(topics.JOINT_STATES)
        self._followed = False
        self.create_subscription(topics.GRIPPER_COMMAND, self._on_command)
        self.create_timer(PERIOD_S, self._advance)
        self.create_timer(STATES_PERIOD_S, self._tell)
        self.create_timer(REPORT_PERIOD_S, self._report)

    def _on_command(self, received: Received) -> None:
        self._gripper.command(received.message.data / conversions.MILLI)

    def _advance(self) -> None:
        now_ns = self.clock.now_ns()
        hold = self._gripper.advance(now_ns, self.params.pull_n)
        for publisher, press in zip(self._held, touches(hold, self._along), strict=True):
            publisher.publish(conversions.touch_message(now_ns, topics.HELD.frame, press))

    def _tell(self) -> None:
        """Only what the cameras see can be measured: until they follow, joint states are not published."""
        self._followed = self._followed or all(each.listeners for each in self._held)
        if not self._followed:
            return
        self._states.publish(conversions.gripper_state(self.clock.now_ns(), self._gripper.opening_mm))

    def _report(self) -> None:
        if not self._followed:
            self.report('object', Level.WARN, 'the simulated cameras are not connected yet (contact: held)')
        elif self._gripper.lost:
            self.report('object', Level.ERROR, f'it slipped out at a pull of {self._gripper.pulled_n:.2f} N')
        elif self._gripper.held_s:
            self.report('object', Level.OK, f'held at a pull of {self._gripper.pulled_n:.2f} N')
        else:
            self.report('object', Level.OK, 'not held')


main = partial(run_node, SimulatedGripperNode)
