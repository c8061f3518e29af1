"""A novelty check beside a network: what it calls unlike the training, and whose word counts in which picture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from responding import BINS, components, features, readout

from tactile_nodes.errors import ModelError
from tactile_nodes.pipeline.judge_force import FORCE, judged_alone
from tactile_nodes.sensing.explain.likeness import Likeness
from tactile_nodes.sensing.explain.model import FeatureLayout, ForceEstimator, ForceModel
from tactile_nodes.sensing.explain.network import Mlp, NetworkReadout, TotalSpread
from tactile_nodes.sensing.explain.novelty_check import NoveltyCheck
from tactile_nodes.sensing.features import Features, as_motion

NOVELTY_CHECK = NoveltyCheck(readout(1), 'cartesian_mean')
SURE = np.ones((6, 6), np.float32)
SPREAD = TotalSpread(0.03, 0.0)


def network(says_n: float, **more: object) -> NetworkReadout:
    """One that says so much of whatever it is shown, all in one bin."""
    bias = np.zeros(BINS.count, np.float32)
    bias[40] = says_n
    layer = np.zeros((BINS.count, 72), np.float32)
    made = NetworkReadout(
        NOVELTY_CHECK.readout.scaling, Mlp((layer,), (bias,)), BINS, spread=SPREAD, novelty_check=NOVELTY_CHECK
    )
    return replace(made, **more)  # type: ignore[arg-type]


def shown(*contacts: tuple[float, float, float]) -> np.ndarray:
    """Features of which the novelty check sees these contacts (x, y, N)."""
    return features(NOVELTY_CHECK.readout, components(NOVELTY_CHECK.readout.response, *contacts))


def test_magnitude_and_angle_are_motion_along_x_and_y():
    polar = np.array([[[5.0, 0.927295], [2.0, np.pi], [0.0, 4.0]]], np.float32)
    np.testing.assert_allclose(as_motion('polar_mean', polar), [[[3, 4], [-2, 0], [0, 0]]], atol=1e-5)


def test_motion_along_x_and_y_is_motion_already():
    values = shown((1.0, 2.0, 0.5))
    assert as_motion('cartesian_mean', values) is values


def test_a_force_that_the_novelty_check_finds_too_is_like_the_training():
    reading = network(0.5).read(shown((2.0, -3.0, 0.5)), SURE)
    assert reading.unlikeness < 0.5


@pytest.mark.parametrize(('says_n', 'unlike'), [(0.5519, 0), (0.5521, 1), (0.3, 1)])
def test_a_force_off_by_more_than_the_root_of_three_of_its_uncertainty_is_unlike_the_training(says_n, unlike):
    """0.03 N times 1.7320 is 0.05196 N; the contact of 0.5 N is found to 1e-5 N."""
    reading = network(says_n).read(shown((2.0, -3.0, 0.5)), SURE)
    assert (reading.unlikeness > 1) == unlike
    assert reading.unlikeness == pytest.approx(abs(says_n - 0.5) / (3**0.5 * 0.03), rel=2e-3)


def test_two_contacts_are_unlike_the_training_whatever_force_is_said():
    pair = shown((-4.0, 0.0, 0.5), (4.0, 1.0, 0.5))
    alone = NOVELTY_CHECK.read(pair, SURE)
    assert alone.unlikeness > 1
    assert network(alone.contacts[0].force_n).read(pair, SURE).unlikeness == alone.unlikeness


def test_forces_in_a_usual_picture_are_the_networks_to_the_bit():
    values = shown((2.0, -3.0, 0.5))
    alone = network(0.9, novelty_check=None).read(values, SURE)
    beside = network(0.9).read(values, SURE)
    assert beside.normal_force_n.tobytes() == alone.normal_force_n.tobytes()
    (contact,), (expected,) = beside.contacts, alone.contacts
    assert repr(contact) == repr(expected)  # its deviation of the place is NaN, which equals nothing
    assert beside.total_sigma_n == alone.total_sigma_n


def test_what_directions_leave_over_counts_beside_the_novelty_check():
    directions = np.eye(72, dtype=np.float32)[:1]
    strict = Likeness(np.zeros(72, np.float32), directions, 1e-3, 0.0)
    values = shown((2.0, -3.0, 0.5))
    reading = network(0.5, likeness=strict).read(values, SURE)
    assert reading.unlikeness == strict.unlikeness(values.reshape(-1)) > 1


def test_of_no_motion_no_force_is_reported_as_sure_as_the_network_is_of_none():
    """It says 0.3 N there, 10 times its 0.03 N, and 0.5 N / N more of that: none of it is reported."""
    sure_of_none = network(0.3, spread=TotalSpread(0.03, 0.5))
    model = ForceModel(FeatureLayout('cartesian_mean', 6, 6, 2), BINS, sure_of_none)
    still = Features('cartesian_mean', np.zeros((6, 6, 2), np.float32), SURE)
    found = ForceEstimator(model).at_rest(still)
    assert (found.total_n, found.unlikeness) == (0.0, 0.0)
    assert (found.total_sigma_n, found.nominal_n) == (pytest.approx(0.03), pytest.approx(0.03))
    assert judged_alone(found).status == FORCE.STATUS_OK


def test_a_novelty_check_of_other_features_is_refused():
    with pytest.raises(ModelError, match='does not fit'):
        network(0.5).novelty_check.require_fit(50, BINS)  # type: ignore[union-attr]
