"""How long a plan takes: parts by hand, the whole against a run in simulated time."""

from __future__ import annotations

import dataclasses
from itertools import pairwise
from pathlib import Path

import pytest
from rehearsing import GEL_Z_MM, PLAN, SAFE_Z_MM, SETTINGS, WORLD, Dots, Run, changed

from tactile_nodes.collection.plan.order import ordered
from tactile_nodes.collection.plan.plan import PlanSettings, Point, make_plan
from tactile_nodes.collection.press.sync_pattern import pattern_gaps
from tactile_nodes.collection.run.estimate import Course, Estimate, estimate, leg_s, looks_s, patterns_s, pressed_points
from tactile_nodes.collection.settings import AnchorSettings, CollectionSettings
from tactile_nodes.drivers.cnc.contract import CncSettings

NS_PER_S = 1e9
HIGH_MM, LOW_MM = -26.0, -30.0
PLAIN = CollectionSettings()
POINTS = [Point(number, float(number), 0.0, 1.0) for number in range(1, 7)]


def estimated(settings: CollectionSettings, plan: PlanSettings, fps: float = 20.0) -> Estimate:
    drawn = make_plan(plan)
    cnc = CncSettings(safe_z_mm=SAFE_Z_MM)
    return estimate(drawn.plan_id, ordered(drawn, plan), settings, cnc, GEL_Z_MM, fps)


def test_leg_takes_the_time_of_a_trapezoid() -> None:
    assert leg_s(10.0, 600.0) == pytest.approx(1.05)  # 10 mm at 10 mm/s, and 10 mm/s at 200 mm/s²
    assert leg_s(0.5, 1200.0) == pytest.approx(0.1)  # too short for 20 mm/s: up to 10 mm/s and down again


def test_looks_go_on_until_one_is_late_enough() -> None:
    assert looks_s(0.2, 0.02) == pytest.approx(0.2)
    assert looks_s(0.21, 0.02) == pytest.approx(0.22)


def test_press_takes_the_sum_of_its_jogs_and_waits() -> None:
    """From 4 mm above the gel to 1 mm deep, 10 mm beside the last one.

    Sideways 2 jogs of 5 mm at 20 mm/s: 2 (0.25 + 0.1) s. Down 3.5 mm at 5 mm/s, 3 jogs: 0.7 + 3 0.025 s. Into the gel
    1.5 mm at 1 mm/s, 6 jogs: 1.5 + 6 0.005 s. Up 5 mm at 20 mm/s: 0.25 + 0.1 s. Tare 0.5, steady 0.2, window of 0.1 s
    in looks of 0.02 s: 0.12, tip free 0.1 s.
    """
    course = Course(PLAIN, HIGH_MM, LOW_MM, 60.0)
    motion_s = 0.7 + 0.775 + 1.53 + 0.35
    took_s = course.press_s(Point(1, -10.0, 0.0, 1.0), Point(2, 0.0, 0.0, 1.0))
    assert took_s == pytest.approx(motion_s + 0.5 + 0.2 + 0.12 + 0.1)


def test_anchor_is_pressed_four_times_before_the_first_press_after_every_few_and_at_the_end() -> None:
    settings = dataclasses.replace(PLAIN, anchor=AnchorSettings(every=2))
    corner, *tips = (point.press for point in pressed_points(POINTS, settings))
    assert (corner, tips) == (0, [0, 0, 0, 0, 1, 2, 0, 3, 4, 0, 5, 6, 0])
    settings = dataclasses.replace(PLAIN, anchor=AnchorSettings(every=0))
    assert [point.press for point in pressed_points(POINTS, settings)] == [0, 1, 2, 3, 4, 5, 6]


def test_patterns_at_start_and_end_and_after_every_few_presses_are_counted_as_they_are() -> None:
    """Six presses, a pattern after every fourth: after none, four and six presses, as numbers 0, 1 and 2."""
    expected = sum(sum(pattern_gaps('a1b2c3d4e5f6', number, 4)) for number in (0, 1, 2))
    settings = changed(sync={'pulses': 2, 'every': 4})
    assert patterns_s('a1b2c3d4e5f6', POINTS, settings) == pytest.approx(expected)
    assert patterns_s('a1b2c3d4e5f6', POINTS, changed(sync={'pulses': 0})) == 0


def test_rest_images_are_taken_twice_at_the_start_and_after_every_few_presses() -> None:
    """0.2 s of rest and 16 images in looks of 0.05 s: 0.5 s at 60 a second; 12 presses, one after each fifth: 2 + 2."""
    course = Course(dataclasses.replace(PLAIN, reference_every=5), HIGH_MM, LOW_MM, 60.0)
    assert course.rests_s(12) == pytest.approx(4 * 0.5)


@pytest.mark.parametrize(
    'blocks',
    [
        {'sync': {'pulses': 2, 'every': 5}},
        {'anchor': {'every': 5}, 'surface': {'corners': 4, 'repeats': 3, 'top_mm': -9.5}},
    ],
)
def test_run_of_eight_presses_takes_as_long_as_estimated(tmp_path: Path, blocks: dict[str, dict[str, object]]) -> None:
    settings = dataclasses.replace(changed(**blocks), reference_every=4)
    far = dataclasses.replace(WORLD, start_mm=(-50.0, -70.0, -8.0))  # from where homing takes its usual 5 s
    run = Run(tmp_path, settings, world=far, dots=Dots(), rate_hz=100.0)
    begin_ns = run.rig.clock.now_ns()
    run.campaign.run()
    took_s = (run.rig.clock.now_ns() - begin_ns) / NS_PER_S
    assert estimated(settings, PLAN).seconds == pytest.approx(took_s, rel=0.02)


def test_mean_press_is_one_of_the_plan_without_anchors() -> None:
    whole_run, order = estimated(SETTINGS, PLAN), ordered(make_plan(PLAN), PLAN)
    course = Course(SETTINGS, SAFE_Z_MM, GEL_Z_MM, 20.0)
    times = [course.press_s(before, point) for before, point in pairwise((order[0], *order))]
    assert whole_run.each_s == pytest.approx(sum(times) / 8)
