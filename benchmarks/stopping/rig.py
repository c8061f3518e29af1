"""The rig of the stopping benchmark: emulated devices in a separate process that monitors force, line and tip."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path

from benchmarks.harness.workers import asked
from tactile_nodes.clock import NS_PER_S, SystemClock
from tactile_nodes.emulators.cnc.grbl import JOG_CANCEL, Grbl
from tactile_nodes.emulators.force_torque.net_ft import NetFtServer
from tactile_nodes.emulators.force_torque.net_ft_box import NetFtBox
from tactile_nodes.emulators.force_torque.net_ft_config import NetFtConfig
from tactile_nodes.emulators.serial_ports import PtyPort
from tactile_nodes.emulators.world import World, Wrench

STOPS = {JOG_CANCEL, ord('!')}
QUIET = {ord('?')}
STEP_NS = NS_PER_S // 2000
WATCHED_S = 2.0
NEVER = -1
NOISE = (2e-5, 2e-6)  # N and N m: without noise the sensor would count as frozen; more would affect the result


@dataclass
class Seen:
    """Measurements at one stop, with times of the host's clock.

    Attributes:
        sample_ns: time of the first sample above the limit.
        stop_ns: arrival of the stop at the controller.
        rest_ns: time when the tip was at rest.
        before: bytes that arrived between sample and stop.
        sample_n: force of that sample; greatest_n: largest force until the tip was at rest.
        way_mm: distance that the tip moved down after that sample.
    """

    sample_ns: int = NEVER
    stop_ns: int = NEVER
    rest_ns: int = NEVER
    before: bytes = b''
    sample_n: float = 0.0
    greatest_n: float = 0.0
    way_mm: float = 0.0


@dataclass
class Watch:
    """The force limit, and the measurements so far."""

    limit_n: float
    seen: Seen = field(default_factory=Seen)
    armed: bool = False
    lock: threading.Lock = field(default_factory=threading.Lock)


class WatchedForce:
    """Records the first sample above the limit."""

    def __init__(self, world: World, watch: Watch) -> None:
        self._world = world
        self._watch = watch

    def wrench_at(self, time_ns: int) -> Wrench:
        """As `WrenchSource.wrench_at`."""
        wrench = self._world.wrench_at(time_ns)
        watch = self._watch
        if watch.armed and watch.seen.sample_ns == NEVER and abs(wrench[2]) > watch.limit_n:
            watch.seen.sample_n = abs(wrench[2])
            watch.seen.sample_ns = time_ns
        return wrench


class WatchedGrbl(Grbl):
    """Records the bytes that arrive after that sample."""

    watch: Watch

    def _byte(self, byte: int) -> None:
        seen = self.watch.seen
        if self.watch.armed and seen.sample_ns != NEVER and seen.stop_ns == NEVER and self.now_ns >= seen.sample_ns:
            if byte in STOPS:
                seen.stop_ns = self.now_ns
            elif byte not in QUIET:
                seen.before += bytes([byte])
        super()._byte(byte)


def serve(pipe: Connection, folder: Path, limit_n: float, divider: int) -> None:
    """The process: 'arm' starts a measurement, 'tell' returns it."""
    clock, watch = SystemClock(), Watch(limit_n)
    world = World()
    grbl = WatchedGrbl(world, clock)
    grbl.watch = watch
    box = NetFtBox(WatchedForce(world, watch), NetFtConfig(divider=divider), noise=NOISE)
    with PtyPort(grbl, clock, folder / 'cnc'), NetFtServer(box, clock) as server:
        pipe.send((server.rdt_port, server.http_port))
        for word in asked(pipe):
            if word == 'arm':
                watch.seen, watch.armed = Seen(), True
            else:
                watch.armed = False
                pipe.send(_followed(world, watch.seen))


def _followed(world: World, seen: Seen) -> Seen:
    """Add the motion of the tip from the sample to the first rest, from the world's history."""
    if NEVER in {seen.sample_ns, seen.stop_ns}:
        return seen
    begin, time_ns = world.tip_at(seen.sample_ns)[2], seen.sample_ns
    while time_ns < seen.sample_ns + round(WATCHED_S * NS_PER_S):
        seen.greatest_n = max(seen.greatest_n, world.force_at(time_ns))
        if time_ns > seen.stop_ns and world.motor_speed_at(time_ns) == 0.0:
            seen.rest_ns, seen.way_mm = time_ns, begin - world.tip_at(time_ns)[2]
            return seen
        time_ns += STEP_NS
    return seen
