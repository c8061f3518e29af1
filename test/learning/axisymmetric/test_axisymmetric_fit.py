"""Measuring an axisymmetric response: what it finds on a gel whose motion is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from responding_gel import AXISYMMETRIC, motion, presses

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.axisymmetric.fit import SMEAR, fit_axisymmetric, weighted_choice
from tactile_nodes.learning.axisymmetric.regions import (
    FIRST_DOUBT,
    Expected,
    Presses,
    measured_doubt,
    views,
)
from tactile_nodes.learning.axisymmetric.steps import fit_regions
from tactile_nodes.learning.config import load_train_config
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.training.train import train
from tactile_nodes.model_file import load_model
from tactile_nodes.sensing.explain.axisymmetric.radial_smear import RadialSmear
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout
from tactile_nodes.sensing.geometry import BinGrid


def test_the_fitted_motion_is_that_of_the_gel(known_gel: AxisymmetricReadout) -> None:
    press = np.array([[2.0, -3.0, 0.5]])
    true = motion(press[:, :2], press[:, 2]).reshape(1, 36, 2)
    left = known_gel.response.motion(press) - true
    assert np.linalg.norm(left) < 0.06 * np.linalg.norm(true)


def test_regions_are_found_where_they_look(known_gel: AxisymmetricReadout) -> None:
    """They lie 4.4 mm apart, from -11 mm on; the first guess put them 5.3 mm apart."""
    inner = np.abs(views(np.ones((6, 6)))).max(axis=1) < 0.6
    true = np.stack(np.meshgrid(*[np.linspace(-11.0, 11.0, 6)] * 2), axis=-1).reshape(-1, 2)
    assert np.abs(known_gel.response.places - true)[inner].max() < 0.3


def test_no_squeeze_is_found_where_regions_look_straight(known_gel: AxisymmetricReadout) -> None:
    """Of a gel whose regions look aslant it is 0.1; this fit is from 240 noisy presses, in four turns."""
    assert abs(known_gel.response.smear.squeeze) < 0.05


def test_radial_smear_is_found_with_the_regions(known_gel: AxisymmetricReadout) -> None:
    """From the motion of a response with radial smear, a fit that starts without it finds the same."""
    true = replace(known_gel.response, smear=RadialSmear(-0.4, 0.1))
    predicted = Presses.of(presses(150, seed=12, still=0.0), np.arange(150), known_gel.scaling)
    predicted = replace(predicted, motion=true.motion(predicted.contacts))
    found = known_gel.response
    for _ in range(6):
        found = fit_regions(found, predicted, Expected.around(found), FIRST_DOUBT, SMEAR)
    assert found.smear.shift_mm == pytest.approx(-0.4, abs=0.02)
    assert found.smear.squeeze == pytest.approx(0.1, abs=0.005)


def test_presses_that_no_fit_saw_are_read(known_gel: AxisymmetricReadout) -> None:
    fresh = presses(80, seed=9, still=0.0)
    read = [known_gel.read(each.astype(np.float32), fresh.confidence[0]).contacts[0] for each in fresh.features]
    away = np.hypot(*(np.array([(each.x_mm, each.y_mm) for each in read]) - fresh.presses[:, :2]).T)
    off = np.array([each.force_n for each in read]) - fresh.presses[:, 3]
    assert np.median(away) < 0.15
    assert np.median(np.abs(off)) < 0.01


def test_nine_of_ten_fresh_presses_lie_within_the_stated_90_percent(known_gel: AxisymmetricReadout) -> None:
    """Of 120 the share has a standard deviation of 3 %, and the factors follow from some 60 presses alone."""
    fresh = presses(120, seed=10, still=0.0)
    read = [known_gel.read(each.astype(np.float32), fresh.confidence[0]).contacts[0] for each in fresh.features]
    off = np.abs(np.array([each.force_n for each in read]) - fresh.presses[:, 3])
    within = off <= 1.645 * np.array([each.sigma_n for each in read])
    assert 0.82 < within.mean() < 0.99


def test_what_regions_miss_is_measured_as_a_share_of_their_motion(known_gel: AxisymmetricReadout) -> None:
    """With a tenth more motion than is predicted, each region is off by a tenth."""
    fresh = presses(100, seed=11, still=0.0)
    seen = Presses.of(fresh, np.arange(100), known_gel.scaling)
    predicted = known_gel.response.motion(seen.contacts)
    more = Presses(seen.contacts, 1.1 * predicted, np.full_like(seen.certainty, 1e12))
    # The mean of both channels' squares: sqrt(0.1^2 / 2) of the whole motion, a channel.
    assert measured_doubt(known_gel.response, more)[2:6] == pytest.approx(0.1 / np.sqrt(2), rel=1e-3)


def test_too_few_presses_are_refused() -> None:
    with pytest.raises(DatasetError, match='at least 12 images of the untouched gel and 100 presses'):
        fit_axisymmetric(presses(60, seed=1), np.zeros(60, bool), AXISYMMETRIC, BinGrid(), Progress())


def test_presses_at_one_place_are_refused() -> None:
    dataset = presses(200, seed=1)
    there = dataset.presses.copy()
    there[there[:, 2] > 0, :2] = 1.0, -2.0
    with pytest.raises(DatasetError, match='at many places'):
        fit_axisymmetric(replace(dataset, presses=there), np.zeros(200, bool), AXISYMMETRIC, BinGrid(), Progress())


def test_a_run_file_that_asks_for_it_gets_an_axisymmetric_model(tmp_path: Path) -> None:
    """From the configuration to a file that the live node reads; 130 rendered presses, of regions that are large."""
    run = tmp_path / 'run.yaml'
    run.write_text(
        f'output: {tmp_path / "small.safetensors"}\n'
        'readout: axisymmetric\n'
        'data: {presses: 170, without_contact: 0.15, presses_per_rest_image: 0, processes: 1}\n'
        'flow: {name: inverse_compositional, options: {rows: 5, cols: 5, finest_scale: 1}}\n'
        'encoding: {name: cartesian_mean, options: {rows: 5, cols: 5}}\n'
        'axisymmetric: {lateral: 1, vertical: 1, turns: 4, presses_per_turn: 60, most_presses: 120}\n',
        encoding='utf-8',
    )
    loaded = load_model(train(load_train_config(run)))
    assert loaded.model.readout.kind == 'axisymmetric'
    assert loaded.model.contact_threshold_n == pytest.approx(0.015)
    assert loaded.card['training']['settings']['turns'] == 4
    # Nothing but presses of 0 to 1.2 N was seen, so an error of the total far below their spread of 0.35 N is learned.
    assert loaded.card['validation']['total_rmse_n'] < 0.2


def test_rounding_of_the_weights_does_not_change_which_pairs_are_taken() -> None:
    likely = np.random.default_rng(3).uniform(size=20_000) ** 2
    rounded = likely * (1 + 1e-12 * np.random.default_rng(4).normal(size=20_000))
    taken = [weighted_choice(np.random.default_rng(5), each, 10_000) for each in (likely, rounded)]
    np.testing.assert_array_equal(*taken)


def test_pairs_are_taken_as_often_as_their_weights_say_and_those_without_one_never() -> None:
    random, likely = np.random.default_rng(6), np.array([0.0, 1.0, 3.0, 0.0])
    taken = [weighted_choice(random, likely, 1)[0] for _ in range(4000)]
    # Of 4000 draws 3000 are expected to be the heavier one, with a standard deviation of 27.
    assert np.bincount(taken, minlength=4)[[0, 3]].sum() == 0
    assert abs(taken.count(2) - 3000) < 110
