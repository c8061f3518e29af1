"""A tip that drags the skin is told from one that presses straight down, and its force is found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from dragging import DRAG, GEL, pulled
from responding import COMPONENTS, GRID, components, features, readout, response

from tactile_nodes.sensing.contact_drag import amounts, amounts_slopes, dragged, gained_by_drag
from tactile_nodes.sensing.reading import BEYOND_UNLIKENESS
from tactile_nodes.sensing.response import locate

SURE = np.ones((GRID, GRID), np.float32)
READER = replace(readout(), drag=DRAG)


def noise(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=COMPONENTS).astype(np.float32)


@pytest.mark.parametrize('pull_mm', [(0.1, 0.0), (-0.2, 0.3), (0.5, 0.5)])
def test_place_force_and_drag_of_a_contact_that_drags_are_found(pull_mm: tuple[float, float]) -> None:
    seen = pulled(2.0, -1.0, 0.6, pull_mm)
    alone = locate(GEL, seen, GEL.start(seen)[None])
    found = dragged(GEL, DRAG, seen, alone)
    assert found is not None
    assert found.pull_mm == pytest.approx(pull_mm, abs=1e-3)
    assert found.fit.contacts[0] == pytest.approx([2.0, -1.0, 0.6], abs=3e-3)
    assert abs(alone.contacts[0] - [2.0, -1.0, 0.6]).max() > 10 * abs(found.fit.contacts[0] - [2.0, -1.0, 0.6]).max()


def test_slopes_of_the_amounts_are_those_of_small_steps() -> None:
    at, step = np.array([0.3, -0.2]), 1e-6
    steps = [(amounts(at + each) - amounts(at - each)) / (2 * step) for each in step * np.eye(2)]
    np.testing.assert_allclose(amounts_slopes(at), steps, atol=1e-8)


def test_a_press_straight_down_gains_by_a_drag_what_noise_does() -> None:
    """Twice the gain is chi-square of two numbers: 2 on average, within four standard errors of 2 / sqrt(300).

    (Where motion is so large beside noise that noise makes no width, by which a gain counts less.)
    """
    gel, gains = response(scale=8000.0), []
    for seed in range(300):
        seen = components(gel, (2.0, -1.0, 0.6)) + noise(seed)
        gains.append(2 * gained_by_drag(gel, DRAG, seen, locate(gel, seen, gel.start(seen)[None])))
    assert np.mean(gains) == pytest.approx(2.0, abs=4 * 2 / 300**0.5)


def test_a_press_straight_down_is_read_to_the_bit_as_without_a_drag() -> None:
    seen = features(READER, components(GEL, (2.0, -1.0, 0.6)) + noise(1))
    told, plain = READER.read(seen, SURE), READER.straight.read(seen, SURE)
    assert told.contacts == plain.contacts
    assert (told.total_sigma_n, told.unlikeness) == (plain.total_sigma_n, plain.unlikeness)


def test_a_drag_is_told_and_where_the_tip_went_and_its_force_are_right_where_they_would_be_wrong() -> None:
    seen = features(READER, pulled(2.0, -1.0, 0.6, (0.3, -0.1)) + noise(2))
    told, plain = READER.read(seen, SURE), READER.straight.read(seen, SURE)
    contacts = told.contacts[0], plain.contacts[0]
    off = [np.array([each.x_mm - 2.3, each.y_mm + 1.1, each.force_n - 0.6]) for each in contacts]
    assert np.abs(off[0]) == pytest.approx([0, 0, 0], abs=0.1)
    assert np.abs(off[1]).max() > 0.5
    assert abs(off[0][2]) < 0.5 * abs(off[1][2])
    assert told.unlikeness >= 1


def test_a_drag_beyond_the_training_is_beyond_it() -> None:
    seen = features(READER, pulled(2.0, -1.0, 0.6, (0.5, 0.0)))
    far = replace(READER, drag=replace(DRAG, most_mm=0.4))
    assert READER.read(seen, SURE).unlikeness < BEYOND_UNLIKENESS
    assert far.read(seen, SURE).unlikeness >= BEYOND_UNLIKENESS


def test_a_force_is_the_less_sure_the_longer_the_drag() -> None:
    """doubt_n is 0.01 N per mm here, beside what is stated without."""
    seen = features(READER, pulled(2.0, -1.0, 0.6, (0.4, 0.3)))
    told = READER.read(seen, SURE)
    assert told.total_sigma_n == pytest.approx(np.hypot(told.contacts[0].sigma_n, 0.5 * 0.01), rel=0.01)


def test_two_contacts_are_no_drag() -> None:
    told = READER.read(features(READER, components(GEL, (-5.0, 2.0, 0.5), (5.0, -2.0, 0.6)) + noise(3)), SURE)
    assert [each.force_n for each in told.contacts] == pytest.approx([0.6, 0.5], abs=0.02)


def test_a_drag_is_no_second_contact() -> None:
    seen = pulled(2.0, -1.0, 0.6, (0.6, 0.3)) + noise(4)
    assert len(READER.read(features(READER, seen), SURE).contacts) == 1
    assert READER.single(seen).misfit > READER.calibration.misfit_limit**2  # so a second one would have been looked for


def test_a_wider_contact_is_no_drag() -> None:
    places = [(2.0 + 0.7 * dx, -1.0 + 0.7 * dy, 0.15) for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1))]
    seen = components(GEL, *places)
    assert dragged(GEL, DRAG, seen, locate(GEL, seen, GEL.start(seen)[None])) is None
