"""A response is inverted: contacts of a known synthetic gel come back, with the errors that noise should cause."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from responding import BINS, COMPONENTS, GRID, components, features, readout, response

from tactile_nodes.errors import ModelError
from tactile_nodes.sensing.explain.measured import response as response_module
from tactile_nodes.sensing.explain.measured.readout import project
from tactile_nodes.sensing.explain.measured.response import gained, locate
from tactile_nodes.sensing.explain.model import FeatureLayout, ForceEstimator, ForceModel
from tactile_nodes.sensing.explain.reading import BEYOND_UNLIKENESS
from tactile_nodes.sensing.explain.uncertainty import Calibration, factor_at
from tactile_nodes.sensing.features import Features
from tactile_nodes.sensing.geometry import BinGrid

GEL = response()
READER = readout()
SURE = np.ones((GRID, GRID), np.float32)
places = st.tuples(st.floats(-11, 11), st.floats(-11, 11), st.floats(0.05, 0.98))


@settings(deadline=None, max_examples=25)
@given(places)
def test_a_contact_comes_back_to_a_thousandth(place: tuple[float, float, float]) -> None:
    seen = components(GEL, place)
    fit = locate(GEL, seen, GEL.start(seen)[None])
    np.testing.assert_allclose(fit.contacts[0], place, atol=1e-3)
    assert fit.misfit < 1e-3


@settings(deadline=None, max_examples=25)
@given(places, st.integers(0, 99))
def test_what_ends_the_search_for_nothing_does_not_touch_contacts(place: tuple[float, float, float], seed: int) -> None:
    seen = components(GEL, place) + np.random.default_rng(seed).normal(size=COMPONENTS).astype(np.float32)
    plain = locate(GEL, seen, GEL.start(seen)[None])
    assume(gained(GEL, seen, plain) >= 30.0)
    found = locate(GEL, seen, GEL.start(seen)[None], least_gain=12.0)
    np.testing.assert_array_equal(found.contacts, plain.contacts)
    assert found.misfit == plain.misfit


@pytest.mark.parametrize(
    ('place', 'known'), [((0.0, 3.0, 0.9), True), ((0.0, 3.0, 1.05), False), ((9.9, 0.0, 0.5), True)]
)
def test_a_contact_at_the_end_of_the_training_is_unlike_it(place: tuple[float, float, float], known: bool) -> None:
    inside = (*place[:2], min(place[2], GEL.s.high))
    seen = components(READER.response, inside) * np.float32(place[2] / inside[2])  # its motion is linear in s
    assert (READER.read(features(READER, seen), SURE).unlikeness <= 1) == known


@pytest.mark.parametrize(
    ('place', 'known'),
    [
        ((0.0, 3.0, 0.73), True), ((0.0, 3.0, 0.77), True),
        ((-10.5, 3.0, 0.54), True), ((-10.5, 3.0, 0.58), False), ((2.0, 11.0, 0.35), True), ((2.0, 11.0, 0.39), False),
        ((10.5, -10.5, 0.35), True), ((10.5, -10.5, 0.39), False), ((11.2, -11.0, 0.1), False),
    ],
)  # fmt: skip
def test_near_the_rim_of_the_training_less_force_is_hard(place: tuple[float, float, float], known: bool) -> None:
    """The last intervals begin at an s of 0.75, 10 mm from the middle, and are 2 mm long."""
    reading = READER.read(features(READER, components(GEL, place)), SURE)
    assert (reading.unlikeness < 0.5) == known
    assert (reading.unlikeness == BEYOND_UNLIKENESS) == (not known)


def test_noise_is_given_up_after_few_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    compared, compare = [], response_module._compare
    monkeypatch.setattr(response_module, '_compare', lambda *each: compared.append(1) or compare(*each))
    random, steps = np.random.default_rng(6), []
    for least_gain in (0.0, 12.0):
        compared.clear()
        for _ in range(50):
            seen = random.normal(size=COMPONENTS).astype(np.float32)
            locate(GEL, seen, GEL.start(seen)[None], least_gain)
        steps.append(len(compared) / 50)
    assert steps[1] < 5 < steps[0]


def test_the_force_is_that_of_the_contact() -> None:
    reading = READER.read(features(READER, components(GEL, (3.0, -5.0, 0.64))), SURE)
    assert reading.contacts[0].force_n == pytest.approx(0.64, abs=2e-3)
    assert reading.normal_force_n.sum() == pytest.approx(0.64, abs=2e-3)


def test_errors_scatter_as_the_stated_covariance_says() -> None:
    """The sum of 300 squared errors of 3 numbers in units of their covariance is chi square with 900 degrees."""
    growth, random = 8.0, np.random.default_rng(8)
    gel = response(growth)
    place = np.array([2.3, -4.1, 0.5])
    spread = np.float32(math.sqrt(1 + growth * 0.5**2))
    squares = []
    for _ in range(300):
        seen = components(gel, place.tolist()) + spread * random.normal(size=COMPONENTS).astype(np.float32)
        fit = locate(gel, seen, gel.start(seen)[None])
        error = fit.contacts[0] - place
        squares.append(error @ fit.information @ error)
    assert sum(squares) == pytest.approx(900, abs=4 * math.sqrt(2 * 900))


def test_the_misfit_of_noise_is_its_variance_less_what_three_numbers_take() -> None:
    random = np.random.default_rng(9)
    misfits = []
    for _ in range(200):
        seen = components(GEL, (1.0, 1.0, 0.6)) + random.normal(size=COMPONENTS).astype(np.float32)
        misfits.append(locate(GEL, seen, GEL.start(seen)[None]).misfit)
    # (24 - 3) / 24, with a standard deviation of sqrt(2 * 21 / 200) / 24.
    assert np.mean(misfits) == pytest.approx(21 / 24, abs=4 * math.sqrt(2 * 21 / 200) / 24)


@settings(deadline=None, max_examples=20)
@given(places, st.floats(0, 2 * math.pi), st.floats(10, 15), st.floats(0.2, 0.9), st.integers(0, 99))
def test_two_contacts_are_found_where_two_are(
    first: tuple[float, float, float], angle: float, apart_mm: float, s: float, seed: int
) -> None:
    x, y, other = first[0] + apart_mm * math.cos(angle), first[1] + apart_mm * math.sin(angle), max(first[2], 0.2)
    if max(abs(x), abs(y)) > 11:
        return
    both = [(first[0], first[1], other), (x, y, s)]
    noise = np.random.default_rng(seed).normal(size=COMPONENTS).astype(np.float32)
    found = READER.fit(components(GEL, *both) + noise).contacts
    assert len(found) == 2
    order = 1 if np.hypot(*(found[0, :2] - both[0][:2])) < apart_mm / 2 else -1
    np.testing.assert_allclose(found[::order], both, atol=0.5)


@settings(deadline=None, max_examples=20)
@given(places, st.integers(0, 99))
def test_one_contact_is_found_where_one_is(place: tuple[float, float, float], seed: int) -> None:
    noise = np.random.default_rng(seed).normal(size=COMPONENTS).astype(np.float32)
    assert len(READER.fit(components(GEL, place) + noise).contacts) == 1


def test_contacts_are_reported_strongest_first_and_add_up() -> None:
    reading = READER.read(features(READER, components(GEL, (-6.0, 0.0, 0.3), (6.0, 2.0, 0.7))), SURE)
    assert [each.force_n for each in reading.contacts] == pytest.approx([0.7, 0.3], abs=5e-3)
    assert (reading.contacts[0].x_mm, reading.contacts[0].y_mm) == pytest.approx((6.0, 2.0), abs=0.02)
    assert reading.normal_force_n.sum() == pytest.approx(1.0, abs=5e-3)
    assert reading.total_sigma_n == pytest.approx(math.hypot(*(each.sigma_n for each in reading.contacts)))


def test_no_more_contacts_are_reported_than_allowed() -> None:
    seen = components(GEL, (-6.0, 0.0, 0.5), (6.0, 2.0, 0.7))
    assert len(dataclasses.replace(READER, most_contacts=1).fit(seen).contacts) == 1


def test_two_contacts_at_one_place_have_finite_uncertainties() -> None:
    """Nothing tells the two apart, so that their information is singular."""
    gel = response(scale=4000.0)
    seen = components(gel, (3.0, 3.0, 0.9))
    for seed in range(20):
        apart = 1e-5 * np.random.default_rng(seed).normal(size=(2, 3))
        fit = locate(gel, seen, np.array([3.0, 3.0, 0.45]) + apart)
        assert all(math.isfinite(each.sigma_mm + each.sigma_n) for each in READER.contacts(fit))


def test_noise_alone_is_no_force_and_no_place() -> None:
    random = np.random.default_rng(10)
    for _ in range(50):
        reading = READER.read(features(READER, random.normal(size=COMPONENTS)), SURE)
        assert not reading.normal_force_n.any()
        assert reading.contacts[0].sigma_mm == pytest.approx(32 / math.sqrt(12), abs=0.05)
        assert reading.unlikeness < 1


def test_still_features_are_no_force() -> None:
    reading = READER.read(np.zeros((GRID, GRID, 2), np.float32), SURE)
    assert not reading.normal_force_n.any()
    assert reading.unlikeness < 1e-6
    assert math.isfinite(reading.total_sigma_n)


def test_a_light_touch_is_seen() -> None:
    reading = READER.read(features(READER, components(GEL, (4.2, 4.4, 0.03))), SURE)
    assert reading.contacts[0].force_n == pytest.approx(0.03, abs=2e-3)


def test_what_no_contact_explains_is_unlike() -> None:
    strange = np.full(COMPONENTS, 200.0, np.float32)
    assert READER.read(features(READER, strange), SURE).unlikeness > 1


def test_what_lies_outside_of_all_directions_is_unlike() -> None:
    directions = READER.likeness.directions
    outside = np.random.default_rng(11).normal(size=2 * GRID**2)
    outside -= directions.T @ (directions @ outside)
    pressed = features(READER, components(GEL, (3.0, 3.0, 0.3)))
    assert READER.read(pressed, SURE).unlikeness < 1
    # The root mean square of 20 is ten times the floor of 2; the size of both adds a tenth of about 20.
    outside *= 20 / np.sqrt(np.mean(outside**2))
    seen = READER.read(pressed + outside.reshape(pressed.shape).astype(np.float32), SURE)
    size = math.sqrt(20**2 + np.mean(pressed.astype(float) ** 2))
    assert seen.unlikeness == pytest.approx(20 / (2 + 0.1 * size), rel=1e-3)
    assert seen.contacts[0].force_n == pytest.approx(0.3, abs=2e-3)


@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf, 1e25])
@pytest.mark.filterwarnings('ignore::RuntimeWarning')
def test_features_that_are_no_numbers_give_a_reading_that_is_none(value: float) -> None:
    values = np.zeros((GRID, GRID, 2), np.float32)
    values[2, 3, 0] = value
    reading = READER.read(values, SURE)
    assert np.isnan(reading.normal_force_n).all()
    assert math.isnan(reading.contacts[0].x_mm)
    assert not reading.unlikeness <= 1


def test_a_frame_in_which_too_few_regions_are_left_gives_no_reading() -> None:
    """24 directions need 12 regions of two numbers each; a covered lens is not a gel at rest."""
    values = features(READER, components(GEL, (3.0, 3.0, 0.3)))
    for left, known in ((0, False), (11, False), (12, True)):
        confidence = np.zeros(GRID * GRID, np.float32)
        confidence[:left] = 1
        reading = READER.read(values, confidence.reshape(GRID, GRID))
        assert math.isfinite(reading.normal_force_n.sum()) == known


@pytest.mark.parametrize('lost', [1, 5, 9])
def test_scores_without_some_inputs_are_those_of_least_squares(lost: int) -> None:
    random = np.random.default_rng(12)
    directions = np.linalg.qr(random.normal(size=(60, 8)))[0].T.astype(np.float32)
    inputs, missing = random.normal(size=60).astype(np.float32), np.zeros(60, bool)
    missing[random.permutation(60)[:lost]] = True
    inputs[missing] = 0
    seen = project(np.ascontiguousarray(directions), inputs, missing)
    expected, squares, *_ = np.linalg.lstsq(
        directions[:, ~missing].T.astype(float), inputs[~missing].astype(float), rcond=None
    )
    # Every direction is granted a thousandth of itself, so that those of which nothing is left come out as zero.
    np.testing.assert_allclose(seen.scores, expected, rtol=4e-3, atol=1e-3)
    assert seen.left_over == pytest.approx(math.sqrt(squares[0] / (60 - lost)), rel=2e-3)
    assert seen.size == pytest.approx(math.sqrt((inputs**2).sum() / (60 - lost)), rel=1e-5)


def test_a_direction_that_only_missing_inputs_show_scores_nothing() -> None:
    directions = np.eye(3, 6, dtype=np.float32)
    seen = project(directions, np.array([0, 2, 3, 0, 0, 0], np.float32), np.array([True] + 5 * [False]))
    np.testing.assert_allclose(seen.scores, [0, 2, 3], atol=4e-3)


def test_a_contact_is_found_without_the_regions_that_are_lost() -> None:
    confidence = SURE.copy()
    confidence[1, 1] = confidence[4, 2] = 0
    values = features(READER, components(GEL, (3.0, -4.0, 0.5)))
    values[confidence == 0] = 99.0
    contact = READER.read(values, confidence).contacts[0]
    assert (contact.x_mm, contact.y_mm, contact.force_n) == pytest.approx((3.0, -4.0, 0.5), abs=0.01)


def test_the_same_frame_gives_the_same_bits() -> None:
    values = features(READER, components(GEL, (-6.0, 0.0, 0.5), (6.0, 2.0, 0.7)))
    one, other = (readout().read(values, SURE) for _ in range(2))
    assert one.contacts == other.contacts
    np.testing.assert_array_equal(one.normal_force_n, other.normal_force_n)


@pytest.mark.parametrize(('count', 'bins'), [(71, BINS), (72, BinGrid(3, 3))])
def test_features_or_bins_of_another_size_are_refused(count: int, bins: BinGrid) -> None:
    READER.require_fit(72, BINS)
    with pytest.raises(ModelError, match=r'a response to 72 features on .* does not fit'):
        READER.require_fit(count, bins)


def test_the_parameters_are_those_that_were_learned() -> None:
    # 15 x 15 x 7 coefficients, whitening and growth of 24 components, and 24 directions of 72 features.
    assert READER.parameter_count == (15 * 15 * 7 + 24 + 1 + 72) * 24


def test_uncertainty_is_the_fits_with_a_floor_times_the_factor_for_the_force() -> None:
    calibration = Calibration(0.3, 0.02, (1.0, 3.0), (2.0, 4.0), misfit_limit=1.6)
    fit = READER.fit(components(GEL, (3.0, 3.0, 0.5)))
    plain, stated = READER.contacts(fit)[0], dataclasses.replace(READER, calibration=calibration).contacts(fit)[0]
    assert stated.sigma_mm == pytest.approx(2.0 * math.hypot(0.3, plain.sigma_mm), rel=1e-3)
    assert stated.sigma_n == pytest.approx(3.0 * math.hypot(0.02, plain.sigma_n), rel=1e-3)


@pytest.mark.parametrize(('height', 'factor'), [(-1, 1), (0, 1), (0.25, 1.5), (0.5, 2), (0.75, 4), (1, 6), (2, 6)])
def test_factors_lie_on_straight_lines(height: float, factor: float) -> None:
    assert factor_at((1.0, 2.0, 6.0), float(height)) == pytest.approx(factor)
    assert factor_at((3.0,), float(height)) == 3.0


def test_a_force_map_of_no_reading_is_not_finite() -> None:
    """The node calls what is not finite invalid."""
    model = ForceModel(FeatureLayout('cartesian_mean', GRID, GRID, 2), BINS, READER)
    values = np.full((GRID, GRID, 2), np.nan, np.float32)
    found = ForceEstimator(model).predict(Features('cartesian_mean', values, SURE))
    assert math.isnan(found.total_n)
    assert math.isnan(found.unlikeness)
    assert math.isnan(found.total_sigma_n)
