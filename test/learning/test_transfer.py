"""Transfer: a gel that differs from a known one in known ways is read after a few presses."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from responding_gel import CONFIG, NOISE_PX, REACH_MM, motion, presses

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.dataset import Dataset
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.response_fit import fit_response
from tactile_nodes.learning.transfer_build import Samples
from tactile_nodes.learning.transfer_fit import Transfer, cautious, folds_of, transfer
from tactile_nodes.learning.transfer_warp import SourceField, Warp, fit_warp, force_offset
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.sensing.response import ResponseReadout

SOFTER = 1.25
AWAY_MM = np.array([0.8, -0.5])


def other_gel(count: int, seed: int, reach_mm: float = REACH_MM - 1) -> Dataset:
    """Presses on a softer gel, over a camera that is aside: it answers as the first does 0.8 and -0.5 mm away."""
    random = np.random.default_rng(seed)
    places, force = random.uniform(-reach_mm, reach_mm, (count, 2)), random.uniform(0.05, 0.75, count)
    force = np.concatenate([force, np.zeros(20)])
    places = np.concatenate([places, np.zeros((20, 2))])
    field = motion(places + AWAY_MM, SOFTER * force)
    features = field + NOISE_PX * random.normal(size=field.shape)
    rows = np.column_stack([places, np.where(force > 0, 2 * force, -1.0), force]).astype(np.float32)
    return Dataset(
        features.astype(np.float16), rows, np.zeros(count + 20, int), np.ones((1, 6, 6), np.float32), 'other'
    )


@pytest.fixture(scope='module')
def source() -> ResponseReadout:
    dataset = presses(3000, seed=1)
    return fit_response(dataset, np.arange(3000) % 4 == 1, CONFIG, BinGrid(), Progress())


@pytest.fixture(scope='module')
def made(source: ResponseReadout) -> Transfer:
    return transfer(source, other_gel(25, seed=3))


def errors(readout: ResponseReadout, dataset: Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Distances of place (mm) and errors of force (N) of the presses."""
    touched = np.flatnonzero(dataset.presses[:, 2] > 0)
    read = [readout.read(dataset.features[i].astype(np.float32), dataset.confidence[0]).contacts[0] for i in touched]
    place = np.array([(each.x_mm, each.y_mm) for each in read]) - dataset.presses[touched, :2]
    return np.hypot(*place.T), np.array([each.force_n for each in read]) - dataset.presses[touched, 3]


def test_the_field_of_a_readout_is_the_motion_it_was_fitted_to(source: ResponseReadout) -> None:
    field = SourceField.of(source)
    at = np.tile([2.0, -3.0, 0.5], (1, 36, 1))
    true = motion(np.array([[2.0, -3.0]]), np.array([0.5]))
    assert field.motion(at)[0] == pytest.approx(true.reshape(36, 2), abs=0.03)


def test_slopes_are_those_of_finite_differences(source: ResponseReadout) -> None:
    field = SourceField.of(source)
    at, step = np.tile([2.0, -3.0, 0.5], (1, 36, 1)), 1e-2
    slopes = field.slopes(at)[1:]
    for axis in range(3):
        more, less = at.copy(), at.copy()
        more[..., axis] += step
        less[..., axis] -= step
        measured = (field.motion(more) - field.motion(less)) / (2 * step)
        assert slopes[axis] == pytest.approx(measured, abs=2e-3)


def test_beyond_what_the_source_knows_motion_goes_straight_on(source: ResponseReadout) -> None:
    field = SourceField.of(source)
    high = field.axes[2].high
    at, above = (np.tile([2.0, -3.0, s], (1, 36, 1)) for s in (high, high + 0.2))
    value, *_, along_s = field.slopes(at)
    assert field.motion(above) == pytest.approx(value + 0.2 * along_s, abs=1e-5)


def test_an_affine_warp_finds_softness_and_shift(source: ResponseReadout) -> None:
    field = SourceField.of(source)
    pairs = Samples.of(source, other_gel(25, seed=3), field.gain).pairs
    warp, _ = fit_warp(field, pairs, 'affine')
    assert warp.away_mm.mean(axis=0) == pytest.approx(AWAY_MM, abs=0.05)
    # In this gel motion is linear in force, so softness may stand in the gain of either.
    assert warp.gain * warp.motion[0, 0, 0] == pytest.approx(SOFTER, rel=0.03)


def test_the_warp_of_an_equal_gel_changes_nothing(source: ResponseReadout) -> None:
    field = SourceField.of(source)
    press = np.array([[1.0, 2.0, 0.6]])
    at = np.tile([1.0, 2.0, 0.6], (1, 36, 1))
    assert Warp.none(36).predict(field, press) == pytest.approx(field.motion(at))


def test_fresh_presses_are_read_as_well_as_the_source_reads_its_own(source: ResponseReadout, made: Transfer) -> None:
    place, force = errors(made.readout, other_gel(100, seed=4))
    own_place, own_force = errors(source, presses(100, seed=5))
    assert np.median(place) < 1.5 * np.median(own_place)
    assert np.sqrt(np.mean(force**2)) < 1.5 * np.sqrt(np.mean(own_force**2))


def test_uncalibrated_the_shift_remains(source: ResponseReadout) -> None:
    place, _ = errors(source, other_gel(50, seed=4))
    assert np.median(place) == pytest.approx(np.hypot(*AWAY_MM), abs=0.1)


def test_a_gel_that_is_only_warped_needs_no_larger_form(made: Transfer) -> None:
    assert made.form == 'affine'
    assert made.reason.startswith('affine: ')
    assert made.misfits['affine'] < made.misfits['gain'] / 2


def test_the_card_tells_errors_before_and_after(made: Transfer) -> None:
    said = made.as_dict()
    assert said['after']['place_median_mm'] < said['before']['place_median_mm']
    assert said['presses'] == 25
    assert 'readout' not in said


def test_five_of_six_fresh_presses_lie_within_the_stated_90_percent(made: Transfer) -> None:
    fresh = other_gel(100, seed=6)
    rows = np.flatnonzero(fresh.presses[:, 2] > 0)
    read = [made.readout.read(fresh.features[i].astype(np.float32), fresh.confidence[0]).contacts[0] for i in rows]
    off = np.array([each.force_n for each in read]) - fresh.presses[rows, 3]
    within = np.abs(off) <= 1.645 * np.array([each.sigma_n for each in read])
    assert within.mean() > 0.83


def test_few_presses_are_refused(source: ResponseReadout) -> None:
    with pytest.raises(DatasetError, match='presses at 5 places at least, and there are 4'):
        transfer(source, other_gel(4, seed=3))


def test_presses_in_one_corner_are_refused(source: ResponseReadout) -> None:
    with pytest.raises(DatasetError, match='press all over the surface'):
        transfer(source, other_gel(25, seed=3, reach_mm=3.0))


def test_forces_that_were_never_tared_are_refused(source: ResponseReadout) -> None:
    dataset = other_gel(25, seed=3)
    touched = dataset.presses[:, 2] > 0
    shifted = dataset.presses.copy()
    shifted[touched, 3] += 0.3
    with pytest.raises(DatasetError, match=r'forces seem to be \+0\.\d+ N .* tare'):
        transfer(source, dataclasses.replace(dataset, presses=shifted))


def test_an_offset_of_the_forces_is_found_with_its_sign(source: ResponseReadout) -> None:
    field = SourceField.of(source)
    pairs = Samples.of(source, other_gel(25, seed=3), field.gain).pairs
    assert force_offset(field, pairs) == pytest.approx(0.0, abs=0.01)


def test_the_gel_of_the_model_itself_is_not_made_worse(source: ResponseReadout) -> None:
    with pytest.raises(DatasetError, match='would not pay'):
        transfer(source, presses(30, seed=8, still=0.4))


def test_presses_at_one_place_are_held_out_together() -> None:
    fold = folds_of(np.array([[0, 0, 1], [1, 0, 1], [0, 0, 2], [2, 0, 1], [3, 0, 1], [4, 0, 1], [5, 0, 1.0]]))
    assert fold.tolist() == [0, 1, 0, 2, 3, 4, 0]


def test_with_ten_presses_the_largest_error_counts() -> None:
    ratios = np.arange(1.0, 101.0)
    assert cautious(ratios, 10) == 100.0
    assert cautious(ratios, 1000) == pytest.approx(91, abs=1.0)
