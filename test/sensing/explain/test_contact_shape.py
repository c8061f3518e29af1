"""Contacts that are wider than those of the training, or drag the skin, are distinguished from the training's own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from responding import COMPONENTS, GRID, components, features, readout, response

from tactile_nodes.sensing.explain.measured.contact_shape import USUAL_MM2, Residual, Shape, shape_of, with_usual_width
from tactile_nodes.sensing.explain.measured.response import Fit, Response, locate
from tactile_nodes.sensing.explain.reading import BEYOND_UNLIKENESS
from tactile_nodes.sensing.explain.uncertainty import Calibration

GEL = response()
READER = replace(readout(), calibration=Calibration(misfit_limit=2.5))
"""Noise of 1 leaves a misfit of 1, which is what the median press of a training leaves: 0.16 times 2.5²."""
SURE = np.ones((GRID, GRID), np.float32)
SHIFTS = READER.shifts
MOST_GAIN = 12.0
"""Two numbers gain so much by noise once in 160 000 times: exp(-12)."""
WATCHFUL = replace(READER, most_shift_gain=MOST_GAIN)


def found_in(gel: Response, seen: np.ndarray) -> tuple[Fit, Shape]:
    fit = locate(gel, seen, gel.start(seen)[None])
    return fit, shape_of(gel, SHIFTS, seen, fit)


def pressed(apart_mm: float, s: float = 0.6) -> np.ndarray:
    """Four contacts of a quarter each, this far from the middle of them: this gel answers in proportion to s."""
    x, y, quarter = 2.0, -1.0, s / 4
    places = [(x + apart_mm, y), (x - apart_mm, y), (x, y + apart_mm), (x, y - apart_mm)]
    return components(GEL, *[(*place, quarter) for place in places])


@pytest.mark.parametrize('apart_mm', [0.4, 0.8, 1.2])
def test_a_wider_contact_adds_half_the_mean_square_of_its_places_along_an_axis(apart_mm: float) -> None:
    """Two of four places are apart_mm away along an axis: (1/2) (1/2) apart_mm²."""
    _, shape = found_in(GEL, pressed(apart_mm))
    assert shape.mm2[0] == pytest.approx(apart_mm**2 / 4, rel=0.1)


def test_noise_adds_no_width_beyond_its_standard_deviation() -> None:
    random, found = np.random.default_rng(3), []
    for _ in range(200):
        seen = components(GEL, (2.0, -1.0, 0.6)) + random.normal(size=COMPONENTS).astype(np.float32)
        _, shape = found_in(GEL, seen)
        found.append((shape.mm2[0], shape.sigma_mm2[0]))
    mm2, sigma_mm2 = np.array(found).T
    # 1 within sqrt(1 / 400), and four times that is an even chance of one in 16 000
    assert np.sqrt(np.mean((mm2 / sigma_mm2) ** 2)) == pytest.approx(1.0, abs=4 * 0.05)


def test_what_is_wide_but_may_be_noise_is_not_called_wide() -> None:
    """From 3.1 standard deviations on, which noise exceeds once in a thousand times."""
    mm2, sigma_mm2 = np.array([[0.2, 0.063], [0.2, 0.066], [0.05, 0.001], [-0.5, 0.01]]).T
    shape = Shape(mm2, sigma_mm2, np.zeros((4, 3)), np.zeros((4, 3)), 0.0)
    assert shape.wide(Residual(1.0, 1.0, 40)).tolist() == [True, False, False, False]
    # The width of 3.17 standard deviations explains 10.1 / 40 of it; what is left is 1.1 times as much as usual.
    assert not shape.wide(Residual(1.352, 1.0, 40)).any()


def test_contacts_of_a_usual_width_are_read_better_with_it_than_without() -> None:
    """Places of a pair lie so far apart that the width is one standard deviation of the usual ones, or minus that.

    Noise lets width be known to a tenth of that here, so what a contact is off by for it is nearly all taken out.
    """
    gel, found, random = response(scale=20_000.0), [], np.random.default_rng(7)
    for x, y in random.uniform(-6, 6, (40, 2)).tolist():
        apart_mm = (4 * USUAL_MM2) ** 0.5
        places = [(x + apart_mm, y), (x - apart_mm, y), (x, y + apart_mm), (x, y - apart_mm)]
        seen = components(gel, *[(*place, 0.15) for place in places])
        seen += random.normal(size=COMPONENTS).astype(np.float32)
        fit, shape = found_in(gel, seen)
        corrected = with_usual_width(gel, fit, shape)
        found.append((fit.contacts[0, 2] - 0.6, corrected.contacts[0, 2] - 0.6))
    without, with_it = np.sqrt(np.square(found).mean(axis=0))
    assert with_it < 0.5 * without


def test_a_contact_of_no_width_stays_what_it_is() -> None:
    seen = components(GEL, (2.0, -1.0, 0.6))
    fit, shape = found_in(GEL, seen)
    assert with_usual_width(GEL, fit, shape).contacts[0] == pytest.approx([2.0, -1.0, 0.6], abs=2e-3)


def test_a_contact_where_the_splines_end_stays_there() -> None:
    seen = components(GEL, (12.0, 0.0, 0.5), (11.0, 1.0, 0.2))
    fit = replace(locate(GEL, seen, GEL.start(seen)[None]), contacts=np.array([[12.0, 0.1, 0.6]]))
    shape = shape_of(GEL, SHIFTS, seen, fit)
    assert np.abs(shape.steps).max() > 1e-3
    assert with_usual_width(GEL, fit, shape).contacts.tolist() == [[12.0, 0.1, 0.6]]


def test_the_force_of_a_wide_contact_is_in_doubt_by_13_percent_for_each_mm2() -> None:
    """Four places 1 mm from their middle: a quarter of a mm² wider."""
    usual, broad = (READER.read(features(READER, pressed(apart)), SURE) for apart in (0.0, 1.0))
    assert broad.total_sigma_n**2 - usual.total_sigma_n**2 == pytest.approx((0.13 / 4 * 0.6) ** 2, rel=0.1)
    assert broad.unlikeness < 0.5


def dragged(pull_mm: tuple[float, float], seed: int = 2) -> np.ndarray:
    """Features of a press under which regions go with the tip as well, the more the nearer: 40 for each mm below it."""
    along = np.linspace(-11.0, 11.0, GRID)
    away = np.stack(np.meshgrid(along, along), axis=-1) - (2.0, -1.0)
    near = np.exp(-(away**2).sum(axis=-1, keepdims=True) / (2 * 5.0**2))
    noise = np.random.default_rng(seed).normal(size=COMPONENTS).astype(np.float32)
    straight = features(READER, components(GEL, (2.0, -1.0, 0.6)) + noise)
    return np.asarray(straight + 40.0 * near * np.array(pull_mm), np.float32)


@pytest.mark.parametrize('pull_mm', [(-0.1, 0.15), (0.0, 0.2)])
def test_a_tip_that_drags_puts_place_and_force_in_doubt(pull_mm: tuple[float, float]) -> None:
    """It may be taken for another place and force, and the fit leaves no more over than that of other presses."""
    (blind,), (watchful,) = (each.read(dragged(pull_mm), SURE).contacts for each in (READER, WATCHFUL))
    off_mm = float(np.hypot(watchful.x_mm - 2.0, watchful.y_mm + 1.0))
    assert READER.read(dragged(pull_mm), SURE).unlikeness < 1
    assert (watchful.x_mm, watchful.y_mm, watchful.force_n) == (blind.x_mm, blind.y_mm, blind.force_n)
    assert 2 * blind.sigma_mm < off_mm < 2 * watchful.sigma_mm
    assert watchful.sigma_n > 10 * blind.sigma_n


def test_a_tip_that_drags_hard_is_unlike_the_training() -> None:
    assert WATCHFUL.read(dragged((2.0, 0.0)), SURE).unlikeness >= BEYOND_UNLIKENESS


def test_what_gains_no_more_by_a_shift_than_presses_do_is_read_to_the_bit_as_unasked() -> None:
    seen = dragged((0.0, 0.0))
    watchful, plain = WATCHFUL.read(seen, SURE), READER.read(seen, SURE)
    assert watchful.contacts == plain.contacts
    assert (watchful.total_sigma_n, watchful.unlikeness) == (plain.total_sigma_n, plain.unlikeness)


def test_a_press_straight_down_gains_by_a_shift_what_noise_does() -> None:
    """Twice the gain is chi-square of two numbers: 2 on average, within four standard errors of 2 / sqrt(300).

    (Motion is large beside noise, so that what the fit leaves over follows from its slopes.)
    """
    gel, gains, random = response(scale=8000.0), [], np.random.default_rng(9)
    for _ in range(300):
        seen = components(gel, (2.0, -1.0, 0.6)) + random.normal(size=COMPONENTS).astype(np.float32)
        gains.append(2 * found_in(gel, seen)[1].shift_gain)
    assert np.mean(gains) == pytest.approx(2.0, abs=4 * 2 / 300**0.5)


def test_a_shift_of_all_regions_is_what_is_asked_for() -> None:
    """By half of the squares that it makes, less what place and force explain of them."""
    seen, unit = components(GEL, (2.0, -1.0, 0.6)), float(np.linalg.norm(SHIFTS[0]))
    gains = [
        found_in(GEL, seen + np.asarray(by / unit * SHIFTS[0], np.float32))[1].shift_gain for by in (0.0, 4.0, 8.0)
    ]
    assert gains[0] == pytest.approx(0.0, abs=0.01)
    assert 0.3 * 4.0**2 / 2 < gains[1] < 4.0**2 / 2
    assert gains[2] == pytest.approx(4 * gains[1], rel=0.1)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.1, 300.0))
def test_whatever_is_seen_a_contact_stays_within_the_splines_and_is_reported_with_a_usual_width(
    seed: int, size: float
) -> None:
    seen = np.random.default_rng(seed).normal(scale=size, size=COMPONENTS).astype(np.float32)
    fit = READER.fit(seen)
    corrected = READER.with_usual_width(seen, fit).contacts
    _, _, low, high = GEL.limits_array
    assert np.isfinite(corrected).all()
    assert ((corrected >= low) & (corrected <= high)).all()
    found = READER.reading(READER.observed(features(READER, seen), SURE))
    if found.contacts[0].force_n > 0:
        assert found.contacts[0].force_n == pytest.approx(corrected[:, 2].max(), rel=1e-3, abs=1e-4)
