"""What the tests of all drivers share: clocks."""

from __future__ import annotations

import pytest
from jumping_clock import AheadClock, JumpingClock

from tactile_nodes.clock import SystemClock


@pytest.fixture
def clock() -> SystemClock:
    return SystemClock()


@pytest.fixture
def jumping() -> JumpingClock:
    return JumpingClock(1_700_000_000_000_000_000)


@pytest.fixture
def ahead() -> AheadClock:
    return AheadClock()
