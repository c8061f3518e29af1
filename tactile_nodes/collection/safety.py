"""Decides when everything must stop. It gets every force sample, in the sensor's reading thread, and the time.

It only decides; `on_trip` stops the machine. The first reason stands until `reset`, unless the force rises to an
unbearable value.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from tactile_nodes.collection.settings import LimitSettings
from tactile_nodes.drivers.force_torque.check import permitted_ms, too_old
from tactile_nodes.drivers.force_torque.contract import UNUSABLE, Flag, Sample, Wrench
from tactile_nodes.drivers.force_torque.stream import describe_flags
from tactile_nodes.drivers.health import Health, Level

FORCE, SENSOR, CAMERA, MACHINE = 'force', 'force/torque sensor', 'camera', 'machine'
SILENT_MACHINE = 'silent machine'
PASSING = frozenset({SENSOR, CAMERA, SILENT_MACHINE})
"""Faults that may pass: the run waits for recovery."""
UNTIMED = 'the clock of the force/torque sensor does not keep its rate, so the age of its samples is unknown'
OVERLOAD = 'overload'
NS_PER_S = 1_000_000_000
NS_PER_MS = 1_000_000
SETTLING_PERIODS = 4  # until an averaging converter (HX711) shows a step fully
TICK_NS = 30 * NS_PER_MS  # a longer time between two ticks means that this process did not run


@dataclass(frozen=True)
class Trip:
    """Why everything stopped: the cause, a sentence, and when.

    `FORCE`: above the limit of a press; `OVERLOAD`: more than gel, tip and sensor can bear, so that a person must
    check; `SENSOR`, `CAMERA`, `MACHINE`: fault of that device; `SILENT_MACHINE`: the machine sends nothing."""

    kind: str
    reason: str
    stamp_ns: int


class Safety:
    """The limits. Before the first tare, the force is measured as the change since the first sample.

    Args:
        limits: the numbers.
        on_trip: called at once when something is wrong, in the thread that found it; must be quick.
        rate_hz: expected force samples per second (`ForceTorqueSensor.expected_hz`); 0: unknown.
    """

    def __init__(
        self, limits: LimitSettings, on_trip: Callable[[Trip], None] | None = None, rate_hz: float = 0.0
    ) -> None:
        self._limits = limits
        self._on_trip = on_trip
        self._lock = threading.RLock()
        self._recent: deque[tuple[int, float]] = deque()
        self._zero: Wrench | None = None
        self._newest: Sample | None = None
        self._frame_ns = 0
        self.silence_ms = permitted_ms(limits.force_silence_ms, rate_hz)
        self.settling_ns = round(SETTLING_PERIODS * NS_PER_S / rate_hz) if rate_hz > 0 else 0
        self.recover_ns = round(limits.recover_s * NS_PER_S)
        self._since_ns = self._ticked_ns = 0
        self._absent_ns = {SENSOR: 0, CAMERA: 0}
        self._trip: Trip | None = None
        self.greatest_n = 0.0
        self.watching = False
        self.watching_camera = False
        self.watching_machine = True
        self.machine_tripped = False
        """Whether the machine was ever at fault; a larger force may have replaced that reason."""
        self.fell_silent = False
        """Whether sensor or camera was ever at fault, or the machine was ever silent."""
        self._late = False

    @property
    def trip(self) -> Trip | None:
        """Why everything stopped, or None. When a reason can be read, the machine is already being stopped."""
        with self._lock:
            return self._trip

    def tare(self, zero: Wrench) -> None:
        """Measure the force from now on as the change since this value."""
        with self._lock:
            self._zero = zero
            self._recent.clear()

    def watch(self, now_ns: int, camera: bool) -> None:
        """Start checking for silent devices; each has its full time from now."""
        self._since_ns = now_ns
        self.watching, self.watching_camera = True, camera

    def reset(self, now_ns: int, handled: Trip | None) -> None:
        """Clear the reason that was handled; a worse one that has come since stands."""
        with self._lock:
            self._recent.clear()
            self._trip = None if self._trip is handled else self._trip
            self._since_ns = now_ns

    def sample(self, sample: Sample) -> None:
        """Check a force sample."""
        self._newest = sample
        if not self.watching:
            return
        if sample.flags and self._flagged(sample):
            return
        force, torque = self._change(sample.wrench)
        if math.isnan(force):
            self._stop(SENSOR, 'the force/torque sensor measures no force at all', sample.arrival_ns)
            return
        self.greatest_n = max(self.greatest_n, force)
        self._check_force(sample, force, torque)

    def _flagged(self, sample: Sample) -> bool:
        """Stop because of a sample's flags; False if none of them is a reason to."""
        if sample.flags & Flag.SATURATED:
            self._stop(OVERLOAD, 'the load exceeds the range of the force/torque sensor', sample.arrival_ns)
        elif sample.flags & Flag.THRESHOLD:
            self._stop(
                OVERLOAD,
                'the load exceeded a threshold that is set in the force/torque sensor; it reports this until somebody '
                'resets its threshold latch',
                sample.arrival_ns,
            )
        elif sample.flags & UNUSABLE:
            wrong = describe_flags(sample.flags & UNUSABLE)
            self._stop(SENSOR, f'the force/torque sensor reports: {wrong}', sample.arrival_ns)
        elif sample.flags & Flag.UNTIMED:
            self._stop(SENSOR, f'{UNTIMED}; check its configured rate', sample.arrival_ns)
        else:
            return False
        return True

    def frame(self, arrival_ns: int) -> None:
        self._frame_ns = arrival_ns

    def tick(self, now_ns: int, machine: Health) -> None:
        """Check for silent devices.

        Data that arrived while this process did not run is still unread, so that time does not count as silence.
        """
        absent_ns = max(0, now_ns - self._ticked_ns - TICK_NS) if self._ticked_ns else 0
        self._ticked_ns = now_ns
        if not self.watching:
            return
        if wrong := self._old_sample(now_ns, absent_ns):
            self._stop(SENSOR, f'the force/torque sensor {wrong}', now_ns)
        if wrong := self._old_frame(now_ns, absent_ns):
            self._stop(CAMERA, wrong, now_ns)
        late, self._late = self._late, absent_ns > 0
        if self.watching_machine and machine.level is Level.ERROR and (late or not absent_ns):
            self._stop(SILENT_MACHINE if machine.silent else MACHINE, machine.message, now_ns)

    def fail(self, kind: str, reason: str, now_ns: int) -> None:
        """Stop for a reason found elsewhere."""
        self._stop(kind, reason, now_ns)

    def _old_sample(self, now_ns: int, absent_ns: int) -> str:
        def wrong(excused_ns: int) -> str:
            return too_old(self._newest, self._since_ns, now_ns - excused_ns, self.silence_ms)

        return self._excused(SENSOR, wrong, absent_ns)

    def _old_frame(self, now_ns: int, absent_ns: int) -> str:
        silent_ns = now_ns - max(self._frame_ns, self._since_ns)

        def wrong(excused_ns: int) -> str:
            if not self.watching_camera or silent_ns - excused_ns <= self._limits.camera_silence_ms * NS_PER_MS:
                return ''
            return f'the camera has sent no image for {silent_ns / NS_PER_MS:.0f} ms'

        return self._excused(CAMERA, wrong, absent_ns)

    def _excused(self, device: str, wrong: Callable[[int], str], absent_ns: int) -> str:
        """The fault, if it remains without the time in which this process did not run since the device was fine."""
        if not wrong(0):
            self._absent_ns[device] = 0
            return ''
        self._absent_ns[device] += absent_ns
        return wrong(self._absent_ns[device])

    def _change(self, wrench: Wrench) -> tuple[float, float]:
        with self._lock:
            if self._zero is None:
                self._zero = wrench
            change = [value - zero for value, zero in zip(wrench, self._zero, strict=True)]
        return _length(change[:3]), _length(change[3:])

    def _check_force(self, sample: Sample, force: float, torque: float) -> None:
        limits, now_ns = self._limits, sample.arrival_ns
        if force > limits.bearable_n:
            self._stop(OVERLOAD, f'the force is {force:.2f} N, more than the bearable {limits.bearable_n:g} N', now_ns)
        elif force > limits.force_n:
            self._stop(FORCE, f'the force is {force:.2f} N, above the limit of {limits.force_n:g} N', now_ns)
        elif 0 < limits.torque_nm < torque:
            self._stop(FORCE, f'the torque is {torque:.3f} N m, above the limit of {limits.torque_nm:g} N m', now_ns)
        elif (rise := self._rise(sample.stamp_ns, force)) > limits.force_rate_n_s:
            self._stop(FORCE, f'the force rises by {rise:.0f} N/s, above {limits.force_rate_n_s:g} N/s', now_ns)

    def _rise(self, stamp_ns: int, force: float) -> float:
        """The rise over the last `rate_ms`; 0 until there are samples for that long."""
        with self._lock:
            recent, span_ns = self._recent, self._limits.rate_ms * NS_PER_MS
            recent.append((stamp_ns, force))
            while len(recent) > 2 and recent[1][0] <= stamp_ns - span_ns:
                recent.popleft()
            first_ns = recent[0][0]
            if stamp_ns - first_ns < span_ns:
                return 0.0
            rise = force - recent[0][1]
        return rise * NS_PER_S / (stamp_ns - first_ns)

    def _stop(self, kind: str, reason: str, now_ns: int) -> None:
        with self._lock:
            self.machine_tripped |= kind in {MACHINE, SILENT_MACHINE}
            self.fell_silent |= kind in PASSING
            if self._trip is not None and not (kind == OVERLOAD != self._trip.kind):
                return
            self._trip = trip = Trip(kind, reason, now_ns)
            if self._on_trip is not None:
                self._on_trip(trip)


def _length(values: list[float]) -> float:
    """Vector length over the measured axes; NaN if none is measured."""
    measured = [value for value in values if not math.isnan(value)]
    return math.hypot(*measured) if measured else math.nan
