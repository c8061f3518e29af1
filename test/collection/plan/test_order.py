"""The order of a plan."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from tactile_nodes.collection.plan.order import ordered
from tactile_nodes.collection.plan.plan import PlanSettings, load_plan_settings, make_plan, numbered, plan_path

PAPER = PlanSettings()


def test_a_plan_comes_always_in_the_same_order() -> None:
    small = PlanSettings(columns=5, rows=5)
    assert ordered(make_plan(small), small) == ordered(make_plan(small), small)


def test_every_press_of_the_papers_plan_comes_once_nearly_all_neighbours_rest_and_the_way_is_short() -> None:
    """Nearly all neighbours rest for eight presses."""
    plan = make_plan(PAPER)
    order = ordered(plan, PAPER)
    assert sorted(order) == list(plan.points)
    hurried = sum(
        any((a.x_mm - b.x_mm) ** 2 + (a.y_mm - b.y_mm) ** 2 < 4.0**2 for b in order[max(0, i - 8) : i])
        for i, a in enumerate(order)
    )
    assert hurried < 0.01 * len(order)
    travel_mm = sum(math.dist(a[1:3], b[1:3]) for a, b in pairwise(order))
    assert travel_mm / len(order) < 1.25 * 4.0  # nearer than 4 mm would be no rest


def test_without_rest_a_row_is_walked_from_end_to_end() -> None:
    row = numbered([(float(x), 0.0, 1.0) for x in (3, 0, 2, 4, 1)])
    order = ordered(row, PlanSettings(rest_mm=0.0))
    assert [point.x_mm for point in order] == [0.0, 1.0, 2.0, 3.0, 4.0]


def test_a_spread_plan_without_rest_comes_in_its_own_order() -> None:
    spread = PlanSettings(kind='spread', count=40, rest_mm=0.0)
    assert ordered(make_plan(spread), spread) == make_plan(spread).points


@pytest.mark.parametrize('side', [3, 5, 7, 10])
def test_the_first_presses_of_a_calibration_already_span_the_gel(side: int) -> None:
    """No place lies farther from them than twice the half diagonal of as many squares that cover the gel.

    That is the bound of the furthest-first traversal (Gonzalez 1985). A walk to the nearest place exceeds it.
    """
    settings = load_plan_settings(plan_path('calibrate'))
    pressed = np.array([point[1:3] for point in ordered(make_plan(settings), settings)[: side**2]])
    line = np.linspace(-settings.reach_mm, settings.reach_mm, 41)
    gel = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    nearest_mm = np.linalg.norm(gel[:, None] - pressed, axis=2).min(axis=1)
    assert nearest_mm.max() <= 2 * settings.reach_mm / side * np.sqrt(2)
