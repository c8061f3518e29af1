"""The irregular pattern of the digital line, and that it makes the edges of alike presses distinguishable."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rehearsing import Run, changed

from tactile_nodes.collection.plan.plan import PlanSettings
from tactile_nodes.collection.press.sync_pattern import pattern_gaps
from tactile_nodes.sensing.sync.clocks import ClockFit, Reason, Refusal, fit_clocks

NS_PER_S = 1_000_000_000


def test_gaps_lie_between_0_4_and_2_5_s_and_differ() -> None:
    gaps = pattern_gaps('a1b2c3d4e5f6', 1, 200)
    assert 0.4 <= min(gaps) < 0.45 and 2.45 < max(gaps) <= 2.5
    assert len(set(gaps)) > 180
    assert np.mean(gaps) == pytest.approx(1.45, abs=4 * 0.61 / 200**0.5)  # uniform: a deviation of 2.1 / sqrt(12)


def test_the_same_plan_and_number_give_the_same_gaps_and_others_give_others() -> None:
    known = pattern_gaps('a1b2c3d4e5f6', 1, 10)
    assert known == pattern_gaps('a1b2c3d4e5f6', 1, 10)
    assert known != pattern_gaps('a1b2c3d4e5f6', 2, 10)
    assert known != pattern_gaps('a1b2c3d4e5f7', 1, 10)


def test_the_line_is_switched_before_the_first_press_after_the_last_and_in_between(tmp_path: Path) -> None:
    """Four patterns of four edges around 8 presses, of which one after each third."""
    run = Run(tmp_path, changed(sync={'pulses': 2, 'every': 3}))
    run.campaign.run()
    edges = run.world.line_edges()
    assert len(edges) == 16 + 4 * 4
    start = np.diff([edge.stamp_ns for edge in edges[:4]]) / NS_PER_S
    # On a clock that jumps a gap is kept to the breath of 10 ms in which the hands look around.
    np.testing.assert_allclose(start, pattern_gaps(run.plan.plan_id, 0, 4)[1:], atol=0.02)
    assert not edges[3].level and not edges[-1].level
    assert all(record.start_ns > edges[3].stamp_ns for record in run.published)


def test_run_that_is_resumed_after_its_second_pattern_goes_on_with_a_third(tmp_path: Path) -> None:
    """Patterns come before the first press and after the sixth; then the run is cut off before anything is pressed."""
    settings, plan = changed(sync={'pulses': 3, 'every': 6}), PlanSettings(columns=7, rows=1, depths_mm=(0.5,))

    def cut_off() -> None:
        raise KeyboardInterrupt

    first = Run(tmp_path, settings, plan)
    first.at(7, cut_off)
    with pytest.raises(KeyboardInterrupt):
        first.campaign.run()
    first.journal.close()
    again = Run(tmp_path, settings, plan)
    again.campaign.run()
    edges = again.world.line_edges()[:6]
    gaps_s = np.diff([edge.stamp_ns for edge in edges]) / NS_PER_S
    np.testing.assert_allclose(gaps_s, pattern_gaps(again.plan.plan_id, 2, 6)[1:], atol=0.02)


def test_without_pulses_presses_alone_switch_it(tmp_path: Path) -> None:
    run = Run(tmp_path, changed(sync={'pulses': 0}))
    run.campaign.run()
    assert len(run.world.line_edges()) == 16


def alike_presses(presses: int, with_pattern: bool) -> np.ndarray:
    """Edges in ns: patterns around presses that take 6 s and are high for 0.2 s each."""
    start = np.cumsum(pattern_gaps('a1b2c3d4e5f6', 0, 10)) if with_pattern else np.zeros(0)
    rises = (start[-1] if with_pattern else 0.0) + 6.0 * np.arange(1, presses + 1)
    during = np.sort(np.concatenate([rises, rises + 0.2]))
    end = during[-1] + np.cumsum(pattern_gaps('a1b2c3d4e5f6', 7, 10)) if with_pattern else np.zeros(0)
    return np.round(np.concatenate([start, during, end]) * NS_PER_S).astype(np.int64)


@pytest.mark.parametrize('presses', [9, 100, 400])
def test_patterns_around_alike_presses_say_which_edge_is_which(presses: int) -> None:
    host = alike_presses(presses, with_pattern=True)
    device = np.round((host - 300_000_000) / 1.0001).astype(np.int64)
    fit = fit_clocks(device, host)
    assert isinstance(fit, ClockFit), fit
    assert np.abs(fit.host_ns(device) - host).max() < 1e5


@pytest.mark.parametrize('presses', [9, 100])
def test_alike_presses_alone_are_ambiguous(presses: int) -> None:
    host = alike_presses(presses, with_pattern=False)
    refusal = fit_clocks(host - 300_000_000, host)
    assert isinstance(refusal, Refusal)
    assert refusal.reason == Reason.AMBIGUOUS
