"""How often a process looks for others: as its own share of a processor permits, however busy the machine is."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import pytest

from tactile_nodes.bus.zeromq.discovery import LOOK_EVERY_S
from tactile_nodes.bus.zeromq.receiving import Hub
from tactile_nodes.clock import monotonic_s, thread_s


def compute(seconds: float) -> None:
    until_s = thread_s() + seconds
    while thread_s() < until_s:
        pass


@pytest.mark.parametrize(('spend', 'pause_s'), [(time.sleep, LOOK_EVERY_S), (compute, 2.0)])
def test_what_a_process_waits_for_its_turn_does_not_delay_its_next_look(spend: Any, pause_s: float) -> None:
    """On a busy machine, a look of 1 ms lasted 0.1 s, and what came in the next two seconds was not noticed."""
    meeting = SimpleNamespace(changed_ns=lambda: 1, look=lambda **_: [])
    bus: Any = SimpleNamespace(
        greet_newcomers=lambda: spend(0.1), meeting=meeting, wanted=dict, stay_present=lambda: None
    )
    hub = Hub(bus)
    begin_s = monotonic_s()
    hub._look_around()
    end_s = monotonic_s()
    hub.stop()
    assert begin_s + pause_s - 0.5 < hub._next_look_s < end_s + pause_s + 0.5
