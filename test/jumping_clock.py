"""Clocks for tests that wait without waiting."""

from __future__ import annotations

from tactile_nodes.clock import NS_PER_S, SteppedClock, SystemClock


class JumpingClock(SteppedClock):
    """Time that passes only by being slept through."""

    def sleep_until(self, deadline_ns: int) -> None:
        self.set_ns(max(self.now_ns(), deadline_ns))


class AheadClock(SystemClock):
    """The host's time, and what a test lets pass at once: a limit of minutes is over when the test says so."""

    def __init__(self) -> None:
        super().__init__()
        self._ahead_ns = 0

    def now_ns(self) -> int:
        return super().now_ns() + self._ahead_ns

    def advance(self, seconds: float) -> None:
        """Let this time pass."""
        self._ahead_ns += round(seconds * NS_PER_S)
