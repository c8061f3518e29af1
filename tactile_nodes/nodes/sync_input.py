"""Publishes the edges of the digital line that this host sees on a control line of a serial port.

Publishes ``sync_edge`` with the name of the recorder as frame. The rig publishes the edges that it switches, so a bag
holds both, and the clocks can be compared.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from functools import partial
from typing import ClassVar

from tactile_nodes import conversions
from tactile_nodes.bus import topics
from tactile_nodes.bus.node.arguments import NodeArguments
from tactile_nodes.bus.node.diagnostics import NO_HARDWARE, Level
from tactile_nodes.bus.node.node import Node, NodeParams
from tactile_nodes.bus.node.runtime import run_node
from tactile_nodes.bus.protocol import Bus
from tactile_nodes.clock import Clock
from tactile_nodes.collection.station import WORLD
from tactile_nodes.drivers.sync_input.control_line import Edge, SyncInputSettings, WatchedLine, sync_input
from tactile_nodes.emulators.clocks import ForeignClock
from tactile_nodes.emulators.world import SharedLine
from tactile_nodes.errors import DeviceTimeoutError, TactileError
from tactile_nodes.messages import types
from tactile_nodes.params import parameter

READ_S = 0.25
HEALTH_S = 1.0
SIMULATED = 'simulated'


@dataclass(frozen=True)
class EmulatedRecorderSettings:
    """The clock of a ``simulated`` recorder, which watches the line of an emulated rig."""

    ahead_s: float = parameter(0.0, 'offset of the clock from the true time at the start')
    drift_ppm: float = parameter(0.0, 'drift: how much too fast the clock runs')


@dataclass(frozen=True)
class SyncInputParams(SyncInputSettings, NodeParams):
    READ_ONLY: ClassVar[bool] = True

    recorder: str = parameter('sync_input', 'frame of the edges: name of the recorder whose clock stamps them')
    line_name: str = parameter('press', 'name of the line')
    emulated: EmulatedRecorderSettings = field(default_factory=EmulatedRecorderSettings)


class SyncInputNode(Node):
    """Reads in its own thread; without a device it does nothing, and reports that."""

    NAME = 'sync_input'
    PARAMS = SyncInputParams

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock or bus.clock)  # devices do not follow a simulated time
        self._edge = self.create_publisher(topics.SYNC_EDGE)
        self._input = self._made()
        self.diagnostics.hardware['sync input'] = self.params.device or NO_HARDWARE
        self._running = True
        self._reader: threading.Thread | None = None
        if not self.params.device:
            self.report('sync input', Level.OK, 'no device is set, so no line is watched')
            return
        self._input.open()
        self._reader = self.run_beside('sync input', self._read)
        self.create_timer(HEALTH_S, self._report_health)

    def on_close(self) -> None:
        self._running = False
        if self._reader is not None:
            self._reader.join(2 * READ_S)
        self._input.close()

    def _made(self) -> WatchedLine:
        if self.params.device != SIMULATED:
            return sync_input(self.params, self.clock)
        foreign = ForeignClock(self.clock, self.params.emulated.ahead_s, self.params.emulated.drift_ppm)
        line = SharedLine(WORLD, self.clock)
        return WatchedLine('the line of the simulated rig', lambda: line, self.params, foreign)

    def _read(self) -> None:
        while self._running:
            try:
                for edge in self._input.read(READ_S):
                    self._edge.publish(self._message(edge))
            except DeviceTimeoutError:
                continue  # no edge, or the device is lost; reported by the health
            except TactileError:
                if self._running:  # else closed meanwhile
                    raise

    def _message(self, edge: Edge) -> types.SyncEdge:
        return types.SyncEdge(
            header=conversions.header(edge.stamp_ns, self.params.recorder),
            line=self.params.line_name,
            level=edge.level,
            count=edge.number,
            uncertainty=edge.uncertainty_s,
        )

    def _report_health(self) -> None:
        health = self._input.health
        self.report('sync input', Level(health.level), health.message, **self._input.description)


main = partial(run_node, SyncInputNode)
