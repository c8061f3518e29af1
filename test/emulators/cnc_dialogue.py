"""Talking to an emulated controller as a host does, on a clock that passes only by being slept through."""

from __future__ import annotations

from collections.abc import Callable

from coarse_table import coarse_table
from jumping_clock import JumpingClock

from benchmarks.devices.direct_port import DirectPort
from tactile_nodes.clock import Clock
from tactile_nodes.emulators.serial_device import SerialDevice
from tactile_nodes.emulators.world import World

START_NS = 1_700_000_000_000_000_000


class Dialogue:
    """Says things and hears what comes within a time."""

    def __init__(self, make: Callable[[World, Clock], SerialDevice]) -> None:
        self.clock = JumpingClock(START_NS)
        self.world = World(table=coarse_table())
        self.device = make(self.world, self.clock)
        self.port = DirectPort(self.device, self.clock)

    def hear(self, seconds: float = 0.05) -> bytes:
        end_ns, received = self.clock.now_ns() + round(seconds * 1e9), b''
        while self.clock.now_ns() < end_ns:
            received += self.port.read((end_ns - self.clock.now_ns()) / 1e9)
        return received

    def say(self, data: bytes, seconds: float = 0.05) -> bytes:
        self.port.write(data)
        return self.hear(seconds)

    @property
    def tip(self) -> tuple[float, float, float]:
        return self.world.tip_at(self.clock.now_ns())
