"""The network's readout: what goes in, what it states of itself, what it refuses."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from tactile_nodes.errors import ModelError
from tactile_nodes.sensing.explain.likeness import Likeness
from tactile_nodes.sensing.explain.network import (
    CalibrationLayer,
    InputScaling,
    Mlp,
    NetworkReadout,
    TotalSpread,
)
from tactile_nodes.sensing.geometry import BinGrid

BINS = BinGrid(1, 2, 20.0, 10.0)
SCALING = InputScaling(
    mean=np.full((1, 2, 1), 1, np.float32),
    gain=np.full((1, 2, 1), 2, np.float32),
    trusted=np.array([[1, 1]], np.float32),
)
NETWORK = Mlp((np.eye(2, dtype=np.float32),), (np.zeros(2, np.float32),))
READER = NetworkReadout(SCALING, NETWORK, BINS, output_scale_n=0.5, spread=TotalSpread(0.03, 0.04))


def values(*numbers: float) -> np.ndarray:
    return np.array(numbers, np.float32).reshape(1, 2, 1)


def sure(*numbers: float) -> np.ndarray:
    return np.array([numbers or (1.0, 1.0)], np.float32)


def test_features_are_scaled_and_outputs_have_their_unit() -> None:
    reading = READER.read(values(1.5, 2.0), sure())
    # (1.5 - 1) * 2 * 0.5 N and (2 - 1) * 2 * 0.5 N
    np.testing.assert_allclose(reading.normal_force_n, [[0.5, 1.0]])
    contact = reading.contacts[0]
    assert contact.force_n == pytest.approx(1.5)
    assert contact.x_mm == pytest.approx((0.5 * -5 + 1.0 * 5) / 1.5)


def test_a_layer_of_the_identity_changes_no_bit_of_features_that_are_not_negative() -> None:
    layer = CalibrationLayer.of_change(np.zeros((2, 2), np.float16), np.zeros(2, np.float32))
    for shown in (values(0.1, 6.28), values(0.0, 1e-7), values(3.3, 0.7)):
        before = READER.read(shown, sure())
        after = dataclasses.replace(READER, layer=layer).read(shown, sure())
        assert after.normal_force_n.tobytes() == before.normal_force_n.tobytes()


def test_a_layer_acts_on_features_before_they_are_scaled() -> None:
    change = np.array([[0, 0.5], [0, -2]], np.float16)
    layered = dataclasses.replace(READER, layer=CalibrationLayer.of_change(change, np.array([0.25, 0], np.float32)))
    # 2 + 0.5 * 1 + 0.25 = 2.75 and max(0, 1 - 2 * 1) = 0, then (2.75 - 1) * 2 and (0 - 1) * 2.
    np.testing.assert_allclose(layered.inputs(values(2.0, 1.0), sure()), [3.5, -2.0])
    assert layered.parameter_count == READER.parameter_count + 6


def test_a_layer_cuts_off_what_is_negative() -> None:
    layer = CalibrationLayer.of_change(np.zeros((2, 2), np.float16), np.zeros(2, np.float32))
    assert layer(values(-0.5, 2.0)).reshape(-1).tolist() == [0.0, 2.0]


def test_behind_a_layer_an_infinite_feature_gives_no_force_either() -> None:
    layer = CalibrationLayer.of_change(np.array([[-2, 0], [0, 0]], np.float16), np.zeros(2, np.float32))
    reading = dataclasses.replace(READER, layer=layer).read(values(np.inf, 1.0), sure())
    assert np.isnan(reading.normal_force_n).all()


def test_an_infinite_feature_gives_no_force_that_looks_like_one() -> None:
    hidden = np.array([[1.0, 0.0]], np.float32), np.array([[1.0], [1.0]], np.float32)
    network = Mlp(hidden, (np.zeros(1, np.float32), np.zeros(2, np.float32)))  # logistic units saturate at 1
    reading = dataclasses.replace(READER, network=network).read(values(np.inf, 1.0), sure())
    assert np.isnan(reading.normal_force_n).all()


def test_a_region_that_is_lost_says_nothing_and_counts_as_missing() -> None:
    confidence = sure(0.4, 1.0)
    np.testing.assert_allclose(READER.read(values(50, 2.0), confidence).normal_force_n, [[0.0, 1.0]])
    assert SCALING.missing(confidence).tolist() == [[True, False]]


def test_a_region_that_never_held_markers_is_silent_but_not_missing() -> None:
    scaling = dataclasses.replace(SCALING, trusted=np.array([[0, 1]], np.float32))
    assert scaling.missing(sure(0.0, 1.0)).tolist() == [[False, False]]
    np.testing.assert_allclose(scaling(values(50, 2.0), sure()).reshape(-1), [0.0, 2.0])


def test_a_frame_or_a_batch_are_scaled_alike() -> None:
    batch = np.stack([values(1, 2), values(3, 4)])
    np.testing.assert_array_equal(SCALING(batch, sure())[1], SCALING(batch[1], sure()))


def test_the_total_has_a_standard_deviation_and_the_place_none() -> None:
    reading = READER.read(values(2.0, 1.0), sure())
    assert reading.total_sigma_n == pytest.approx(0.05)  # hypot(0.03, 0.04 * 1)
    assert reading.contacts[0].sigma_n == pytest.approx(0.05)
    assert math.isnan(reading.contacts[0].sigma_mm)


def test_a_readout_without_limits_knows_of_no_likeness() -> None:
    assert math.isnan(READER.read(values(1, 1), sure()).unlikeness)
    assert math.isnan(TotalSpread().sigma_n(1.0))


def test_unlikeness_is_that_of_the_scaled_inputs() -> None:
    likeness = Likeness(np.zeros(2, np.float32), np.eye(1, 2, dtype=np.float32), floor=1.0, share=0.0)
    reader = dataclasses.replace(READER, likeness=likeness)
    # The second input is (4 - 1) * 2 = 6, the first is explained: the root of 36 / 2.
    assert reader.read(values(9, 4), sure()).unlikeness == pytest.approx(math.sqrt(18), rel=1e-4)


def test_all_weights_and_biases_count_as_parameters() -> None:
    assert READER.parameter_count == 6


@pytest.mark.parametrize(('count', 'bins'), [(3, BINS), (2, BinGrid(3, 3))])
def test_features_or_bins_of_another_size_are_refused(count: int, bins: BinGrid) -> None:
    READER.require_fit(2, BINS)
    with pytest.raises(ModelError, match='a network of 2 inputs and 2 outputs does not fit'):
        READER.require_fit(count, bins)
