"""The stability benchmark in short: its page, its floor, and whatever comes together."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as draw

from benchmarks import disturbances as disturb
from benchmarks.harness.report import surroundings
from benchmarks.stability import Stream, follow, measure, read
from benchmarks.stability.cases import CASES, named
from benchmarks.stability.floor import bound, floor_n, least_ratio
from benchmarks.stability.page import page, picture_of
from benchmarks.stability.plots import draw as draw_plots
from benchmarks.stability.scores import OK
from benchmarks.stability.stream import DURING, HELD, REST, Change, Plan, World

ONE = Plan(presses=1, before=1, coming=4, hold=3, rest=1, after=1)


@pytest.fixture(scope='module')
def world() -> World:
    return World()


def test_every_disturbance_grows_and_says_at_which_levels_it_shall_hold() -> None:
    for case in CASES:
        assert len(set(case.levels)) == len(case.levels), case.name
        assert set(case.held_at) <= set(case.levels), case.name
        assert isinstance(case.at(case.levels[0]), Change), case.name


def in_turn(make: Callable[[Stream], Any], jobs: Mapping[str, Stream], _: str) -> dict[str, Any]:
    return {name: make(job) for name, job in jobs.items()}


@pytest.fixture(scope='module')
def short() -> dict[str, Any]:
    """The bench of three disturbances, of one press each."""
    cases = [named('lost pixels')[0], named('all black')[0], dataclasses.replace(named('noise')[0], levels=(4,))]
    result = surroundings('tactile bench stability --quick')
    return result | measure(cases, ['fast'], ONE, in_turn, largest_only=True)


def test_short_form_tells_of_every_family_asked_for_on_page_and_plots(short: dict[str, Any], tmp_path: Path) -> None:
    text = page(short)
    assert '| lost pixels, 5 % ' in text
    assert 'dark image 100%' in text
    draw_plots(short, tmp_path, 'stability')
    pictures = {picture_of(family) for family in ('optics', 'numbers')}
    assert {each.name for each in tmp_path.iterdir()} == pictures
    assert all(picture in text for picture in pictures)


def test_the_page_sets_what_one_picture_tells_beside_what_was_read(short: dict[str, Any]) -> None:
    text = page(short)
    row = next(line for line in text.splitlines() if line.startswith('| noise, 4 x') and 'least' in line)
    assert row.count('|') == 4
    assert 'fast, mN: first frame; hold' in text


def test_the_same_stream_is_read_alike_again(world: World) -> None:
    change = named('brightness')[0].at(0.9)
    assert follow(world, change, ['fast'], ONE) == follow(world, change, ['fast'], ONE)


def test_the_floor_is_that_of_independent_pixels_and_rises_with_an_unknown_that_looks_alike() -> None:
    """Two pixels of variance 4 that a force moves by 3 and 4: 4 / 25. A place that moves the second alone leaves it the
    first: 4 / 9."""
    noise = np.array([4.0, 4.0])
    assert bound(np.array([[3.0], [4.0]]), noise) == pytest.approx(4 / 25)
    assert bound(np.array([[0.0, 3.0], [5.0, 4.0]]), noise) == pytest.approx(4 / 9)


def test_four_times_the_noise_is_nearly_four_times_the_floor_and_less_for_a_method_with_other_errors(
    world: World,
) -> None:
    """Nearly, as rounding stays as it is. Other errors of √3 floors make 2 of it, and √(3 + 16) / 2 with the noise."""
    plan = Plan(presses=2)
    usual, noisy = (floor_n(world, change, plan) for change in (Change(), named('noise')[0].at(4)))
    assert 3.9 < noisy / usual < 4
    assert least_ratio(2.0, 1.0, 4.0) == pytest.approx(math.sqrt(19) / 2)


@settings(max_examples=3, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    shift_px=draw.just(0.0) | draw.floats(0, 6),
    light=draw.just(1.0) | draw.floats(0.3, 1.9),
    blur_px=draw.just(0.0) | draw.floats(0, 2),
    noise=draw.just(1.0) | draw.floats(1, 6),
    dirt_share=draw.just(0.0) | draw.floats(0, 0.2),
    seed=draw.integers(0, 10_000),
)
def test_whatever_comes_together_a_force_that_is_ok_is_right(
    world: World, shift_px: float, light: float, blur_px: float, noise: float, dirt_share: float, seed: int
) -> None:
    through = np.float32(light) * disturb.dirt((480, 640), dirt_share, seed)
    change = Change(
        gel=lambda gel: disturb.knocked(gel, shift_px),
        light=lambda radiance, _: disturb.blurred(radiance * through, blur_px),
        noise=noise,
    )
    answers = read(world, change, ['fast'], dataclasses.replace(ONE, seed=seed))['fast']
    during = [each for each in answers if each.moment.part == DURING and each.status == OK]
    assert all(abs(each.error_n) <= 0.010 + 3 * each.sigma_n for each in during if each.moment.kind == HELD)
    assert all(each.total_n <= 0.020 for each in during if each.moment.kind == REST)
    assert all(math.isfinite(each.total_n) for each in during)
