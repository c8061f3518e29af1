"""The bench of endurance: its short form answers every frame and keeps nothing, and its judgement is right."""

from __future__ import annotations

import sys
from typing import Any

import pytest

from benchmarks import endurance
from benchmarks.endurance.stepped import stepped
from benchmarks.endurance.trend import Look, growth, slope_per_hour
from tactile_nodes.learning.progress import Progress

PERIOD_S, FPS = 2, 30


@pytest.fixture(scope='module')
def seconds() -> dict[str, Any]:
    """Two periods of the clock, at half the rate of the bench."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys.modules[stepped.__module__], 'FPS', FPS)
        return stepped(2 * PERIOD_S / 3600, Progress(), PERIOD_S, rest_frames=16)


def test_every_frame_is_answered_and_nothing_waits_or_is_lost(seconds: dict[str, Any]) -> None:
    assert seconds['images'] == seconds['forces'] == 2 * PERIOD_S * FPS
    assert seconds['subscriptions']['dropped'] == seconds['subscriptions']['malformed'] == 0
    assert seconds['longest_work'] == seconds['longest_queue'] == 0
    assert seconds['problems'] == []


def test_the_second_press_is_answered_like_the_first(seconds: dict[str, Any]) -> None:
    assert seconds['drift_n'] == 0.0


def looks(slope_mb_per_hour: float, files: int = 7) -> list[Look]:
    """Ten looks in an hour; the first of them before all is loaded."""
    return [
        Look(360.0 * at, 20.0 if at == 0 else 100.0 + slope_mb_per_hour * at / 10, files + at // 9, 3, 0.0)
        for at in range(10)
    ]


def test_growth_is_the_slope_after_the_first_fifth() -> None:
    assert growth(looks(6.0))['mb_per_hour'] == pytest.approx(6.0)


def test_slope_of_a_known_line() -> None:
    assert slope_per_hour([0.0, 900.0, 1800.0], [100.0, 100.5, 101.0]) == pytest.approx(2.0)


def part(**other: Any) -> dict[str, Any]:
    return {'images': 5, 'forces': 5, 'drift_n': 0.0, 'problems': [], **growth(looks(0.0)), **other}


def test_a_file_left_open_is_a_complaint() -> None:
    assert endurance.complaints('stepped', part()) == ['the nodes: 8 files at the end, after 7']


@pytest.mark.parametrize(
    ('change', 'complaint'),
    [
        ({'forces': 4}, '1 of 5 images'),
        ({'drift_n': 0.5}, 'changed by 0.5 N'),
        ({'problems': ['camera: gone']}, 'camera: gone'),
        ({**growth(looks(10.0))}, '10.0 MiB more each hour'),
    ],
)
def test_what_is_wrong_is_reported(change: dict[str, Any], complaint: str) -> None:
    assert any(complaint in text for text in endurance.complaints('stepped', part(**change)))


def test_a_step_is_no_steady_growth_and_a_slope_is() -> None:
    hour = [Look(36.0 * at, 100.0 + 4.0 * (at > 50), 7, 3, 0.0) for at in range(100)]
    assert growth(hour)['steady_mb_per_hour'] == pytest.approx(0.0)
    leaking = [Look(36.0 * at, 100.0 + 0.05 * at, 7, 3, 0.0) for at in range(100)]
    assert growth(leaking)['steady_mb_per_hour'] == pytest.approx(5.0)  # 0.05 MiB in 36 s
