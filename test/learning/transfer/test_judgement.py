"""Which models are worth to be written, by presses that were held out."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.transfer.errors import Errors
from tactile_nodes.learning.transfer.judgement import objection, of_the_mean, poor, require_worth, share_of

NOTHING = Errors(math.nan, math.nan, math.nan)


def off(force_n: float, place_mm: float) -> Errors:
    return Errors(force_n, force_n, place_mm)


def test_the_mean_of_four_presses_is_as_far_off_as_they_are_from_it() -> None:
    contacts = np.array([[-3.0, 4.0, 0.2], [3.0, -4.0, 0.6], [-3.0, -4.0, 0.2], [3.0, 4.0, 0.6]])
    mean = of_the_mean(contacts)
    assert (mean.force_rmse_n, mean.force_median_n, mean.place_median_mm) == pytest.approx((0.2, 0.2, 5.0))


def test_weights_of_one_size_are_no_measure_of_a_model() -> None:
    contacts = np.array([[1.0, 0.0, 0.49], [1.5, 0.0, 0.49]])
    assert objection('calibration', off(0.05, 9.0), NOTHING, of_the_mean(contacts)) == ''


def test_what_is_closer_by_force_and_less_close_by_place_is_judged_on_balance() -> None:
    assert share_of(off(0.01, 0.4), off(0.05, 0.1)) == pytest.approx(0.8)


def test_anything_is_better_than_nothing_and_nothing_is_no_better_than_anything() -> None:
    assert share_of(off(0.1, 1.0), NOTHING) == 0.0
    assert share_of(NOTHING, off(0.1, 1.0)) == math.inf


def test_a_model_that_reads_worse_than_the_one_before_is_objected_to_with_both_errors() -> None:
    said = objection('calibration', off(0.08, 0.2), off(0.05, 0.1), off(0.2, 5.0))
    assert said == (
        'the calibration would not help: held-out presses are read 0.0800 N and 0.200 mm off with it, '
        '0.0500 N and 0.100 mm without (medians)'
    )


def test_a_model_that_is_no_better_than_the_mean_is_objected_to() -> None:
    said = objection('model', off(0.2, 6.0), None, off(0.2, 5.0))
    assert said.endswith('0.2000 N and 5.000 mm when predicting the mean of all presses (medians)')


def test_places_do_not_make_up_for_forces_that_are_no_better_than_the_mean() -> None:
    """Of a table with true places whose forces are those of other presses."""
    assert 'when predicting the mean' in objection('calibration', off(0.3, 0.2), off(0.3, 1.2), off(0.15, 5.0))


def test_a_few_ruined_presses_count_though_medians_do_not_see_them() -> None:
    """Nine presses 0.01 N off and one 1.6 N: their median is 0.01 N, their root mean square 0.506 N."""
    ruined = Errors.of(np.column_stack([np.full((10, 2), 0.1), [0.01] * 9 + [1.6]]))
    assert (ruined.force_median_n, ruined.force_rmse_n) == pytest.approx((0.01, 0.506), abs=1e-3)
    assert objection('calibration', ruined, off(0.8, 0.5), off(0.253, 5.0)) == (
        'the calibration would not help: the force RMSE of held-out presses is 0.5061 N with it, 0.2530 N when '
        'predicting the mean of all presses'
    )
    assert objection('calibration', ruined, off(0.3, 5.0), off(0.8, 5.0)).endswith('0.5061 N with it, 0.3000 N without')
    assert objection('calibration', ruined, off(0.6, 0.5), off(0.8, 5.0)) == ''
    # A fifth more than the mean is chance of twelve presses.
    assert objection('calibration', ruined, off(0.8, 0.5), off(0.506 / 1.2, 5.0)) == ''


def test_an_objection_ends_it_unless_the_model_is_wanted_all_the_same() -> None:
    with pytest.raises(DatasetError, match=r'^worse; press more \(tactile train … --force writes it all the same\)$'):
        require_worth('worse', 'press more', forced=False, command='tactile train')
    require_worth('worse', 'press more', forced=True)
    require_worth('', 'press more', forced=False)


def test_a_tenth_of_what_the_mean_is_off_is_poor() -> None:
    assert poor(off(0.019, 0.49), off(0.2, 5.0)) == ''
    assert '0.0190 N and 3.000 mm off' in poor(off(0.019, 3.0), off(0.2, 5.0))
