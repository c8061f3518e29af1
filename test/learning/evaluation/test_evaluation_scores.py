"""Scores of hand-made answers, whose figures follow from arithmetic."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from tactile_nodes.learning.evaluation import scores
from tactile_nodes.learning.evaluation.predictions import Predictions
from tactile_nodes.learning.evaluation.statuses import score_status
from tactile_nodes.learning.evaluation.uncertainty import force_uncertainty, position_uncertainty
from tactile_nodes.sensing.geometry import BinGrid

BINS = BinGrid()
OK, DEGRADED, INVALID = 0, 1, 2  # msg/ForceDistribution.msg


def answers(
    places_mm: Sequence[tuple[float, float]],
    force_n: Sequence[float],
    found_n: Sequence[float],
    *,
    depth_mm: Sequence[float] | None = None,
    off_mm: Sequence[tuple[float, float]] | None = None,
    sigma_n: float | Sequence[float] = math.nan,
    sigma_mm: float | Sequence[float] = math.nan,
    status: Sequence[int] | None = None,
    nominal_n: float = math.nan,
) -> Predictions:
    """Answers whose whole force is in the true bin; a force of 0 is a frame at rest."""
    place, count = np.array(places_mm, float), len(places_mm)
    true, found = np.zeros((count, 81), np.float32), np.zeros((count, 81), np.float32)
    bins = [BINS.bin_of(float(x), float(y)) for x, y in places_mm]
    true[np.arange(count), bins], found[np.arange(count), bins] = force_n, found_n
    deep = np.where(np.array(force_n) > 0, 1.0, -1.0) if depth_mm is None else np.array(depth_mm, float)
    whole = np.ones(count)
    return Predictions(
        place, deep, true, found, place + np.array(off_mm or [(0.0, 0.0)] * count), np.array(found_n, float),
        whole * sigma_n, whole * sigma_mm, np.array(status or [OK] * count), whole * sigma_n, whole * nominal_n,
        BINS, contact_threshold_n=0.02,
    )  # fmt: skip


def test_presses_are_scored_by_place_and_force() -> None:
    found = answers([(0, 0)] * 2, [0.5, 0.5], [0.53, 0.46], off_mm=[(0.3, 0.4), (0.0, 0.1)])
    scored = scores.score_presses(found)
    assert scored.total_rmse_n == pytest.approx(math.sqrt((0.03**2 + 0.04**2) / 2), rel=1e-5)
    assert scored.total_median_n == pytest.approx(0.035, rel=1e-5)
    assert scored.position_median_mm == pytest.approx(0.3)
    assert scored.position_p95_mm == pytest.approx(0.1 + 0.95 * 0.4)
    assert (scored.right_bin, scored.d_loc_mm, scored.missed) == (1.0, 0.0, 0.0)
    assert scored.armse_n == pytest.approx(scored.rmse_mc_n / 81, rel=1e-5)


def test_a_press_below_the_models_threshold_is_missed() -> None:
    assert scores.score_presses(answers([(0, 0)] * 4, [0.1] * 4, [0.1, 0.019, 0.02, 0.0])).missed == 0.5


def test_places_that_a_model_does_not_name_are_left_out_of_the_places() -> None:
    found = answers([(0, 0)] * 2, [0.1] * 2, [0.1] * 2, off_mm=[(math.nan, math.nan), (0.2, 0.0)])
    assert scores.score_presses(found).position_median_mm == pytest.approx(0.2)


def test_groups_follow_border_region_and_depth() -> None:
    border = 16 / 9  # bin 40 reaches 1.778 mm to either side of the middle
    found = answers(
        [(0, 0), (border - 0.2, 0), (10, 0), (10, -10), (0, 0)], [0.1, 0.2, 0.5, 0.9, 0.0], [0.0] * 5,
        depth_mm=[0.25, 0.5, 1.0, 2.0, -1.0],
    )  # fmt: skip
    members = {name: np.flatnonzero(group).tolist() for name, group in scores.groups_of(found).items()}
    assert members == {
        'all presses': [0, 1, 2, 3],
        'within 0.3 mm of a bin border': [1],
        'away from bin borders': [0, 2, 3],
        'middle, 18x18 mm': [0, 1],
        'rim': [2],
        'corners': [3],
        '0.25 to 0.5 mm deep': [0],
        '0.5 to 1 mm deep': [1],
        '1 to 2 mm deep': [2, 3],
    }


def test_rest_counts_the_contacts_that_are_none() -> None:
    rest = scores.score_rest(answers([(0, 0)] * 4, [0.0] * 4, [0.03, -0.01, 0.0, 0.0], sigma_n=0.01))
    assert rest is not None
    assert rest.force_coverage == 0.75  # 1.645 times 0.01 is less than 0.03
    assert (rest.frames, rest.false_contacts) == (4, 0.25)
    assert rest.total_largest_n == pytest.approx(0.03)
    assert scores.score_rest(answers([(0, 0)], [0.1], [0.1])) is None


def test_light_touches_count_from_twenty_millinewtons_on() -> None:
    light = scores.score_light(answers([(0, 0)] * 4, [0.004, 0.021, 0.025, 0.04], [0.0, 0.02, 0.01, 0.05]))
    assert (light.touches, light.of_20_mn) == (4, 3)
    assert light.detected == pytest.approx(2 / 3)
    assert math.isnan(light.force_coverage)
    bands = {band.low_n: (band.touches, band.detected) for band in light.bands}
    assert bands == {0.0: (1, 0.0), 0.02: (2, 0.5), 0.03: (1, 1.0)}


def test_true_uncertainties_cover_what_they_state_and_order_the_errors() -> None:
    random = np.random.default_rng(4)
    sigma = random.uniform(0.001, 0.03, 4000)
    error, off = random.normal(scale=sigma), random.normal(scale=10 * sigma[:, None], size=(4000, 2))
    found = answers([(0, 0)] * 4000, [0.5] * 4000, (0.5 + error).tolist(), off_mm=off.tolist(),
                    sigma_n=sigma.tolist(), sigma_mm=(10 * sigma).tolist())  # fmt: skip
    force, place = force_uncertainty(found), position_uncertainty(found)
    assert force is not None
    assert place is not None
    for stated in (force, place):
        assert stated.coverage['all presses'] == pytest.approx(0.9, abs=0.015)
        assert stated.coverage['1 to 2 mm deep'] == stated.coverage['all presses']
        assert stated.levels['50%'] == pytest.approx(0.5, abs=0.025)
        assert [each.actual / each.stated for each in stated.curve] == pytest.approx([1.0] * 10, abs=0.15)


def test_a_model_without_uncertainty_has_none_to_judge() -> None:
    found = answers([(0, 0)] * 3, [0.5] * 3, [0.4] * 3)
    assert force_uncertainty(found) is None
    assert position_uncertainty(found) is None


def test_places_of_light_touches_count_where_they_are_detected() -> None:
    found = answers([(0, 0)] * 3, [0.03] * 3, [0.03, 0.03, 0.001], off_mm=[(0.1, 0.0), (2.0, 0.0), (9.0, 9.0)],
                    sigma_n=0.01, sigma_mm=0.5)  # fmt: skip
    light = scores.score_light(found)
    assert light.place_coverage == 0.75  # of four coordinates one is 2 mm off, and 1.645 times 0.5 are stated
    assert light.force_coverage == pytest.approx(2 / 3)


def test_a_status_is_scored_by_what_it_promises() -> None:
    """Ok means within twice the nominal 10 mN: of the two ok ones one is 30 mN off. The invalid one claims nothing."""
    found = answers(
        [(0, 0)] * 5, [0.5] * 5, [0.51, 0.53, 0.5, 0.6, 0.9], sigma_n=0.02, nominal_n=0.01,
        status=[OK, OK, DEGRADED, DEGRADED, INVALID],
    )  # fmt: skip
    scored = score_status(found)
    assert (scored.frames, scored.ok, scored.degraded, scored.invalid) == (5, 0.4, 0.4, 0.2)
    assert scored.held == 0.75  # 1.645 * 20 mN hold 10, 30 and 0 mN, and not 100
    assert scored.wrong_while_ok == 0.5


def test_a_model_without_an_uncertainty_promises_nothing() -> None:
    scored = score_status(answers([(0, 0)], [0.5], [0.5]))
    assert math.isnan(scored.held)
    assert math.isnan(scored.wrong_while_ok)
