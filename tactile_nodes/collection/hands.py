"""Performs the actions of procedures with the devices, and only while `Safety` has not stopped the machine.

Motion is split into jogs of at most `jog_s`, which are sent as the machine completes them, so that no more than two are
ever queued. If the process that commands the machine ends, the machine comes to rest within that time (a dead man's
switch).
"""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TypeVar

from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.collection.actions import Action, Go, Look, Observation, Procedure, SetTare, Switch
from tactile_nodes.collection.readings import Readings
from tactile_nodes.collection.safety import MACHINE, SILENT_MACHINE, Safety, Trip
from tactile_nodes.collection.settings import MotionSettings
from tactile_nodes.drivers.cnc.contract import Cnc, CncStatus, Place, Switched
from tactile_nodes.drivers.cnc.envelope import way_between
from tactile_nodes.drivers.force_torque.contract import Sample
from tactile_nodes.errors import DeviceError, DeviceFaultError, DeviceTimeoutError

BREATH_S = 0.01
STATE_S = 0.1
STOP_WAIT_S = 5.0
MOST_RETRACTS = 4
GRID = 1000  # a controller accepts three decimals of a mm
Result = TypeVar('Result')


class TrippedError(Exception):
    """The safety has stopped the machine. Caught within this package."""

    def __init__(self, trip: Trip) -> None:
        super().__init__(trip.reason)
        self.trip = trip


class InterruptedRunError(Exception):
    """The run was asked to end. Caught within this package."""


class Hands:
    """One machine, monitored by one `Safety`.

    Args:
        cnc: connected.
        clock: the host's.
        safety: stops the machine through `Guard`.
        readings: the data of sensor and camera.
        motion: limits such as the length of a jog.
        on_status: called with the position of the machine, about ten times per second.
        on_switch: called on each change of the digital line.
        stopped: waits up to this many seconds until no stop is in progress; returns whether that is so.
    """

    def __init__(
        self,
        cnc: Cnc,
        clock: Clock,
        safety: Safety,
        readings: Readings,
        motion: MotionSettings,
        on_status: Callable[[CncStatus], None] | None = None,
        on_switch: Callable[[Switched], None] | None = None,
        stopped: Callable[[float], bool] | None = None,
    ) -> None:
        self.cnc = cnc
        self.clock = clock
        self.safety = safety
        self.readings = readings
        self._motion = motion
        self._on_status = on_status
        self._on_switch = on_switch
        self._stopped = stopped
        self._state_ns = 0
        self._place: Place = (math.nan, math.nan, math.nan)
        self._line = False
        self._line_ns = 0
        self._expect: Callable[[Place, Sequence[Sample]], str] | None = None
        self._passed: tuple[int, Place] | None = None
        self.asked_to_stop = False
        self.homing = False
        self.machine_failed = False
        """Whether the machine failed to perform a command."""

    def run(self, procedure: Procedure[Result]) -> Result:
        """Perform all actions of a procedure; returns its result.

        Raises:
            TrippedError: the safety has stopped the machine.
            InterruptedRunError: `asked_to_stop` was set.
            DeviceError: a device failed, or the procedure found a device fault.
        """
        try:
            action = next(procedure)
            while True:
                action = procedure.send(self.perform(action))
        except StopIteration as ended:
            result: Result = ended.value
            return result
        finally:
            procedure.close()

    def perform(self, action: Action) -> Observation:
        """Perform one action. Raises as `run`."""
        self.check()
        since_ns, switched = self.clock.now_ns(), None
        try:
            if isinstance(action, Go):
                self._go_watched(action)
            elif isinstance(action, Look):
                self.wait(action.seconds)
            elif isinstance(action, SetTare):
                self.safety.tare(action.tare.wrench)
            elif isinstance(action, Switch):
                switched = self.switch(action.level)
            self.check()
            now_ns = self.clock.now_ns()
            place = self._place if isinstance(action, Look) else self._status().position_mm
        except DeviceError:
            if (health := self.cnc.health).silent:  # before the guard has checked
                self.safety.fail(SILENT_MACHINE, health.message, self.clock.now_ns())
            self.check()  # if the safety has stopped the machine, commands fail because of that
            self.machine_failed = True
            raise
        if not isinstance(action, Look):
            return Observation(now_ns, since_ns, place, switched=switched)
        from_ns = since_ns if action.since_ns is None else action.since_ns
        samples, frames = self.readings.samples(from_ns), self.readings.frames(from_ns)
        return Observation(now_ns, since_ns, place, tuple(samples), tuple(frames))

    def check(self) -> None:
        """Raise if something is wrong. Raises as `run`, but not for devices."""
        if self.safety.trip is not None:
            raise TrippedError(self.safety.trip)
        if self.asked_to_stop:
            raise InterruptedRunError

    def home(self) -> None:
        """Home the machine at its end switches. Raises as `run`."""
        self._await_stopped()
        self.homing = True
        try:
            self.check()
            self.cnc.home()
        except DeviceError:
            self.check()  # if the machine was stopped on purpose, homing fails because of that
            self.machine_failed = True
            raise
        finally:
            self.homing = False
        self.check()

    def wait(self, seconds: float) -> None:
        """Wait, with all checks active. Raises as `run`."""
        end_ns = self.clock.now_ns() + round(seconds * NS_PER_S)
        while (now_ns := self.clock.now_ns()) < end_ns:
            self.check()
            if now_ns - self._state_ns >= STATE_S * NS_PER_S:
                self._status()
            self.clock.sleep_until(min(end_ns, now_ns + round(BREATH_S * NS_PER_S)))

    def switch(self, level: bool, since_ns: int | None = None) -> Switched:
        """Switch the digital line. Give `since_ns` if it may have changed by itself since then."""
        switched = self.cnc.set_line(level)
        if since_ns is not None:
            switched = replace(switched, earliest_ns=since_ns)
        self._line, self._line_ns = level, switched.latest_ns
        if self._on_switch is not None:
            self._on_switch(switched)
        return switched

    def retreat(self) -> None:
        """Stop and go straight up to the safe height, even if sensors have failed.

        A silent machine is waited for, as long as for any device (`recover_s`).

        Raises:
            DeviceError: the machine does not obey, or its position is unknown.
        """
        give_up_ns, attempt = self.clock.now_ns() + self.safety.recover_ns, 1
        while True:
            before = self.safety.trip
            try:
                self._await_stopped()
                self.cnc.retract()
                break
            except DeviceError as error:  # the guard stopped it, or the machine became silent: a retry may succeed
                silent = self.cnc.health.silent or isinstance(error, DeviceTimeoutError)
                waits = silent and self.clock.now_ns() < give_up_ns
                if not waits and (attempt == MOST_RETRACTS or self.safety.trip is before):
                    raise
                attempt += not waits
                self.clock.sleep_until(self.clock.now_ns() + round(STATE_S * NS_PER_S))
        if self._line:
            self.switch(False, self._line_ns)  # the stop has set it low already, if it was a reset
        if not self._status().homed:
            raise DeviceFaultError('the machine has lost its position, so it is unknown whether the tip is up')

    def overlook(self, seconds: float, times: int = 1) -> Sequence[Sample]:
        """Usable samples measured from now on, even after a trip; waits up to `times` times until some have come.

        Samples arrive late, on a busy computer much later.
        """
        since_ns = self.clock.now_ns()
        for number in range(1, times + 1):
            self.clock.sleep_until(since_ns + round(number * seconds * NS_PER_S))
            if samples := [sample for sample in self.readings.samples(since_ns) if sample.usable]:
                return samples
        return []

    def _await_stopped(self) -> None:
        if self._stopped is not None and not self._stopped(STOP_WAIT_S):
            raise DeviceFaultError('the machine does not stop when commanded to; use the emergency stop')

    def _go_watched(self, go: Go) -> None:
        """Go, and check on the way that the force is as expected."""
        self._expect, self._passed = go.expect, None
        try:
            self._go(go)
            if go.expect is not None:
                self._status()
        finally:
            self._expect = None

    def _compare(self, now_ns: int, place: Place) -> None:
        """Compare the samples since the machine was last at a known position with the expected force there.

        A sensor that averages shows a force fully only after some periods, so the check waits for them.
        """
        if self._expect is None:
            return
        if self._passed is None:
            self._passed = now_ns, place
        passed_ns, passed = self._passed
        if not (felt := self.readings.samples(passed_ns + self.safety.settling_ns)):
            return
        self._passed = now_ns, place
        if why := self._expect(passed, felt):
            self.safety.fail(MACHINE, why, now_ns)

    def _go(self, go: Go) -> None:
        start = self._status()
        if not start.homed:
            raise DeviceFaultError('the position of the machine is unknown; home it before anything moves')
        x, y, z = start.position_mm
        target = (x if go.x is None else go.x, y if go.y is None else go.y, z if go.z is None else go.z)
        feed = self.cnc.feed_along(way_between(start.position_mm, target), go.feed_mm_min)
        busy_until_ns = self.clock.now_ns()
        for way, seconds in self._pieces(start.position_mm, target, feed):
            self.check()
            self.cnc.jog(*way, feed=feed)
            if self.safety.trip is not None:  # the guard may have stopped the machine just before this jog was sent
                self.cnc.stop()
            busy_until_ns = max(busy_until_ns, self.clock.now_ns()) + round(seconds * NS_PER_S)
            ahead_s = (busy_until_ns - self.clock.now_ns()) / NS_PER_S
            if self.cnc.blind_step_mm is not None:
                self.cnc.wait_idle()
                self._status()
            else:
                self.wait(max(0.0, ahead_s - self._motion.jog_s / 2))
        self.wait((busy_until_ns - self.clock.now_ns()) / NS_PER_S)
        self.cnc.wait_idle()

    def _pieces(self, start: Place, target: Place, feed: float) -> Iterator[tuple[Place, float]]:
        """Steps from start to target that add up to the µm, with the duration of each at this feed."""
        length = math.dist(start, target)
        longest = min(self.cnc.blind_step_mm or math.inf, feed / 60 * self._motion.jog_s)
        count = max(1, math.ceil(length / longest - 1e-9))
        done = [round(value * GRID) for value in start]
        for number in range(1, count + 1):
            share = number / count
            there = [round((a + share * (b - a)) * GRID) for a, b in zip(start, target, strict=True)]
            x, y, z = ((b - a) / GRID for a, b in zip(done, there, strict=True))
            done = there
            if x or y or z:
                yield (x, y, z), math.hypot(x, y, z) / (feed / 60)

    def _status(self) -> CncStatus:
        status = self.cnc.status()
        self._state_ns = self.clock.now_ns()
        self._place = status.position_mm
        self._compare(self._state_ns, self._place)
        if self._on_status is not None:
            self._on_status(status)
        return status


class Guard:
    """The thread that stops the machine as soon as the safety requests it. It also checks for silent devices.

    Args:
        cnc: the machine to stop.
        clock: for the watchdogs.
        homing: whether it homes, or is about to.
    """

    def __init__(self, cnc: Cnc, clock: Clock, homing: Callable[[], bool] = lambda: False) -> None:
        self._cnc = cnc
        self._clock = clock
        self._homing = homing
        self._lock = threading.Lock()  # makes the two events change together
        self._tripped = threading.Event()
        self._ending = False
        self.stopped = threading.Event()
        self.stopped.set()
        self._thread: threading.Thread | None = None

    def start(self, safety: Safety) -> None:
        self._thread = threading.Thread(target=self._run, args=(safety,), name='rig guard', daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stop the machine now; returns at once."""
        with self._lock:
            self.stopped.clear()
            self._tripped.set()

    def close(self) -> None:
        """End the thread."""
        self._ending = True
        self._tripped.set()
        if self._thread is not None:
            self._thread.join(STOP_WAIT_S)

    def _run(self, safety: Safety) -> None:
        while not self._ending:
            try:
                if self._tripped.wait(BREATH_S):
                    self._tripped.clear()
                    self._stop()
                else:
                    safety.tick(self._clock.now_ns(), self._cnc.health)
            except Exception as error:  # noqa: BLE001 - a bug: nothing may move unmonitored
                reason = f'a bug in the monitoring of the rig: {type(error).__name__}: {error}'
                safety.fail(MACHINE, reason, self._clock.now_ns())

    def _stop(self) -> None:
        try:
            again = not self.stopped.is_set()
            while again:
                with contextlib.suppress(DeviceError):  # the retract meets the same fault and reports it
                    self._cnc.stop()
                if again := self._homing():  # just before it begins, a stop ends nothing
                    self._clock.sleep_until(self._clock.now_ns() + round(STATE_S * NS_PER_S))
                    again = self._homing()
        finally:
            with self._lock:
                if self._ending or not self._tripped.is_set():  # a reason that came meanwhile has its own stop
                    self.stopped.set()
