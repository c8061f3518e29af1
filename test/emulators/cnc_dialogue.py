"""Talking to an emulated controller as a host does, on a clock that passes only by being slept through."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from tactile_nodes.clock import Clock, SteppedClock
from tactile_nodes.emulators.serial_device import SerialDevice
from tactile_nodes.emulators.serial_ports import DirectPort
from tactile_nodes.emulators.world import World, WorldSettings
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.mechanics import ContactTable, solve

START_NS = 1_700_000_000_000_000_000


class JumpingClock(SteppedClock):
    def sleep_until(self, deadline_ns: int) -> None:
        self.set_ns(max(self.now_ns(), deadline_ns))


@cache
def coarse_table() -> ContactTable:
    """Good enough where the force itself is not under test."""
    return solve(Gel(), steps=4)


class Dialogue:
    """Says things and hears what comes within a time."""

    def __init__(self, make: Callable[[World, Clock], SerialDevice], world: WorldSettings | None = None) -> None:
        self.clock = JumpingClock(START_NS)
        self.world = World(world, table=coarse_table())
        self.device = make(self.world, self.clock)
        self.port = DirectPort(self.device, self.clock)

    def hear(self, seconds: float = 0.05) -> bytes:
        end_ns, heard = self.clock.now_ns() + round(seconds * 1e9), b''
        while self.clock.now_ns() < end_ns:
            heard += self.port.read((end_ns - self.clock.now_ns()) / 1e9)
        return heard

    def say(self, data: bytes, seconds: float = 0.05) -> bytes:
        self.port.write(data)
        return self.hear(seconds)

    @property
    def tip(self) -> tuple[float, float, float]:
        return self.world.tip_at(self.clock.now_ns())
