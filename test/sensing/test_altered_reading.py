"""Pictures of another light or sharpness are read with regions trusted the less the more they moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from responding import BINS, GRID, components, features, readout

from tactile_nodes.sensing.altered_reading import ALTERED_SHARE, BADLY_FOUND, DOUBT, read_altered
from tactile_nodes.sensing.contact_width import USUAL_MM2
from tactile_nodes.sensing.features import Features
from tactile_nodes.sensing.model import FeatureLayout, ForceEstimator, ForceModel

READER = readout(most_contacts=1, scale=20_000.0)  # of which noise is next to nothing
TRUSTING = replace(READER, scaling=replace(READER.scaling, confidence_floor=0.1))
SURE = np.ones((GRID, GRID), np.float32)


def pressed(s: float = 0.6, x: float = 2.0, y: float = -1.0) -> np.ndarray:
    return features(READER, components(READER.response, (x, y, s)))


def test_a_press_as_in_the_training_is_read_as_it_was() -> None:
    plain, altered = READER.read(pressed(), SURE), read_altered(READER, pressed(), SURE)
    assert altered.contacts[0].force_n == pytest.approx(plain.contacts[0].force_n, abs=1e-4)
    assert (altered.contacts[0].x_mm, altered.contacts[0].y_mm) == pytest.approx((2.0, -1.0), abs=1e-3)
    assert altered.unlikeness == plain.unlikeness
    assert altered.normal_force_n.sum() == pytest.approx(0.6, abs=1e-3)


def test_errors_in_proportion_to_motion_are_weighed_by_it() -> None:
    """Least squares by the errors' covariance are no worse than any other (Gauss, Markov), and state their errors.

    The standard deviation of 150 is off by a seventeenth, as a standard deviation of its own; four of those.
    """
    random, plain, altered, stated = np.random.default_rng(2), [], [], []
    for _ in range(150):
        seen = pressed(0.6, *random.uniform(-6, 6, 2))
        size = np.sqrt(np.square(seen).mean(axis=-1, keepdims=True))
        seen = seen + (ALTERED_SHARE * size * random.normal(size=seen.shape)).astype(np.float32)
        plain.append(READER.read(seen, SURE).contacts[0].force_n - 0.6)
        found = read_altered(READER, seen, SURE).contacts[0]
        altered.append(found.force_n - 0.6)
        stated.append(found.sigma_n)
    assert np.std(altered) < np.std(plain)
    assert np.std(altered) == pytest.approx(np.sqrt(np.mean(np.square(stated))), rel=4 / 17)


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


def test_a_width_of_its_own_is_granted_to_contacts_of_sharp_pictures_only() -> None:
    """Four places, of twice the usual width: with it the force is nearer to what all four are together."""
    apart_mm = (8 * USUAL_MM2) ** 0.5
    places = [(2.0 + apart_mm, -1.0), (2.0 - apart_mm, -1.0), (2.0, -1.0 + apart_mm), (2.0, -1.0 - apart_mm)]
    seen = features(READER, components(READER.response, *[(*place, 0.15) for place in places]))
    sharp, blurred = (read_altered(READER, seen, SURE, blurred=each).contacts[0].force_n for each in (False, True))
    assert abs(sharp - 0.6) < 0.9 * abs(blurred - 0.6)


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
    assert altered != pytest.approx(estimator.predict(seen).total_n, abs=1e-4)
