"""A clock for tests that wait without waiting."""

from __future__ import annotations

from tactile_nodes.clock import SteppedClock


class JumpingClock(SteppedClock):
    """Time that passes only by being slept through."""

    def sleep_until(self, deadline_ns: int) -> None:
        self.set_ns(max(self.now_ns(), deadline_ns))
