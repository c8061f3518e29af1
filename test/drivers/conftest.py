"""What the tests of all drivers share: clocks."""

from __future__ import annotations

import pytest

from tactile_nodes.clock import SteppedClock, SystemClock


@pytest.fixture
def clock() -> SystemClock:
    return SystemClock()


class JumpingClock(SteppedClock):
    """Time that passes only by being slept through."""

    def sleep_until(self, deadline_ns: int) -> None:
        self.set_ns(max(self.now_ns(), deadline_ns))


@pytest.fixture
def jumping() -> JumpingClock:
    return JumpingClock(1_700_000_000_000_000_000)
