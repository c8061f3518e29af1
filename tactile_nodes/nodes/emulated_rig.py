"""A rig that is not there: Grbl on a pseudo terminal, a Net F/T box on UDP and HTTP, a camera stream, in one world.

Its faults are parameters, so they can be switched on while a run goes on:
``tactile param set /emulated_rig faults.silent_sensor true``.
"""

from __future__ import annotations

import sys
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from tactile_nodes import paths
from tactile_nodes.bus.arguments import NodeArguments
from tactile_nodes.bus.diagnostics import Level
from tactile_nodes.bus.node import Node, NodeParams
from tactile_nodes.bus.protocol import Bus
from tactile_nodes.bus.runtime import run_node
from tactile_nodes.clock import Clock
from tactile_nodes.emulators.camera_stream import CameraStream
from tactile_nodes.emulators.grbl import Grbl
from tactile_nodes.emulators.grbl_dialect import GrblSettings
from tactile_nodes.emulators.mounting import UPSIDE_DOWN, Mounted
from tactile_nodes.emulators.net_ft import NetFtServer
from tactile_nodes.emulators.net_ft_box import NetFtBox
from tactile_nodes.emulators.serial_ports import PtyPort
from tactile_nodes.emulators.world import World, WorldSettings
from tactile_nodes.errors import AddressInUseError
from tactile_nodes.params import parameter

NOISE = (0.005, 0.0001)  # N and N m


@dataclass(frozen=True)
class RigFaults:
    """What is wrong now."""

    silent_sensor: bool = parameter(False, 'the box sends nothing')
    stalled_sensor: bool = parameter(False, 'the box sends, but what measures stands still')
    saturated_sensor: bool = parameter(False, 'the box says that it is beyond its range')
    lose: int = parameter(0, 'the next so many records are lost', minimum=0)
    loss_rate: float = parameter(0.0, 'share of the records that are lost', minimum=0.0, maximum=1.0)
    silent_camera: bool = parameter(False, 'the camera sends nothing')
    hung_machine: bool = parameter(False, 'the controller does and answers nothing')
    alarm: int = parameter(0, 'raise an alarm of this number; 0: none', minimum=0, maximum=10)
    unplugged: bool = parameter(False, "the controller's serial line is pulled")
    stuck_axis: str = parameter('', 'axis that does not follow its motor', choices=('', 'x', 'y', 'z'))


@dataclass(frozen=True)
class EmulatedRigParams(NodeParams):
    """Parameters of the emulated rig."""

    cnc_port: str = parameter('', 'link to the serial port; empty: emulated_cnc in the run folder', read_only=True)
    rdt_port: int = parameter(49153, 'UDP port of the Net F/T box', minimum=0, maximum=65535, read_only=True)
    http_port: int = parameter(49180, 'TCP port of its web pages', minimum=0, maximum=65535, read_only=True)
    camera_port: int = parameter(49190, 'TCP port of the camera stream', minimum=0, maximum=65535, read_only=True)
    fps: float = parameter(30.0, 'pictures a second', minimum=1.0, read_only=True)
    world: WorldSettings = field(default_factory=WorldSettings)
    grbl: GrblSettings = field(default_factory=GrblSettings)
    faults: RigFaults = field(default_factory=RigFaults)


class EmulatedRigNode(Node):
    """Opens the emulators, and passes faults on to them."""

    NAME = 'emulated_rig'
    PARAMS = EmulatedRigParams

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock)
        p = self.params
        self._world = world = World(p.world)
        self._grbl = Grbl(world, self.clock, p.grbl)
        self._box = NetFtBox(Mounted(world, UPSIDE_DOWN), noise=NOISE)
        link = Path(p.cnc_port) if p.cnc_port else paths.run_directory() / 'emulated_cnc'
        link.parent.mkdir(parents=True, exist_ok=True)
        self._opened = ExitStack()
        try:
            self._port = self._opened.enter_context(PtyPort(self._grbl, self.clock, link))
            server = NetFtServer(self._box, self.clock, rdt_port=p.rdt_port, http_port=p.http_port)
            self._opened.enter_context(server)
            self._camera = self._opened.enter_context(CameraStream(world, self.clock, p.fps, p.camera_port))
        except OSError as error:
            self._opened.close()
            raise AddressInUseError(
                f'cannot listen at UDP {p.rdt_port}, TCP {p.http_port} and {p.camera_port}: {error.strerror}; '
                'is another emulated rig running?'
            ) from error
        self._faults = RigFaults()
        self._switch(p.faults)
        self.report(
            'emulated rig', Level.OK, f'machine at {link}, force/torque at netft://127.0.0.1 (RDT {server.rdt_port}, '
            f'HTTP {server.http_port}), camera at http://127.0.0.1:{self._camera.port}/',
        )  # fmt: skip

    def on_close(self) -> None:
        self._opened.close()

    def on_parameters(self, changed: EmulatedRigParams) -> None:
        self._switch(changed.faults)

    def _switch(self, wanted: RigFaults) -> None:
        had, self._faults = self._faults, wanted
        box = self._box.faults
        box.silent, box.stalled, box.saturated = wanted.silent_sensor, wanted.stalled_sensor, wanted.saturated_sensor
        box.loss_rate = wanted.loss_rate
        box.lose += wanted.lose if wanted.lose != had.lose else 0
        self._camera.silent = wanted.silent_camera
        self._grbl.faults.hung = wanted.hung_machine
        if wanted.alarm and wanted.alarm != had.alarm:
            self._grbl.alarm(wanted.alarm)
        if wanted.stuck_axis != had.stuck_axis:
            axis = wanted.stuck_axis or had.stuck_axis
            self._world.stick('xyz'.index(axis), self.clock.now_ns(), bool(wanted.stuck_axis))
        if wanted.unplugged != had.unplugged:
            (self._port.unplug if wanted.unplugged else self._port.plug)()


def main() -> int:
    """The program ``emulated_rig_node``."""
    return run_node(EmulatedRigNode)


if __name__ == '__main__':
    sys.exit(main())
