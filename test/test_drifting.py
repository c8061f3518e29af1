"""From which stamp on a verdict holds."""

from __future__ import annotations

from dataclasses import replace

from tactile_nodes.drifting import Told
from tactile_nodes.sensing.drift import DriftMonitor
from tactile_nodes.sensing.drift_alarm import Level

S = 1_000_000_000
WELL = replace(DriftMonitor().verdict, level=Level.VALID)
WORSE = replace(WELL, level=Level.INVALID)


def test_a_worse_verdict_holds_half_a_second_later_and_a_better_one_at_once() -> None:
    told = Told()
    assert told.holds_from_ns(WORSE, 10 * S, of_rest=False) == 10 * S + S // 2
    assert told.holds_from_ns(WORSE, 11 * S, of_rest=False) == 11 * S + S // 2
    assert told.holds_from_ns(WELL, 12 * S, of_rest=False) == 12 * S


def test_a_verdict_on_a_rest_image_holds_from_that_image_on() -> None:
    assert Told().holds_from_ns(WORSE, 10 * S, of_rest=True) == 10 * S
