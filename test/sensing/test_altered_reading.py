"""Pictures of another light or sharpness are read with regions trusted the less the more they moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from responding import BINS, COMPONENTS, GRID, components, features, readout

from tactile_nodes.sensing.explain.measured.altered import (
    ALTERED_SHARE,
    BADLY_FOUND,
    DOUBT,
    LEFT_OVER,
    MIDDLE_SQUARE,
    noise_variance,
    read_altered,
    spread_of,
)
from tactile_nodes.sensing.explain.model import FeatureLayout, ForceEstimator, ForceModel
from tactile_nodes.sensing.features import Features

READER = readout(most_contacts=1, scale=20_000.0)  # of which noise is next to nothing
TRUSTING = replace(READER, scaling=replace(READER.scaling, confidence_floor=0.1))
EXACT = replace(READER, likeness=replace(READER.likeness, share=0.0))  # its directions leave nothing over of a press
SURE = np.ones((GRID, GRID), np.float32)
INPUTS = 2 * GRID**2


def pressed(s: float = 0.6, x: float = 2.0, y: float = -1.0) -> np.ndarray:
    return features(READER, components(READER.response, (x, y, s)))


def test_a_press_as_in_the_training_is_read_as_it_was() -> None:
    plain, altered = READER.read(pressed(), SURE), read_altered(READER, pressed(), SURE)
    assert altered.contacts[0].force_n == pytest.approx(plain.contacts[0].force_n, abs=1e-4)
    assert (altered.contacts[0].x_mm, altered.contacts[0].y_mm) == pytest.approx((2.0, -1.0), abs=1e-3)
    assert altered.unlikeness == plain.unlikeness
    assert altered.normal_force_n.sum() == pytest.approx(0.6, abs=1e-3)


def test_errors_in_proportion_to_motion_are_weighed_by_it() -> None:
    """Least squares by the errors' covariance are no worse than any other (Gauss, Markov)."""
    random, plain, altered = np.random.default_rng(2), [], []
    for _ in range(150):
        seen = pressed(0.6, *random.uniform(-6, 6, 2))
        size = np.sqrt(np.square(seen).mean(axis=-1, keepdims=True))
        seen = seen + (ALTERED_SHARE * size * random.normal(size=seen.shape)).astype(np.float32)
        plain.append(READER.read(seen, SURE).contacts[0].force_n - 0.6)
        altered.append(read_altered(READER, seen, SURE).contacts[0].force_n - 0.6)
    assert np.std(altered) < np.std(plain)


def test_regions_that_are_badly_found_count_for_the_less_the_more_they_moved() -> None:
    """A tenth of the regions, half as surely found as others must be, hold back half of the doubted share of motion."""
    random, plain, altered = np.random.default_rng(3), [], []
    for _ in range(60):
        badly = random.random((GRID, GRID)) < 0.1
        sure = np.where(badly, BADLY_FOUND / 2, SURE).astype(np.float32)
        seen = pressed(0.6, *random.uniform(-6, 6, 2)) * np.where(badly, 1 - DOUBT / 2, 1)[:, :, None]
        plain.append(read_altered(READER, seen.astype(np.float32), SURE).contacts[0].force_n - 0.6)
        altered.append(read_altered(TRUSTING, seen.astype(np.float32), sure).contacts[0].force_n - 0.6)
    assert np.square(altered).mean() < 0.25 * np.square(plain).mean()


def test_a_region_found_surely_enough_is_doubted_no_more_than_another() -> None:
    seen = pressed() * np.random.default_rng(5).uniform(0.9, 1.1, (GRID, GRID, 1)).astype(np.float32)
    sure, enough = (read_altered(TRUSTING, seen, SURE * share).contacts for share in (1.0, BADLY_FOUND + 0.01))
    assert sure == enough


PLAIN = replace(READER, likeness=replace(READER.likeness, directions=np.eye(COMPONENTS, INPUTS, dtype=np.float32)))
"""Each component is one input."""
NOWHERE = np.zeros(INPUTS, bool)


def test_the_noise_of_a_frame_is_that_of_the_middle_one_of_its_inputs() -> None:
    """The median of the square of a normal deviate is 0.4549 of its variance; two inputs far off change nothing."""
    left = np.array([0.1, 0.1, np.sqrt(4 * MIDDLE_SQUARE), -50.0, 50.0, np.nan], np.float32)
    assert noise_variance(READER, left, 0.0) == pytest.approx(4.0)
    drawn = np.random.default_rng(6).normal(0, 2, 20_000).astype(np.float32)
    assert noise_variance(READER, drawn, 0.0) == pytest.approx(4.0, rel=0.05)


def test_what_is_left_over_of_a_press_is_no_noise() -> None:
    """With a share of 0.1 the middle one has 0.022 of what was seen left over: of 50 that is 1.1, its square 1.21."""
    assert READER.likeness.share == 0.1
    left = np.full(9, np.sqrt(4 * MIDDLE_SQUARE), np.float32)
    assert noise_variance(READER, left, 50.0) == pytest.approx(4.0 - 1.21)
    assert LEFT_OVER == 0.22


def test_noise_counts_as_much_as_in_training_at_least() -> None:
    assert noise_variance(READER, np.full(9, 0.01, np.float32), 0.0) == 1.0
    assert noise_variance(READER, np.full(9, 100.0, np.float32), 0.0) == pytest.approx(1e4 / MIDDLE_SQUARE)
    assert noise_variance(READER, np.full(9, np.nan, np.float32), 0.0) == 1.0


def test_an_input_of_ten_times_the_noise_has_a_hundredth_of_the_weight() -> None:
    """Of an input that is noisy by 1 as all are, and by another √99."""
    off = np.zeros(INPUTS)
    off[3] = 99.0
    weights = np.linalg.inv(spread_of(PLAIN, NOWHERE, 1.0, off))
    assert weights == pytest.approx(np.diag([0.01 if n == 3 else 1.0 for n in range(COMPONENTS)]))


def test_noise_beyond_that_of_the_training_is_as_much_in_each_input() -> None:
    """A component that weighs inputs three times has 1 of the training's noise, and 9 times what is more of it."""
    heavy = replace(PLAIN, whitening=3 * np.eye(COMPONENTS, dtype=np.float32))
    assert spread_of(PLAIN, NOWHERE, 4.0, np.zeros(INPUTS)) == pytest.approx(4 * np.eye(COMPONENTS), abs=0.01)
    assert spread_of(heavy, NOWHERE, 4.0, np.zeros(INPUTS)) == pytest.approx((1 + 9 * 3) * np.eye(COMPONENTS), abs=0.04)


def test_a_component_of_two_inputs_is_noisier_where_one_of_them_is_missing() -> None:
    """Made of one of two that it is the sum of, over √2, it is √2 times that one: twice the variance, also its own."""
    directions = np.eye(COMPONENTS, INPUTS, dtype=np.float32)
    directions[0, [0, COMPONENTS]] = np.sqrt(0.5)
    halved = replace(PLAIN, likeness=replace(PLAIN.likeness, directions=directions))
    missing, off = NOWHERE.copy(), np.zeros(INPUTS)
    missing[COMPONENTS], off[0] = True, 5.0
    spread = spread_of(halved, missing, 1.0, off).diagonal()
    assert spread[0] == pytest.approx(2.0 + 2.0 * 5.0, rel=0.01)
    assert spread[1:] == pytest.approx(1.0, rel=0.01)


def test_a_noisy_picture_is_told_to_be_as_uncertain_as_it_is() -> None:
    """Noise of 2 in all inputs; the standard deviation of 150 is off by a seventeenth, four of those."""
    made = readout(most_contacts=1, scale=100.0)
    made = replace(made, likeness=replace(made.likeness, share=0.0))
    press = components(made.response, (2.0, -1.0, 0.6))
    random, errors, stated, unasked = np.random.default_rng(8), [], [], []
    for _ in range(150):
        seen = (features(made, press) + random.normal(0, 2, (GRID, GRID, 2))).astype(np.float32)
        found = read_altered(made, seen, SURE, blurred=True).contacts[0]
        errors.append(found.force_n - 0.6)
        stated.append(found.sigma_n)
        unasked.append(read_altered(made, seen, SURE, measured=True).contacts[0].sigma_n)
    assert np.std(errors) == pytest.approx(np.sqrt(np.mean(np.square(stated))), rel=4 / 17)
    assert np.sqrt(np.mean(np.square(unasked))) < 0.8 * np.std(errors)


@pytest.mark.parametrize(('blurred', 'holes', 'asked'), [(False, 0, True), (False, 1, False), (True, 1, True)])
def test_noise_is_asked_for_but_beside_holes_in_a_picture_that_is_not_told_blurred(
    blurred: bool, holes: int, asked: bool
) -> None:
    """Beside holes more than noise is left over. A force is less sure by the noise that was found."""
    made = readout(most_contacts=1, scale=100.0)
    made = replace(made, likeness=replace(made.likeness, share=0.0))
    press = features(made, components(made.response, (2.0, -1.0, 0.6)))
    seen = (press + np.random.default_rng(8).normal(0, 2, press.shape)).astype(np.float32)
    sure = SURE.copy()
    sure.reshape(-1)[:holes] = 0
    told, known = (read_altered(made, seen, sure, blurred=blurred, measured=each).contacts[0] for each in (False, True))
    assert (told.sigma_n > 1.3 * known.sigma_n) == asked


def test_no_force_stays_none() -> None:
    assert not read_altered(READER, np.zeros((GRID, GRID, 2), np.float32), SURE).normal_force_n.any()


def test_an_estimator_reads_so_what_it_is_told_is_altered() -> None:
    random = np.random.default_rng(4)
    seen = Features('cartesian_mean', (pressed() * random.uniform(0.9, 1.1, (GRID, GRID, 1))).astype(np.float32), SURE)
    estimator = ForceEstimator(ForceModel(FeatureLayout('cartesian_mean', GRID, GRID, 2), BINS, READER))
    assert estimator.predict(seen).total_n == pytest.approx(READER.read(seen.values, SURE).normal_force_n.sum())
    altered, blurred = (read_altered(READER, seen.values, SURE, blurred=each) for each in (False, True))
    assert estimator.predict(seen, altered=True).total_n == pytest.approx(altered := altered.normal_force_n.sum())
    assert estimator.predict(seen, altered=True, blurred=True).total_n == pytest.approx(blurred.normal_force_n.sum())
    assert estimator.predict(seen, altered=True, finer=True).total_n == pytest.approx(altered)
    assert altered != pytest.approx(estimator.predict(seen).total_n, abs=1e-4)
