"""Calibrating without a rig: presses of which the force or the place is not known."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from responding_gel import AXISYMMETRIC, NOISE_PX, REACH_MM, motion, presses

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.axisymmetric.fit import fit_axisymmetric
from tactile_nodes.learning.axisymmetric.regions import Presses
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.transfer.fit import OtherGel, live_errors
from tactile_nodes.learning.transfer.partial import (
    ASIDE,
    HARDNESS_HELD,
    PLACES_HELD,
    REGION_TURNS,
    folds_of_partial,
    transfer_outline,
    transfer_partial,
)
from tactile_nodes.learning.transfer.partial_presses import at, located
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout
from tactile_nodes.sensing.explain.axisymmetric.response import AxisymmetricResponse
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.sensing.picture.outline import OutlineMap

SOFTER = 1.25
AWAY_MM = np.array([0.8, -0.5])


def as_pens(dataset: Dataset) -> Dataset:
    """Every press as at its known place, with a force that nobody knows."""
    told = dataset.presses.copy()
    told[told[:, 2] > 0, 3] = np.nan
    return dataclasses.replace(dataset, presses=told)


def pressed(places: np.ndarray, force: np.ndarray, seed: int) -> Dataset:
    """A softer gel over a camera that is aside; twenty images of it untouched come last."""
    random = np.random.default_rng(seed)
    force, places = np.append(force, np.zeros(20)), np.vstack([places, np.zeros((20, 2))])
    field = motion(places + AWAY_MM, SOFTER * force)
    features = field + NOISE_PX * random.normal(size=field.shape)
    rows = np.column_stack([places, np.where(force > 0, 1.0, -1.0), force]).astype(np.float32)
    confidence = np.ones((1, 6, 6), np.float32)
    return Dataset(features.astype(np.float16), rows, np.zeros(len(force), int), confidence, 'other')


def scattered(count: int, seed: int, force_n: float | None = None) -> Dataset:
    random = np.random.default_rng(seed)
    places = random.uniform(1 - REACH_MM, REACH_MM - 1, (count, 2))
    force = random.uniform(0.1, 0.7, count) if force_n is None else np.full(count, force_n)
    return pressed(places, force, seed)


def as_weights(dataset: Dataset, force_n: float) -> Dataset:
    """Every press as a known weight at a place that nobody knows."""
    presses = dataset.presses.copy()
    presses[presses[:, 2] > 0] = np.nan, np.nan, 1.0, force_n
    return dataclasses.replace(dataset, presses=presses)


def errors(readout: AxisymmetricReadout) -> tuple[float, float]:
    """Median distance (mm), and median error of the force (N), of fresh presses."""
    fresh = scattered(60, seed=8)
    found = live_errors(readout, fresh, np.arange(60))
    return float(np.median(np.hypot(found[:, 0], found[:, 1]))), float(np.median(np.abs(found[:, 2])))


@pytest.fixture(scope='module')
def source() -> AxisymmetricReadout:
    dataset = presses(500, seed=1)
    return fit_axisymmetric(dataset, np.arange(500) % 4 == 1, AXISYMMETRIC, BinGrid(), Progress())


def test_weights_at_unknown_places_tell_the_hardness(source: AxisymmetricReadout) -> None:
    made = transfer_partial(source, as_weights(scattered(10, seed=3, force_n=0.5), 0.5))
    assert errors(made.readout)[1] < 0.25 * errors(source)[1]
    assert made.weights == 10 and PLACES_HELD in made.held
    assert made.whole['shift_x_mm'] == made.whole['shift_y_mm'] == 0.0


def test_pens_of_unknown_force_tell_where_the_camera_looks(source: AxisymmetricReadout) -> None:
    made = transfer_partial(source, as_pens(scattered(10, seed=3)))
    assert errors(source)[0] == pytest.approx(float(np.hypot(*AWAY_MM)), abs=0.1)
    assert errors(made.readout)[0] < 0.2
    assert made.pens == 10 and HARDNESS_HELD in made.held


def test_pens_leave_the_hardness_of_the_known_gel(source: AxisymmetricReadout) -> None:
    made = transfer_partial(source, as_pens(scattered(10, seed=3)))
    assert made.whole['softness'] == made.whole['lateral'] == made.whole['vertical'] == 0.0
    assert math.isnan(made.after.force_rmse_n)


def test_weights_and_three_pens_tell_both(source: AxisymmetricReadout) -> None:
    dataset = scattered(13, seed=4)
    told = dataset.presses.copy()
    told[:3, 3] = np.nan
    told[3:13, :2] = np.nan
    made = transfer_partial(source, dataclasses.replace(dataset, presses=told))
    place, force = errors(made.readout)
    assert place < 0.25 and force < 0.25 * errors(source)[1]
    assert made.held == ()


def test_presses_follow_the_regions_that_they_tell_of(source: AxisymmetricReadout) -> None:
    """Weights believed a millimetre off: held there they bend regions, located anew each turn they come back."""
    other = OtherGel.of(source, scattered(30, seed=5, force_n=0.5))
    truth, whole = other.presses.contacts, other.whole('whole').response
    wrong = truth + np.random.default_rng(6).normal(scale=(0.7, 0.7, 0.0), size=truth.shape)
    nowhere = at(other.presses, np.where([True, True, False], np.nan, truth))

    def placed(response: AxisymmetricResponse) -> Presses:
        return at(other.presses, located(response, nowhere, REACH_MM, begin=wrong))

    fresh = scattered(60, seed=8)

    def off(presses: Callable[[AxisymmetricResponse], Presses]) -> float:
        made = other.regions_of(whole, presses, REGION_TURNS, ASIDE).motion(fresh.presses[:60, [0, 1, 3]].astype(float))
        return float(np.square(made.reshape(60, 6, 6, 2) - fresh.features[:60].astype(float)).mean())

    known = off(lambda _: other.presses)
    bent = off(lambda _: at(other.presses, wrong))
    assert off(placed) - known < 0.1 * (bent - known)


def test_an_outline_tells_where_the_camera_looks_without_a_press(source: AxisymmetricReadout) -> None:
    # Six regions span 26.4 mm, so 1 mm is 100 / 13.2 px of a picture 200 px wide; the other gel shows at p + AWAY_MM
    # of the picture what the known one shows at p.
    shift_px = AWAY_MM * 100 / 13.2
    made = transfer_outline(source, OutlineMap(np.eye(2), shift_px, np.eye(6), 0.0), 100.0)
    assert errors(made.readout)[0] < 0.25 * errors(source)[0]
    assert HARDNESS_HELD in made.held


def test_an_outline_does_not_take_over_what_one_gel_gets_wrong_at_its_places(source: AxisymmetricReadout) -> None:
    correction = dataclasses.replace(source.correction, local=np.full((29, 29, 3), 0.5))
    outline = OutlineMap(np.eye(2), np.zeros(2), np.eye(6), 0.0)
    assert (
        transfer_outline(dataclasses.replace(source, correction=correction), outline, 100.0).readout.correction.local
        is None
    )


def test_pictures_of_one_hold_are_one_weight(source: AxisymmetricReadout) -> None:
    single = scattered(10, seed=3, force_n=0.5)
    rows = np.r_[np.repeat(np.arange(10), 4), np.arange(10, len(single.presses))]
    held = dataclasses.replace(single.take(rows), hold=rows)
    assert transfer_partial(source, as_weights(held, 0.5)).weights == 10
    assert transfer_partial(source, as_pens(held)).pens == 10


def test_pens_at_one_place_are_held_out_together() -> None:
    # Four places, of which the first was pressed twice more, and two weights somewhere.
    places = np.array([[0, 0], [5, 0], [0, 5], [0, 0], [5, 5], [0, 0], [np.nan, np.nan], [np.nan, np.nan]])
    contacts = np.column_stack([places, np.full(8, 0.5)])
    assert folds_of_partial(contacts).tolist() == [0, 1, 2, 0, 3, 0, 4, 0]


def test_presses_at_three_places_are_held_out_one_by_one_since_two_places_fix_no_camera() -> None:
    contacts = np.array([[0, 0, 1], [5, 0, 1], [0, 5, 1], [0, 0, 1], [5, 0, 1], [0, 5, 1]], float)
    assert folds_of_partial(contacts).tolist() == [0, 1, 2, 3, 4, 0]


def test_a_calibration_says_why_it_took_its_form(source: AxisymmetricReadout) -> None:
    assert transfer_partial(source, as_pens(scattered(6, seed=3))).reason.startswith('whole: too few presses')
    reason = transfer_partial(source, as_pens(scattered(10, seed=3))).reason
    assert 'of held-out presses unexplained; ' + HARDNESS_HELD in reason


def test_a_gel_that_shows_no_markers_is_refused(source: AxisymmetricReadout) -> None:
    dataset = as_pens(scattered(6, seed=3))
    with pytest.raises(DatasetError, match='in 0 regions alone'):
        transfer_partial(source, dataclasses.replace(dataset, confidence=np.zeros_like(dataset.confidence)))


def test_the_card_says_nothing_of_errors_that_nobody_knows(source: AxisymmetricReadout) -> None:
    told = transfer_partial(source, as_pens(scattered(6, seed=3))).as_dict()
    assert told['after']['force_rmse_n'] is None
    assert told['after']['place_median_mm'] < told['before']['place_median_mm']


@pytest.mark.parametrize(
    ('columns', 'said'), [([0, 1, 3], 'neither place nor force'), ([0], 'x is known and y is not')]
)
def test_a_press_that_tells_nothing_is_refused(source: AxisymmetricReadout, columns: list[int], said: str) -> None:
    dataset = scattered(6, seed=3)
    told = dataset.presses.copy()
    told[2, columns] = np.nan
    with pytest.raises(DatasetError, match=said if columns != [0] else 'y'):
        transfer_partial(source, dataclasses.replace(dataset, presses=told))


def test_four_presses_are_too_few(source: AxisymmetricReadout) -> None:
    with pytest.raises(DatasetError, match='5 presses at least'):
        transfer_partial(source, as_pens(scattered(4, seed=3)))


def test_nothing_told_of_forces_makes_their_uncertainty_large(source: AxisymmetricReadout) -> None:
    made = transfer_partial(source, as_pens(scattered(6, seed=3)))
    assert dataclasses.asdict(made.readout.calibration)['force_floor_n'] >= 0.1
