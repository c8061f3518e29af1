"""Levels that do not flap: limits, the window, what ends them."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from tactile_nodes.sensing.judge.drift_alarm import Alarm, Level

S = 1_000_000_000


def fed(alarm: Alarm, values: list[float], begin_s: float = 0.0, every_s: float = 0.5) -> Alarm:
    for number, value in enumerate(values):
        alarm.feed(round((begin_s + number * every_s) * S), value)
    return alarm


def test_a_number_above_a_limit_for_three_seconds_is_an_alarm() -> None:
    assert fed(Alarm(1.0, 3.0), [2.0] * 6).level == Level.VALID  # 2.5 s
    assert fed(Alarm(1.0, 3.0), [2.0] * 7).level == Level.AGEING
    assert fed(Alarm(1.0, 3.0), [5.0] * 7).level == Level.INVALID


def test_time_counts_and_not_the_number_of_values() -> None:
    assert fed(Alarm(1.0), [2.0] * 100, every_s=0.02).level == Level.VALID  # 2 s
    assert fed(Alarm(1.0), [2.0] * 3, every_s=1.5).level == Level.AGEING


def test_a_single_value_however_large_is_no_alarm() -> None:
    assert fed(Alarm(1.0, 3.0), [0.0] * 6 + [1000.0] + [0.0] * 6).level == Level.VALID


def test_rare_evidence_counts_for_half_a_minute() -> None:
    """A gel that is pressed again and again is seen at rest every 8 s."""
    assert fed(Alarm(1.0), [0.0] * 4 + [2.0], every_s=8.0).level == Level.VALID
    assert fed(Alarm(1.0), [2.0] * 3, every_s=8.0).level == Level.AGEING
    assert fed(Alarm(1.0), [2.0] * 3, every_s=16.0).level == Level.VALID  # 32 s


def test_values_around_a_limit_do_not_flap() -> None:
    alarm, levels = Alarm(1.0), []
    for number in range(400):
        alarm.feed(number * S // 2, 1.0 + 0.25 * math.sin(number / 8))
        levels.append(alarm.level)
    assert sum(one != other for one, other in pairwise(levels)) == 1


def test_a_level_ends_below_seven_tenths_of_its_limit() -> None:
    alarm = fed(Alarm(1.0, 3.0), [5.0] * 13)
    assert fed(alarm, [2.2] * 13, begin_s=10).level == Level.INVALID
    assert fed(alarm, [2.0] * 13, begin_s=20).level == Level.AGEING
    assert fed(alarm, [0.71] * 13, begin_s=30).level == Level.AGEING
    assert fed(alarm, [0.69] * 13, begin_s=40).level == Level.VALID


def test_without_new_evidence_a_level_stays() -> None:
    alarm = fed(Alarm(1.0), [2.0] * 7)
    alarm.feed(3600 * S, 0.0)  # one value is no evidence
    assert alarm.level == Level.AGEING


def test_a_clock_that_goes_back_begins_anew() -> None:
    alarm = fed(Alarm(1.0), [2.0] * 5, begin_s=100)
    assert fed(alarm, [2.0] * 5).level == Level.VALID
    assert alarm.value != pytest.approx(2.0, nan_ok=True)


def test_a_small_number_ends_at_once_what_chance_cannot_make_small() -> None:
    assert fed(Alarm(1.0, 3.0, plain=True), [5.0] * 9 + [0.3]).level == Level.VALID
    assert fed(Alarm(1.0, 3.0, plain=True), [5.0] * 9 + [0.4]).level == Level.INVALID
    assert fed(Alarm(1.0, 3.0), [5.0] * 9 + [0.3]).level == Level.INVALID
