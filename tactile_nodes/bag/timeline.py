"""The position of a playback as a function of time, without accumulating errors."""

from __future__ import annotations

import threading


class Timeline:
    """Maps the clock's time to the bag's time. While it is paused the bag's time stands still.

    >>> line = Timeline(rate=2.0)
    >>> line.start(now_ns=1000, bag_ns=50)
    >>> line.bag_ns(1010), line.due_ns(90)
    (70, 1020)
    """

    def __init__(self, rate: float = 1.0) -> None:
        self._lock = threading.Lock()
        self._rate = rate
        self._now_ns = self._bag_ns = 0
        self._paused = False

    @property
    def rate(self) -> float:
        return self._rate

    @property
    def paused(self) -> bool:
        return self._paused

    def start(self, now_ns: int, bag_ns: int) -> None:
        """At `now_ns` the position is `bag_ns`; also used to step while paused."""
        with self._lock:
            self._now_ns, self._bag_ns = now_ns, bag_ns

    def pause(self, now_ns: int) -> None:
        """Pause."""
        self._change(now_ns, self._rate, True)

    def resume(self, now_ns: int) -> None:
        """Continue."""
        self._change(now_ns, self._rate, False)

    def set_rate(self, now_ns: int, rate: float) -> None:
        """Continue at another speed, without a jump."""
        self._change(now_ns, rate, self._paused)

    def bag_ns(self, now_ns: int) -> int:
        """The bag's time at `now_ns`."""
        with self._lock:
            return self._at(now_ns)

    def due_ns(self, bag_ns: int) -> int | None:
        """The clock's time at which the bag's time will be `bag_ns`; None while paused."""
        with self._lock:
            return None if self._paused else self._now_ns + round((bag_ns - self._bag_ns) / self._rate)

    def _at(self, now_ns: int) -> int:
        return self._bag_ns if self._paused else self._bag_ns + round((now_ns - self._now_ns) * self._rate)

    def _change(self, now_ns: int, rate: float, paused: bool) -> None:
        with self._lock:
            self._now_ns, self._bag_ns = now_ns, self._at(now_ns)
            self._rate, self._paused = rate, paused
