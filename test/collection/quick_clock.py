"""A clock for tests of things with threads of their own, which would wait for seconds on the host's."""

from __future__ import annotations

from tactile_nodes.clock import SystemClock


class QuickClock:
    """Time that passes so many times as fast as the host's. What a busy machine delays is as much later on it."""

    def __init__(self, times: int) -> None:
        self._host = SystemClock()
        self._times = times
        self._begun_ns = self._host.now_ns()

    def now_ns(self) -> int:
        return self._begun_ns + self._times * (self._host.now_ns() - self._begun_ns)

    def sleep_until(self, deadline_ns: int) -> None:
        self._host.sleep_until(self._begun_ns + -((self._begun_ns - deadline_ns) // self._times))
