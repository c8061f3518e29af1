"""Machines for the tests of the CNC drivers: each with its world, its clock and everything that was said."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest
from coarse_table import coarse_table
from jumping_clock import JumpingClock

from benchmarks.devices.direct_port import DirectPort
from benchmarks.devices.marlin import Marlin, MarlinSettings
from tactile_nodes.clock import Clock, SystemClock
from tactile_nodes.drivers.cnc import grbl_hearing, marlin_dialogue
from tactile_nodes.drivers.cnc.contract import Cnc, CncSettings, Place
from tactile_nodes.drivers.cnc.grbl import GrblCnc
from tactile_nodes.drivers.cnc.marlin import MarlinCnc
from tactile_nodes.drivers.cnc.opening import open_cnc
from tactile_nodes.drivers.cnc.simulated import SimulatedCnc
from tactile_nodes.emulators.cnc.grbl import Grbl
from tactile_nodes.emulators.cnc.grbl_dialect import GrblSettings
from tactile_nodes.emulators.serial_device import SerialDevice
from tactile_nodes.emulators.serial_ports import PtyPort
from tactile_nodes.emulators.world import World, WorldSettings

START_NS = 1_700_000_000_000_000_000
MARLIN_BOX = {'lowest_mm': (0.0, 0.0, 0.0), 'highest_mm': (120.0, 120.0, 60.0), 'safe_z_mm': 55.0}
KINDS = ['grbl', 'grblhal', 'marlin', 'simulated']


Script = list[tuple[bytes, bytes]]
"""What must be sent, and what is answered."""


class Scripted:
    """A port that expects every byte of a transcript, and answers with the other side's."""

    name = 'the port'

    def __init__(self, clock: JumpingClock, script: Script, first: bytes) -> None:
        self._clock = clock
        self.left = list(script)
        self._answer = first

    def write(self, data: bytes) -> None:
        expected, answer = self.left.pop(0)
        assert data == expected
        self._answer += answer

    def read(self, timeout_s: float) -> bytes:
        answer, self._answer = self._answer, b''
        if not answer:
            self._clock.sleep_until(self._clock.now_ns() + round(timeout_s * 1e9))
        return answer

    def close(self) -> None:
        """Nothing to close."""


@dataclass
class Rig:
    """A machine, not connected, and all that can be known about it from outside."""

    cnc: Cnc
    world: World
    clock: Clock
    zero: Place = (0.0, 0.0, 0.0)  # of the world, in the machine's coordinates
    device: Any = None
    port: Any = None
    traffic: list[tuple[str, int, bytes]] = field(default_factory=list)

    @property
    def tip(self) -> Place:
        """The tip, in the machine's coordinates."""
        return self.at(*self.world.tip_at(self.clock.now_ns()))

    def at(self, x: float, y: float, z: float) -> Place:
        """A place in the world in the machine's coordinates."""
        return (x + self.zero[0], y + self.zero[1], z + self.zero[2])

    def go(self, x: float, y: float, z: float, feed: float = 2000.0) -> None:
        """To a place in the world, and wait."""
        mx, my, mz = self.at(x, y, z)
        self.cnc.move(mx, my, mz, feed=feed)
        self.cnc.wait_idle()

    def pass_time(self, seconds: float) -> None:
        """Let time pass, and ask where it is meanwhile."""
        end_ns = self.clock.now_ns() + round(seconds * 1e9)
        while self.clock.now_ns() < end_ns:
            self.cnc.status()
            self.clock.sleep_until(min(end_ns, self.clock.now_ns() + 50_000_000))

    def sent(self) -> bytes:
        return b''.join(data for way, _, data in self.traffic if way == '>')

    def received(self) -> bytes:
        return b''.join(data for way, _, data in self.traffic if way == '<')

    def seconds(self) -> float:
        return self.clock.now_ns() / 1e9


def settings_of(kind: str, **more: Any) -> CncSettings:
    if kind.startswith('marlin'):
        base = CncSettings('the port', 'marlin', home_command='G28', **MARLIN_BOX)  # type: ignore[arg-type]
    else:
        base = CncSettings('simulated' if kind == 'simulated' else 'the port')
    return replace(base, **more)


def device_of(kind: str, world: World, clock: Clock, changes: tuple[str, ...] = ()) -> SerialDevice:
    if kind.startswith('marlin'):
        settings = MarlinSettings(
            emergency_parser=kind != 'marlin without parser',
            realtime_position=kind == 'marlin realtime',
            legacy_position=kind == 'marlin legacy',
            tells_settings=kind != 'marlin without M503',
        )
        return Marlin(world, clock, settings)
    return Grbl(world, clock, GrblSettings(dialect=kind, changes=changes))


def direct_rig(kind: str, changes: tuple[str, ...] = (), **more: Any) -> Rig:
    """Everything in one thread, on a clock that jumps."""
    clock = JumpingClock(START_NS)
    world, settings, passed = World(table=coarse_table()), settings_of(kind, **more), []
    if kind == 'simulated':
        return Rig(SimulatedCnc(settings, clock, world), world, clock)
    device = device_of(kind, world, clock, changes)
    port = DirectPort(device, clock)

    def traffic(way: str, stamp_ns: int, data: bytes) -> None:
        passed.append((way, stamp_ns, data))

    driver = MarlinCnc if kind.startswith('marlin') else GrblCnc
    cnc = driver(settings, clock, lambda: port, traffic, threaded=False)
    zero = (120.0, 120.0, 60.0) if kind.startswith('marlin') else (0.0, 0.0, 0.0)
    return Rig(cnc, world, clock, zero, device, port, passed)


def homed_rig(kind: str = 'marlin', **more: Any) -> Rig:
    """Above the gel."""
    rig = direct_rig(kind, **more)
    rig.cnc.connect()
    rig.cnc.home()
    rig.go(-60, -60, -5)
    return rig


@contextlib.contextmanager
def pty_rig(kind: str, folder: Path, silent_s: float = 10.0, **more: Any) -> Iterator[Rig]:
    """Through a pseudo terminal and the operating system, in real time, connected as a program does it.

    An emulated controller may have to wait for a processor, as no real one does: it counts as silent after `silent_s`.
    """
    start_mm = (-119.0, -119.0, -1.0) if kind == 'marlin' else (-1.0, -1.0, -1.0)  # near its switches
    clock, world = SystemClock(), World(WorldSettings(start_mm=start_mm), table=coarse_table())
    zero = (120.0, 120.0, 60.0) if kind == 'marlin' else (0.0, 0.0, 0.0)
    if kind == 'simulated':
        yield Rig(open_cnc(settings_of(kind, **more), clock, machine=world), world, clock)
        return
    device = device_of(kind, world, clock)
    with (
        pytest.MonkeyPatch.context() as patch,
        PtyPort(device, clock, folder / 'ttyTEST', reset_on_open=True) as port,
    ):
        for dialogue in (grbl_hearing, marlin_dialogue):
            patch.setattr(dialogue, 'SILENT_S', silent_s)
        settings = settings_of(kind, source=str(port.path), **more)
        with contextlib.closing(open_cnc(settings, clock)) as cnc:
            yield Rig(cnc, world, clock, zero, device, port)


Make = Callable[..., Rig]
