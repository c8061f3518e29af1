"""An emulated rig: Grbl on a pseudo terminal, a force/torque sensor and a camera stream, in one simulated world.

Its faults are parameters, so they can be switched on during a run:
``tactile param set /emulated_rig faults.silent_sensor true``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from tactile_nodes.bus.node.arguments import NodeArguments
from tactile_nodes.bus.node.diagnostics import Level
from tactile_nodes.bus.node.node import Node, NodeParams
from tactile_nodes.bus.node.runtime import run_node
from tactile_nodes.bus.protocol import Bus
from tactile_nodes.clock import Clock
from tactile_nodes.collection.station import WORLD
from tactile_nodes.emulators.rig import EmulatedRig, EmulatedRigSettings
from tactile_nodes.simulation import worlds

OUTLIVE_S = 4.0  # a launch sends the next signal after 5 s


@dataclass(frozen=True)
class EmulatedRigParams(EmulatedRigSettings, NodeParams):
    """Parameters of the emulated rig."""


class EmulatedRigNode(Node):
    """Opens the emulators, and passes faults to them.

    A real machine does not vanish when Ctrl-C ends its drivers. So this node, when asked to end, stays until no driver
    is connected and the machine stands still, so that the tip is lifted.
    """

    NAME = 'emulated_rig'
    PARAMS = EmulatedRigParams
    END_WITHIN_S = OUTLIVE_S + 0.8

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock or bus.clock)  # devices do not follow a simulated time
        self._rig = EmulatedRig(self.params, self.clock)
        worlds.share(WORLD, self._rig.world)  # for an emulated recorder in this process
        try:
            self._rig.switch(self.params.faults)
        except BaseException:
            self._rig.close()
            raise
        self.report('emulated rig', Level.OK, self._rig.places)

    def on_close(self) -> None:
        self._rig.rest(OUTLIVE_S)
        self._rig.close()

    def on_parameters(self, changed: EmulatedRigParams) -> None:
        self._rig.switch(changed.faults)


main = partial(run_node, EmulatedRigNode)
