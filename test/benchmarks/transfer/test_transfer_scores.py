"""Scores of transfer: the aRMSE on any grid, and what chance has in a ratio; and the benchmark in a short form."""

from __future__ import annotations

import dataclasses
from functools import partial

import numpy as np
import pytest

from benchmarks.transfer import _planned, _tested, measure
from benchmarks.transfer.scores import (
    ALONE,
    AS_IT_IS,
    CALIBRATED,
    OWN_GEL,
    PLACEMENTS,
    TRAINED,
    Ratio,
    Score,
    draws,
    placed_squares,
    ratio,
)
from tactile_nodes.learning import config
from tactile_nodes.learning.axisymmetric import fit as axisymmetric_fit
from tactile_nodes.learning.datasets import pressed_gels
from tactile_nodes.learning.evaluation.evaluate import config_of
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.transfer import fit as transfer_fit
from tactile_nodes.model_file import find_model, load_model
from tactile_nodes.sensing.explain.reading import Contact, spread_over_bins
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.simulation.other_gels import other_gel

BINS = BinGrid()
OWN = Score(-1, 0, AS_IT_IS, 0.002, 0.02, 0.0, 0.001, 0.0, 0.0, 0.9)


def other(gel: int, force_n: float, drawn_n: list[float] | None = None) -> Score:
    drawn = None if drawn_n is None else np.tile(drawn_n, (3, 1))
    return dataclasses.replace(OWN, gel=gel, force_rmse_n=force_n, drawn=drawn)


def test_on_the_grid_in_the_middle_of_all_placements_bins_get_what_a_reading_gives_them() -> None:
    found = np.array([[1.79, -5.3, 0.4, 0.05], [-8.0, 12.45, 0.7, 0.02]])
    truth = np.array([[1.75, -5.3, 0.5], [-8.0, 12.5, 0.7]])
    # Placement 0 is half a bin aside along both axes.
    aside = 32.0 / 18
    for (x, y, force_n, sigma_mm), square, at in zip(found, placed_squares(found, truth, BINS), truth, strict=True):
        force = spread_over_bins((Contact(x - aside, y - aside, force_n, sigma_mm, 0.01),), BINS).ravel().astype(float)
        force[BINS.bin_of(at[0] - aside, at[1] - aside)] -= at[2]
        np.testing.assert_allclose(square[0], force**2, atol=1e-6)


def test_a_place_that_is_off_shows_in_as_many_placements_as_a_border_comes_between() -> None:
    # Off by a tenth of a bin along x: a border lies between the two places in a tenth of all placements.
    off = np.array([[0.01, 0.01, 0.5, 1e-6]]), np.array([[0.01 + 32.0 / 90, 0.01, 0.5]])
    wrong = placed_squares(*off, BINS).sum(axis=(0, 2))
    assert np.allclose(wrong[wrong > 1e-3], 2 * 0.5**2)
    assert int((wrong > 1e-3).sum()) in (PLACEMENTS // 10, PLACEMENTS // 10 + 1)


def test_ratios_are_of_the_median_and_the_worst_gel() -> None:
    assert ratio(OWN, [other(0, 0.004), other(1, 0.006)], 'force') == Ratio(2.5, 3.0)


def test_a_gel_twice_as_hard_that_is_twice_as_far_off_is_as_good_of_its_force() -> None:
    harder = dataclasses.replace(other(0, 0.004), pressed_n=2.0)
    assert ratio(OWN, [harder], 'force', of_force=True) == Ratio(1.0, 1.0)


def test_what_changes_alike_on_all_gels_and_the_own_one_is_no_error_of_a_ratio() -> None:
    own = dataclasses.replace(OWN, drawn=np.tile([0.002, 0.004], (3, 1)))
    alike = ratio(own, [other(0, 0.004, [0.004, 0.008])], 'force')
    assert (alike.median_error, alike.worst_error) == (0.0, 0.0)
    # 2 and 4 times the source's own: a standard deviation of 1.
    assert ratio(own, [other(0, 0.004, [0.004, 0.016])], 'force').worst_error == pytest.approx(1.0)


def test_every_readout_is_drawn_the_same_presses() -> None:
    np.testing.assert_array_equal(draws(7), draws(7))


def test_all_gels_are_tested_at_the_same_places_and_depths_and_calibrated_at_others() -> None:
    loaded, seed = load_model(find_model('portable')), 4242
    own = config_of(loaded).gel
    other = other_gel(own, 0, seed)
    here, there = (_tested(loaded, gel, Progress(), 14)[0].presses for gel in (own, other))
    np.testing.assert_array_equal(here[:, :3], there[:, :3])
    assert (here[:, 3] != there[:, 3]).all()
    pressed = _planned(loaded, other, Progress()).presses
    pressed = pressed[pressed[:, 2] > 0]
    assert np.hypot(*(here[:, None, :2] - pressed[:, :2]).transpose(2, 0, 1)).min() > 0.01


def test_in_short_form_ten_presses_make_the_model_serve_another_gel(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pressed_gels, 'PLANNED', 10)
    monkeypatch.setattr(transfer_fit, 'FOLDS', 3)
    loaded = load_model(find_model('portable'))
    own, scores = measure(loaded, range(1), Progress(), seed=4242, counts=(10,), frames=14)
    before, after, alone = scores
    assert [each.way for each in scores] == [AS_IT_IS, CALIBRATED, ALONE]
    assert own.tested == before.tested > 7
    assert after.force_rmse_n < 0.3 * before.force_rmse_n
    assert own.placed_armse_n < after.placed_armse_n < min(before.placed_armse_n, alone.placed_armse_n)


def test_in_short_form_a_model_of_its_own_reads_its_gel(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(axisymmetric_fit, 'PAIRS', 1000)
    monkeypatch.setattr(config, 'AxisymmetricConfig', partial(config.AxisymmetricConfig, turns=6))
    loaded = load_model(find_model('portable'))
    own, (trained,) = measure(loaded, range(0), Progress(), frames=20, trained=150)
    assert (trained.gel, trained.presses, trained.way) == (OWN_GEL, 150, TRAINED)
    # By a fiftieth of the presses that the source was trained by: further off than that, but not by much.
    assert own.force_rmse_n < trained.force_rmse_n < 0.015
    assert own.place_median_mm < trained.place_median_mm < 0.1
