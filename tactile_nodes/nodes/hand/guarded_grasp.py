"""Example controller on the forces of a hand: closes two fingers on an object, and holds it while it is pulled.

Subscribes to ``hand_wrench``, ``joint_states`` and the ``force_distribution`` of each finger; publishes
``gripper_command``; offers ``~/stop`` (std_srvs/Trigger). It closes until each finger measures ``target_n``, then holds
with the force that the slip margin requires, and opens at the end. If a force is old or too large, or the gripper does
not report or follow, it reports the reason and leaves the gripper as it is, because a held object would fall
(docs/hands.md).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar

from tactile_nodes import conversions
from tactile_nodes.bus import topics
from tactile_nodes.bus.node.arguments import NodeArguments
from tactile_nodes.bus.node.diagnostics import Level
from tactile_nodes.bus.node.node import Node, NodeParams
from tactile_nodes.bus.node.runtime import run_node
from tactile_nodes.bus.protocol import Bus, Received
from tactile_nodes.clock import Clock
from tactile_nodes.collection.press.guarded import INVALID, NS_PER_MS, Felt
from tactile_nodes.collection.press.guarded_grasp import FeltByHand, Grasp, GraspSettings, Opening
from tactile_nodes.errors import DeviceError
from tactile_nodes.messages import types
from tactile_nodes.params import parameter
from tactile_nodes.sensors import load_gripper

LOOK_PERIOD_S = 0.005
CHECK_PERIOD_S = 1.0


@dataclass(frozen=True)
class GuardedGraspParams(NodeParams):
    READ_ONLY: ClassVar[bool] = True

    hand: str = parameter('gripping_fingers', 'name of a hand of two sensors, or its file')
    grasp: GraspSettings = field(default_factory=GraspSettings)


class GuardedGraspNode(Node):
    """Receives forces, checks 200 times per second whether the next command is due, and ends with the grasp."""

    NAME = 'guarded_grasp'
    PARAMS = GuardedGraspParams

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock or bus.clock)  # devices do not follow a simulated time
        hand = load_gripper(self.params.hand)
        self._names = hand.names
        if not hand.friction:
            self.log.warn(
                f'{self.params.hand} has no friction, so no slip margin protects the held object: add friction'
            )
        self._fingers: dict[str, Felt] = {}
        self._valid: dict[str, Felt] = {}
        self._wrench: Any = None
        self._opening: Opening | None = None
        self._opened_mm = 0.0
        self._grasp: Grasp | None = None
        self._command = self.create_publisher(topics.GRIPPER_COMMAND)
        self.create_subscription(topics.HAND_WRENCH, self._on_wrench)
        self.create_subscription(topics.JOINT_STATES, self._on_state)
        for name in self._names:
            there = f'{name}/{topics.FORCE_DISTRIBUTION.name}'
            self.create_subscription(replace(topics.FORCE_DISTRIBUTION, name=there), self._taking(name))
        self.create_trigger('~/stop', self._stop_grasp)
        self.create_timer(LOOK_PERIOD_S, self._look)
        self.create_timer(CHECK_PERIOD_S, self._report)

    def _on_wrench(self, received: Received) -> None:
        self._wrench = received.message

    def _on_state(self, received: Received) -> None:
        """Keep the opening. States of other joints on this topic, such as those of an arm, are not the gripper's."""
        opening_mm = conversions.opening_mm(received.message)
        if opening_mm is not None and math.isfinite(opening_mm):
            self._opening = Opening(self.clock.now_ns(), opening_mm)

    def _taking(self, name: str) -> Callable[[Received], None]:
        def take(received: Received) -> None:
            felt = Felt.of(received.message)
            if felt.status != INVALID:
                self._valid[name] = felt
            elif name in self._valid:  # it gets too old, which ends the grasp
                felt = replace(self._valid[name], status=INVALID, reasons=felt.reasons)
            self._fingers[name] = felt

        return take

    def _look(self) -> None:
        felt, opening = self._felt(), self._opening
        if opening is None or felt is None:
            return
        if self._grasp is None:
            if not self._may_begin(felt):
                return
            self._grasp = Grasp(self.params.grasp, self.clock.now_ns())
            self._opened_mm = opening.mm
            self.log.info(f'closing from {opening.mm:.1f} mm')
        try:
            command_mm = self._grasp.command_mm(self.clock.now_ns(), opening, felt)
        except DeviceError as error:
            self.fail('grasp', error)
            return
        if command_mm is not None:
            self._go(command_mm)
        if self._grasp.done:
            self._go(self._opened_mm)
            self._end(str(self._grasp.grasped))

    def _felt(self) -> FeltByHand | None:
        if self._wrench is None or len(self._fingers) < len(self._names):
            return None
        return FeltByHand.of(self._wrench, self._fingers)

    def _may_begin(self, felt: FeltByHand) -> bool:
        """Whether all forces are valid and fresh: at first there is no rest image, and a busy machine is late."""
        late_ms = (self.clock.now_ns() - felt.stamp_ns) / NS_PER_MS
        return felt.status != INVALID and bool(late_ms <= self.params.grasp.stale_ms)

    def _go(self, opening_mm: float) -> None:
        self._command.publish(types.Float64(data=opening_mm * conversions.MILLI))

    def _report(self) -> None:
        if self._grasp is None:
            missing = [name for name in self._names if name not in self._fingers]
            lacks = ', '.join(filter(None, [
                'no gripper opening' if self._opening is None else '',
                f'no force of {" and ".join(missing)}' if missing else '',
                'no hand_wrench' if self._wrench is None else '',
            ]))  # fmt: skip
            unusable = f'a force is invalid, or older than {self.params.grasp.stale_ms:g} ms'
            self.report('grasp', Level.WARN, f'waiting: {lacks or unusable}')
        else:
            self._report_grasp(self._grasp)

    def _report_grasp(self, grasp: Grasp) -> None:
        if grasp.strained:
            self.report(
                'grasp',
                Level.WARN,
                'holding with the largest allowed force (grasp.limit_n), but the slip margin is smaller than wanted',
            )
        else:
            self.report('grasp', Level.OK, 'holding' if grasp.grasped.began_ns else 'closing')

    def _end(self, words: str) -> None:
        self.report('grasp', Level.OK, words)
        self.log.info(words)
        self.stop()

    def _stop_grasp(self) -> str:
        self._end('stopped on request; the gripper stays as it is')
        return 'the grasp ends, and the gripper stays as it is'


main = partial(run_node, GuardedGraspNode)
