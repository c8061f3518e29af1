"""A queue of samples between the receiving thread and the reader: numbered, with all losses counted."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence

from tactile_nodes.clock import NS_PER_S
from tactile_nodes.drivers.force_torque.check import SampleCheck
from tactile_nodes.drivers.force_torque.contract import Flag, Listener, Sample, Wrench
from tactile_nodes.errors import DeviceError, DeviceLostError, DeviceTimeoutError, TactileError


class SampleQueue:
    """Every sample once, oldest first, and the newest at any time.

    Args:
        name: name of the sensor, for errors.
        depth: largest number of waiting samples; beyond it, the oldest are dropped and counted.
        check: checks the numbers of each sample.

    Attributes:
        rate_hz: samples per second, to estimate how many a sensor made while it was lost.
        newest: the last sample put; None before the first.
        failure: why there are no samples now; None: they come.
    """

    def __init__(self, name: str, depth: int, check: SampleCheck) -> None:
        self.rate_hz = 0.0
        self._name = name
        self._depth = depth
        self._check = check
        self._waiting: deque[Sample] = deque()
        self._changed = threading.Condition()
        self._listeners: tuple[Listener, ...] = ()
        self.newest: Sample | None = None
        self._sequence = -1
        self._missing = 0
        self._overflow = 0
        self.failure: TactileError | None = None
        self._closed = False

    @property
    def dropped(self) -> int:
        """Samples lost so far, in transit or for lack of a reader."""
        return self._missing + self._overflow

    def listen(self, listener: Listener) -> None:
        """Call `listener` with each sample as it is put."""
        self._listeners = (*self._listeners, listener)

    def put(
        self,
        wrench: Wrench,
        raw: tuple[float, ...],
        stamp_ns: int,
        arrival_ns: int,
        ticks: int,
        flags: int = 0,
        status: int = 0,
        missing: int = 0,
    ) -> None:
        """Add a sample; `missing` before it were lost."""
        flags |= self._check.flags(wrench)
        if self.failure is not None and self.newest is not None:
            flags |= Flag.RESTARTED
            missing = max(missing, self._missed_since(self.newest.stamp_ns, stamp_ns))
        self._sequence += 1 + missing
        self._missing += missing
        arrival_ns = max(arrival_ns, stamp_ns)  # of one read, several stamped on arrival are a nanosecond apart
        sample = Sample(wrench, stamp_ns, arrival_ns, ticks, self._sequence, self._missing, int(flags), status, raw)
        for listener in self._listeners:
            listener(sample)
        with self._changed:
            self.failure = None
            self.newest = sample
            self._waiting.append(sample)
            if len(self._waiting) > self._depth:
                self._waiting.popleft()
                self._overflow += 1
            self._changed.notify_all()

    def fail(self, error: TactileError) -> None:
        """Report that there will be no samples until further notice, and why."""
        with self._changed:
            self.failure = error
            self._changed.notify_all()

    def close(self) -> None:
        """End on request; no more samples."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def wait(self, timeout_s: float) -> bool:
        """Whether a sample has arrived in time; it stays unread."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self.failure, timeout_s)
            return bool(self._waiting)

    def take(self, timeout_s: float) -> Sequence[Sample]:
        """All waiting samples; at least one.

        Raises:
            DeviceTimeoutError: none came.
            DeviceError: it is closed.
            DeviceLostError: from the error given to `fail`.
        """
        with self._changed:
            if not self._changed.wait_for(lambda: self._waiting or self.failure or self._closed, timeout_s):
                raise DeviceTimeoutError(f'{self._name} sent no sample within {timeout_s:g} s; check cable and power')
            if self._closed:
                raise closed(self._name)
            if not self._waiting:
                raise DeviceLostError(str(self.failure or f'{self._name} is lost')) from self.failure
            taken = list(self._waiting)
            self._waiting.clear()
            overflow = self._overflow
        if overflow == 0:
            return taken
        return [sample._replace(dropped=sample.dropped + overflow) for sample in taken]

    def _missed_since(self, last_ns: int, stamp_ns: int) -> int:
        return max(0, round((stamp_ns - last_ns) * self.rate_hz / NS_PER_S) - 1)


def closed(name: str) -> DeviceError:
    """The error for a sensor that is not open."""
    return DeviceError(f'{name} is closed; open it before reading')
