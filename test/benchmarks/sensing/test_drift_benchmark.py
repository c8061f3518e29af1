"""The drift benchmark in short: what must be seen is seen, and what cannot be seen is not claimed."""

from __future__ import annotations

from dataclasses import asdict

import pytest

from benchmarks.drift import Hours, cases, page, undisturbed
from benchmarks.drift.cases import BODIES, COURSES, Course, Effort, Point, follow
from benchmarks.harness.report import surroundings
from tactile_nodes.learning.progress import Progress
from tactile_nodes.model_file import LoadedModel, find_model, load_model
from tactile_nodes.simulation.gel import Gel

LITTLE = Effort(BODIES[:1], presses=4, contacts=5)


@pytest.fixture(scope='module')
def fast() -> LoadedModel:
    return load_model(find_model('fast'))


@pytest.fixture(autouse=True)
def _coarse_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """A press of a second still has three times the samples that a comparison needs."""
    monkeypatch.setattr(cases, 'CONTACT_HZ', 15)
    monkeypatch.setattr(cases, 'INDEPENDENT_HZ', 100)


def named(name: str, *extents: float) -> Course:
    (course,) = [each for each in COURSES if each.name == name]
    return Course(course.name, course.unit, extents, course.gel, course.again, course.apart, course.compared)


def test_a_camera_knocked_by_2_px_is_invalid_five_seconds_later(fast: LoadedModel) -> None:
    (point,) = follow(named('the camera is knocked', 2.0), fast, Gel(), LITTLE)
    assert point.level == 'invalid'
    assert 'picture moved' in point.reasons
    assert point.after_s == 5.0  # the first look after two seconds, then one every half second for three
    assert point.force_rmse_n > 0.3


def test_a_gel_that_stiffened_by_a_tenth_is_seen_beside_another_force_and_not_without(fast: LoadedModel) -> None:
    (beside,) = follow(named('the gel stiffens, an independent force beside it', 10.0), fast, Gel(), LITTLE)
    (alone,) = follow(named('the gel stiffens, nothing to compare with', 10.0), fast, Gel(), LITTLE)
    assert (beside.level, beside.reasons) == ('ageing', 'force ratio')
    assert (alone.level, alone.reasons) == ('valid', '')
    assert alone.force_rmse_n == pytest.approx(beside.force_rmse_n, rel=0.05)


def test_minutes_in_which_nothing_is_wrong_raise_no_alarm(fast: LoadedModel) -> None:
    hours = undisturbed(fast, 1 / 60, Progress(), LITTLE)
    assert (hours.pictures, hours.alarms) == (30, 0)


def test_page_tells_where_each_level_begins_and_the_error_there() -> None:
    points = [
        Point(0.1, 0.01, 0.02, 0.0, 'valid', '', None),
        Point(0.2, 0.05, 0.03, 0.5, 'ageing', 'picture moved', 3.5),
        Point(0.3, float('nan'), 0.04, 1.0, 'invalid', 'picture moved', 3.0),
    ]
    courses = {COURSES[0].name: list(map(asdict, points))}
    hours = asdict(Hours(1.0, 7200, 0, 0.0, 0.001, 0.1))
    text = page({**surroundings('tactile bench drift'), 'courses': courses, 'hours': hours})
    cells = [cell.strip() for cell in next(line for line in text.splitlines() if 'knocked' in line).split('|')[1:-1]]
    assert cells == ['the camera is knocked', '0.2 px', '0.0500', '0.3 px', '-', '3 to 3.5']
    assert '0 alarms' in text
