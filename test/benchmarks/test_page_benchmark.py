"""The benchmark of the page runs and reports; what it finds depends on the machine, and is nothing to assert."""

from __future__ import annotations

import pytest

from benchmarks import page
from benchmarks.page import Condition, Seen


def test_sensing_is_measured_under_viewers_of_whom_one_hangs() -> None:
    condition = Condition('two, and one that hangs', viewers=2, hanging=1)
    found = page.measure([condition], seconds=1.0, rounds=1, settle_s=0.5)
    result = page.summed_up(found[condition])
    assert result['frames'] > 0
    assert 0 < result['latency_ms']['p50'] <= result['latency_ms']['p99']
    assert result['shown_hz'] > 0
    assert set(result['cpu_percent']) == set(page.PROCESSES.values())
    assert condition.title in page.conditions_table({'conditions': {condition.title: result}})


def test_percentiles_are_over_all_frames_and_the_spread_is_over_rounds() -> None:
    rounds = [[1.0] * 10, [3.0] * 90]
    seen = Seen(rounds, cpu_percent={name: [10.0, 20.0] for name in page.PROCESSES.values()}, load=[0.5, 1.5])
    result = page.summed_up(seen)
    assert result['frames'] == 100
    assert result['latency_ms']['p50'] == pytest.approx(3.0)
    assert result['p50_of_rounds_ms'] == {'median': 2.0, 'low': 1.0, 'high': 3.0}
    assert result['cpu_percent']['camera'] == pytest.approx(15.0)


def test_each_round_begins_with_another_condition() -> None:
    conditions = [Condition(name) for name in 'abc']
    rounds = [''.join(each.title for each in page._turned(conditions, number)) for number in range(3)]
    assert rounds == ['abc', 'bca', 'cab']
