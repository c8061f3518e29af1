"""How much of the known gel's correction of forces is carried to another gel."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tactile_nodes.learning.axisymmetric_calibration import Judged
from tactile_nodes.learning.transfer_correction import EXPECTED, LARGEST, carried_share
from tactile_nodes.sensing.axisymmetric import AxisymmetricResponse
from tactile_nodes.sensing.axisymmetric_readout import AxisymmetricReadout, Correction
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.sensing.network import InputScaling
from tactile_nodes.sensing.response import Fit

REACH_MM, HARDEST_N, SOFTNESS = 13.0, 1.0, 0.8
NOTHING = Correction.none(REACH_MM, HARDEST_N)
TWO_PERCENT_AT_THE_RIM = dataclasses.replace(NOTHING, terms=np.zeros_like(NOTHING.terms))
TWO_PERCENT_AT_THE_RIM.terms[3, 2] = 0.02  # times the square of x over the reach


def judged(missing: np.ndarray, found: np.ndarray) -> Judged:
    """Presses found at places and forces, of which some force is missing each."""
    blank = np.zeros((1, 24, 6)), 1, HARDEST_N, np.zeros((1, 2)), np.zeros((1, 2, 2))
    response = AxisymmetricResponse(*blank, softness=SOFTNESS)
    scaling = InputScaling(np.zeros((1, 1, 2), np.float32), np.ones((1, 1, 2), np.float32), np.ones((1, 1), np.float32))
    readout = AxisymmetricReadout(scaling, response, np.full(8, 0.05), NOTHING, BinGrid())
    fits = [Fit(each[None], np.eye(3), 1.0) for each in found]
    return Judged(readout, found + np.outer(missing, [0, 0, 1]), fits)


def presses(count: int) -> np.ndarray:
    random = np.random.default_rng(1)
    return np.column_stack([random.uniform(-REACH_MM, REACH_MM, (count, 2)), random.uniform(0.1, 1.2, count)])


@pytest.mark.parametrize('share', [0.0, 0.5, 1.0])
def test_the_share_that_held_out_presses_ask_for_is_carried(share: float) -> None:
    found = presses(80)
    missing = share * 0.02 * (found[:, 0] / REACH_MM) ** 2 * found[:, 2]
    halves = [judged(missing[part], found[part]) for part in (slice(0, 40), slice(40, 80))]
    assert carried_share(TWO_PERCENT_AT_THE_RIM, halves) == pytest.approx(share, abs=0.01)


def test_few_presses_that_contradict_each_other_leave_what_is_expected_of_any_gel() -> None:
    """On average they ask for a third of it, 0.005 N of 0.0136 N, and each is off by more than all of that."""
    found = np.array([[12.0, y, 0.8] for y in (-9.0, -3.0, 3.0, 9.0)])
    missing = np.array([0.02, -0.02, 0.03, -0.01])
    assert carried_share(TWO_PERCENT_AT_THE_RIM, [judged(missing, found)]) == pytest.approx(EXPECTED, abs=0.2)


def test_little_more_than_the_whole_correction_is_carried() -> None:
    found = presses(80)
    missing = 3 * 0.02 * (found[:, 0] / REACH_MM) ** 2 * found[:, 2]
    assert carried_share(TWO_PERCENT_AT_THE_RIM, [judged(missing, found)]) == LARGEST


def test_a_gel_without_a_correction_has_none_to_carry() -> None:
    found = presses(20)
    assert carried_share(NOTHING, [judged(0.01 * found[:, 2], found)]) == 0.0
