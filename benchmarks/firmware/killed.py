"""A press whose commanding process is killed: tests the watchdog program with real firmware."""

from __future__ import annotations

from collections.abc import Callable
from multiprocessing.connection import Connection

from benchmarks.firmware.descent import above, down, station
from benchmarks.harness.workers import Worker
from tactile_nodes.clock import NS_PER_S, Clock, SystemClock
from tactile_nodes.collection.hands import TrippedError
from tactile_nodes.drivers.cnc.contract import CncSettings, Place
from tactile_nodes.drivers.force_torque.contract import ForceTorqueSettings
from tactile_nodes.errors import TactileError

ABOVE, DOWN, ENDED = 'above', 'down', 'ended'
LOOK_S, DEEP_S, FREE_S = 0.01, 20.0, 20.0


class Commander:
    """A process, to be killed, that opens machine and sensor, and presses on request.

    Raises:
        TactileError: it did not reach the place above the gel.
    """

    def __init__(self, cnc: CncSettings, sensor: ForceTorqueSettings, gel_mm: Place) -> None:
        self._worker = Worker(_commanding, cnc, sensor, gel_mm)
        try:
            self._worker.answer()
        except BaseException:
            self._worker.close()
            raise

    def press(self) -> None:
        """Start the descent; returns at once."""
        self._worker.send(DOWN)

    def kill(self) -> None:
        """Kill the process with SIGKILL; may be called from any thread."""
        self._worker.process.kill()

    def close(self) -> None:
        """End the process, if it still runs."""
        self._worker.close()


def until(condition: Callable[[], bool], clock: Clock, within_s: float) -> bool:
    """Wait for a condition; False if it is not true in time."""
    deadline_ns = clock.now_ns() + round(within_s * NS_PER_S)
    while not condition():
        if clock.now_ns() > deadline_ns:
            return False
        clock.sleep_until(clock.now_ns() + round(LOOK_S * NS_PER_S))
    return True


def _commanding(pipe: Connection, cnc: CncSettings, sensor: ForceTorqueSettings, gel_mm: Place) -> None:
    clock = SystemClock()
    try:
        rig = station(cnc, sensor, clock)
        try:
            tare = above(rig, gel_mm, cnc.safe_z_mm, clock)
            pipe.send(ABOVE)
            pipe.recv()
            rig.hands.run(down(gel_mm[2], tare))
            pipe.send(ENDED)
        finally:
            rig.close()
    except TrippedError as tripped:
        pipe.send(TactileError(tripped.trip.reason))
    except TactileError as error:
        pipe.send(TactileError(str(error)))
