"""Measuring a response: a gel whose motion is known is learned from presses, with true uncertainties."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from responding_gel import CONFIG, NOISE_PX, presses

from tactile_nodes.errors import ConfigurationError, DatasetError
from tactile_nodes.learning.config import ResponseConfig
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.measured.fit import fit_response, noise_scaling, sparse_cubes
from tactile_nodes.learning.progress import Progress
from tactile_nodes.sensing.explain.measured.readout import ResponseReadout
from tactile_nodes.sensing.explain.reading import Reading
from tactile_nodes.sensing.explain.splines import SplineAxis, cubes
from tactile_nodes.sensing.geometry import BinGrid

BINS = BinGrid()
COARSE, FEW = dataclasses.replace(CONFIG, components=8, spacing_mm=4.0), 200
"""Enough to see what reaches a fit, and how many presses are enough for it."""


def learned(dataset: Dataset, config: ResponseConfig = CONFIG, every: int = 4) -> ResponseReadout:
    return fit_response(dataset, np.arange(len(dataset.presses)) % every == 1, config, BINS, Progress())


@pytest.fixture(scope='module')
def readout() -> ResponseReadout:
    return learned(presses(1200, seed=1), dataclasses.replace(CONFIG, smoothing=(1e-3,)), every=2)


@pytest.fixture(scope='module')
def fresh() -> Dataset:
    return presses(800, seed=2)


@pytest.fixture(scope='module')
def readings(readout: ResponseReadout, fresh: Dataset) -> list[Reading]:
    return [readout.read(values.astype(np.float32), fresh.confidence[0]) for values in fresh.features]


def pressed(fresh: Dataset, readings: list[Reading]) -> tuple[np.ndarray, np.ndarray]:
    """x, y and force, and what is read: x, y, force, and the standard deviations of place and force."""
    found = [each.contacts[0] for each in readings]
    read = np.array([(each.x_mm, each.y_mm, each.force_n, each.sigma_mm, each.sigma_n) for each in found])
    touched = fresh.presses[:, 2] > 0
    return fresh.presses[touched][:, [0, 1, 3]].astype(float), read[touched]


def test_places_and_forces_of_fresh_presses_are_found(fresh: Dataset, readings: list[Reading]) -> None:
    """Noise alone would allow 0.015 mm N / F along an axis.

    (The integral of the field's squared slope is 78.5 mm² F² / 9, with a region every 19.4 mm².)
    """
    truth, read = pressed(fresh, readings)
    away = np.hypot(*(read[:, :2] - truth[:, :2]).T)
    # Of a normal error along two axes the median distance is 1.18 standard deviations; the splines add theirs.
    assert np.median(away * truth[:, 2]) < 1.5 * 1.18 * 0.015
    assert np.sqrt(np.mean((read[:, 2] - truth[:, 2]) ** 2)) < 0.01


def test_nine_of_ten_fresh_presses_lie_within_the_stated_interval(fresh: Dataset, readings: list[Reading]) -> None:
    truth, read = pressed(fresh, readings)
    place = np.abs(read[:, :2] - truth[:, :2]) < 1.645 * read[:, 3:4]
    force = np.abs(read[:, 2] - truth[:, 2]) < 1.645 * read[:, 4]
    assert 0.87 <= place.mean() <= 0.93
    assert 0.87 <= force.mean() <= 0.93


def test_a_larger_stated_error_is_a_larger_error(fresh: Dataset, readings: list[Reading]) -> None:
    truth, read = pressed(fresh, readings)
    away = np.hypot(*(read[:, :2] - truth[:, :2]).T)
    order = np.argsort(read[:, 3])
    surest, least_sure = np.array_split(away[order], 4)[0], np.array_split(away[order], 4)[-1]
    assert np.sqrt(np.mean(least_sure**2)) > 2 * np.sqrt(np.mean(surest**2))


def test_untouched_frames_read_no_force(fresh: Dataset, readings: list[Reading]) -> None:
    still = [each for each, depth in zip(readings, fresh.presses[:, 2], strict=True) if depth < 0]
    assert len(still) > 100
    assert np.mean([each.normal_force_n.any() for each in still]) < 0.05
    assert max(each.normal_force_n.sum() for each in still) < 0.02


def test_fresh_frames_are_like_the_training(readout: ResponseReadout, fresh: Dataset, readings: list[Reading]) -> None:
    """One of a thousand is not, by definition, and some of the hardest, which come out at the end of the training.

    Where the last interval of the splines has begun along x or y, hard presses are beyond it on purpose.
    """
    axes = readout.response.x, readout.response.y
    steps = [(axis.high - axis.low) / axis.intervals for axis in axes]
    inner = [
        (at > axis.low + step) & (at < axis.high - step)
        for axis, step, at in zip(axes, steps, fresh.presses[:, :2].T, strict=True)
    ]
    unlike = np.array([each.unlikeness > 1 for each in readings])[inner[0] & inner[1]]
    assert len(unlike) > 100
    assert np.mean(unlike) < 0.025


def test_motion_that_no_press_causes_is_unlike(readout: ResponseReadout, fresh: Dataset) -> None:
    """A camera that was knocked moves all regions alike."""
    values = fresh.features[0].astype(np.float32) + np.float32(0.3)
    assert readout.read(values, fresh.confidence[0]).unlikeness > 1


def test_smoothing_that_presses_the_response_flat_is_not_chosen() -> None:
    free = learned(presses(FEW, seed=1), dataclasses.replace(COARSE, smoothing=(1e-1, 1e5)))
    fixed = learned(presses(FEW, seed=1), dataclasses.replace(COARSE, smoothing=(1e-1,)))
    np.testing.assert_array_equal(free.response.coefficients, fixed.response.coefficients)


def test_with_few_noisy_presses_more_smoothing_is_chosen_than_none() -> None:
    noisy = presses(330, seed=3, still=0.2)
    random = np.random.default_rng(4)
    features = noisy.features + (20 * NOISE_PX * random.normal(size=noisy.features.shape)).astype(np.float16)
    noisy = dataclasses.replace(noisy, features=features)
    chosen = learned(noisy, dataclasses.replace(CONFIG, smoothing=(1e-6, 1.0)))
    smooth = learned(noisy, dataclasses.replace(CONFIG, smoothing=(1.0,)))
    np.testing.assert_array_equal(chosen.response.coefficients, smooth.response.coefficients)


@pytest.fixture(scope='module')
def one() -> ResponseReadout:
    return learned(presses(FEW, seed=5), COARSE)


def test_the_same_presses_give_the_same_bits(one: ResponseReadout) -> None:
    other = learned(presses(FEW, seed=5), COARSE)
    np.testing.assert_array_equal(one.response.coefficients, other.response.coefficients)
    np.testing.assert_array_equal(one.likeness.directions, other.likeness.directions)
    assert one.calibration == other.calibration


def test_presses_held_out_do_not_reach_the_fit(one: ResponseReadout) -> None:
    dataset = presses(FEW, seed=5)
    dataset.features[np.arange(FEW) % 4 == 1] += np.float16(1.0)
    other = learned(dataset, COARSE)
    np.testing.assert_array_equal(one.response.coefficients, other.response.coefficients)


def test_a_region_without_markers_does_not_reach_the_readout() -> None:
    dataset = presses(FEW, seed=5)
    confidence = dataset.confidence.copy()
    confidence[0, 2, 2] = 0.01
    blind = learned(dataclasses.replace(dataset, confidence=confidence), COARSE)
    noisy = dataset.features.copy()
    noisy[:, 2, 2] = np.random.default_rng(6).normal(0, 30, (FEW, 2))
    other = learned(dataclasses.replace(dataset, confidence=confidence, features=noisy), COARSE)
    np.testing.assert_allclose(other.response.coefficients, blind.response.coefficients, atol=1e-5)


def test_a_unit_of_a_feature_is_its_noise_at_rest() -> None:
    dataset = presses(2000, seed=7, still=0.5)
    scaling = noise_scaling(dataset, np.flatnonzero(dataset.presses[:, 2] < 0), CONFIG)
    # Quieter features count as the median; the standard deviation of 1000 is known to 2.2 %.
    np.testing.assert_allclose(1 / scaling.gain, NOISE_PX, rtol=0.1)
    np.testing.assert_allclose(scaling.mean, 0.0, atol=NOISE_PX * 5 / np.sqrt(1000))


@pytest.mark.parametrize('still', [0.1, 0.95])
def test_too_few_untouched_frames_or_presses_are_refused(still: float) -> None:
    with pytest.raises(
        DatasetError, match='needs at least 12 images of the untouched gel and 16 presses to train on, but without'
    ):
        learned(presses(100, seed=1, still=still))


@pytest.mark.parametrize(
    ('part', 'column', 'value', 'said'),
    [
        ('presses', 0, 0.0, 'at different places along x and along y'),
        ('presses', 3, -0.001, 'presses with a force'),
        ('confidence', slice(None), 0.0, 'regions with markers'),
    ],
    ids=['at one place', 'without a force', 'without markers'],
)
def test_presses_that_tell_nothing_are_refused(part: str, column: int | slice, value: float, said: str) -> None:
    dataset = presses(300, seed=1, still=0.4)
    changed = getattr(dataset, part).copy()
    changed[:, column] = value
    with pytest.raises(DatasetError, match=said):
        learned(dataclasses.replace(dataset, **{part: changed}))


@pytest.mark.parametrize('smoothing', [(), (1.0, -1.0)])
def test_a_smoothing_that_cannot_be_tried_is_refused(smoothing: tuple[float, ...]) -> None:
    with pytest.raises(ConfigurationError, match='weights to try'):
        learned(presses(300, seed=1, still=0.4), dataclasses.replace(CONFIG, smoothing=smoothing))


@settings(deadline=None, max_examples=30)
@given(st.lists(st.tuples(st.floats(-4, 4), st.floats(-3, 3), st.floats(-1, 2)), min_size=1, max_size=6))
def test_sparse_products_of_splines_are_the_full_ones(places: list[tuple[float, float, float]]) -> None:
    axes = SplineAxis(-3.0, 3.0, 3), SplineAxis(-2.0, 2.0, 2), SplineAxis(0.0, 1.0, 1)
    at = np.array(places)
    np.testing.assert_allclose(sparse_cubes(axes, at).toarray(), cubes(*axes, at), atol=1e-15)
