"""The failure bench in short, and the bounds that it found, guarded: what `fast` says is ok is right."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as draw

from tactile_nodes.benchmarks.report import surroundings
from tactile_nodes.benchmarks.stability import QUICK, follow, measure, read
from tactile_nodes.benchmarks.stability_cases import CASES, Case, named
from tactile_nodes.benchmarks.stability_page import page, picture_of
from tactile_nodes.benchmarks.stability_plots import draw as draw_plots
from tactile_nodes.benchmarks.stability_scores import OK
from tactile_nodes.benchmarks.stability_stream import DURING, HELD, Change, Plan, World
from tactile_nodes.learning.progress import Progress
from tactile_nodes.simulation import disturbances as disturb


@pytest.fixture(scope='module')
def world() -> World:
    return World()


@pytest.mark.parametrize('case', CASES, ids=lambda case: case.name)
def test_every_disturbance_grows_and_says_at_which_levels_it_shall_hold(case: Case) -> None:
    assert len(set(case.levels)) == len(case.levels)
    assert set(case.held_at) <= set(case.levels)
    assert isinstance(case.change(case.levels[0]), Change)


def test_short_form_tells_of_every_family_asked_for_on_page_and_plots(tmp_path: Path) -> None:
    cases = [named('lost pixels')[0], named('all black')[0]]
    result = surroundings('tactile bench stability --quick')
    result |= measure(cases, ['fast'], QUICK, Progress(), largest_only=True)
    text = page(result)
    assert '| lost pixels, 5 % ' in text
    assert 'dark image 100%' in text
    draw_plots(result, tmp_path)
    assert {each.name for each in tmp_path.iterdir()} == {picture_of('optics'), picture_of('numbers')}
    assert all(picture_of(family) in text for family in ('optics', 'numbers'))


def test_the_same_stream_is_read_alike_again(world: World) -> None:
    change = named('brightness')[0].change(0.9)
    assert follow(world, change, ['fast'], QUICK) == follow(world, change, ['fast'], QUICK)


USUAL = Plan(presses=2, before=1, coming=8, rest=1, after=1)


@pytest.fixture(scope='module')
def usual_n(world: World) -> float:
    """The largest error of `fast` under presses when nothing is wrong."""
    return max(
        abs(each.error_n) for each in read(world, Change(), ['fast'], Plan())['fast'] if each.moment.kind == HELD
    )


@settings(max_examples=12, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    shift_px=draw.floats(0, 6),
    light=draw.floats(0.3, 1.9),
    blur_px=draw.floats(0, 2),
    noise=draw.floats(1, 6),
    dirt_share=draw.floats(0, 0.2),
    seed=draw.integers(0, 10_000),
)
def test_whatever_comes_together_a_force_that_is_ok_is_right(
    world: World,
    usual_n: float,
    shift_px: float,
    light: float,
    blur_px: float,
    noise: float,
    dirt_share: float,
    seed: int,
) -> None:
    through = np.float32(light) * disturb.dirt((480, 640), dirt_share, seed)
    change = Change(
        gel=lambda gel: disturb.knocked(gel, shift_px),
        light=lambda radiance, _: disturb.blurred(radiance * through, blur_px),
        noise=noise,
    )
    answers = read(world, change, ['fast'], dataclasses.replace(USUAL, seed=seed))['fast']
    during = [each for each in answers if each.moment.part == DURING and each.status == OK]
    assert all(abs(each.error_n) <= 2 * usual_n + 3 * each.sigma_n for each in during if each.moment.kind == HELD)
    assert all(each.total_n <= 0.020 for each in during if each.moment.kind == 'rest')
    assert all(math.isfinite(each.total_n) for each in during)
