from __future__ import annotations

import dataclasses
import os
import subprocess
import sys

import numpy as np
import pytest

from tactile_nodes.errors import ModelError
from tactile_nodes.sensing.explain.model import FeatureLayout, ForceEstimator, ForceModel
from tactile_nodes.sensing.explain.network import (
    InputScaling,
    Mlp,
    NetworkReadout,
    TotalSpread,
    contact_position_mm,
    logistic,
)
from tactile_nodes.sensing.features import Features
from tactile_nodes.sensing.geometry import BinGrid


def scaling(rows: int = 2, cols: int = 2, channels: int = 1) -> InputScaling:
    shape = (rows, cols, channels)
    return InputScaling(np.zeros(shape, np.float32), np.ones(shape, np.float32), np.ones((rows, cols), np.float32))


def one_layer(output_scale_n: float = 1.0) -> ForceModel:
    """Four features that pass straight to four bins of 10 mm."""
    network = Mlp((np.eye(4, dtype=np.float32),), (np.zeros(4, np.float32),))
    layout = FeatureLayout('cartesian_mean', 2, 2, 1)
    bins = BinGrid(2, 2, 20.0, 20.0)
    return ForceModel(layout, bins, NetworkReadout(scaling(), network, bins, output_scale_n, TotalSpread(0.03, 0.04)))


def features(*values: float, confidence: float = 1.0) -> Features:
    array = np.array(values, np.float32).reshape(2, 2, 1)
    return Features('cartesian_mean', array, np.full((2, 2), confidence, np.float32))


def test_the_logistic_function_is_a_half_at_zero():
    np.testing.assert_allclose(logistic(np.array([0.0, 1.0, -200, 200], np.float32)), [0.5, 0.7310586, 0, 1], atol=1e-6)


def test_hidden_units_are_logistic_and_outputs_plain():
    network = Mlp(
        (np.array([[1.0, 1.0]], np.float32), np.array([[4.0]], np.float32)),
        (np.array([1.0], np.float32), np.array([-10.0], np.float32)),
    )
    # 4 * sigmoid(2 - 3 + 1) - 10 = 4 * 0.5 - 10
    assert network(np.array([2.0, -3.0], np.float32)).tolist() == [-8.0]


def test_the_sizes_of_the_papers_network_are_reported():
    sizes = (3200, 800, 400, 400, 81)
    pairs = list(zip(sizes[1:], sizes[:-1], strict=True))
    network = Mlp(
        tuple(np.zeros(pair, np.float32) for pair in pairs), tuple(np.zeros(n, np.float32) for n in sizes[1:])
    )
    assert network.sizes == sizes


def test_the_map_adds_up_to_the_total_and_shows_the_peak():
    result = ForceEstimator(one_layer(output_scale_n=0.5)).predict(features(0.0, 1.0, 2.0, 0.0))
    assert result.total_n == pytest.approx(1.5)
    np.testing.assert_allclose(result.normal_force_n, [[0, 0.5], [1, 0]])


@pytest.mark.parametrize(
    ('forces', 'contact_mm'),
    [((0, 0, 0, 1), (5.0, 5.0)), ((1, 1, 0, 0), (0.0, -5.0)), ((-1, -1, -0.5, -1), (-5.0, 5.0))],
    ids=['in one bin', 'in two neighbours alike', 'nowhere: in the strongest bin'],
)
def test_a_contact_is_where_the_force_is(forces: tuple[float, ...], contact_mm: tuple[float, float]):
    assert ForceEstimator(one_layer()).predict(features(*forces)).contact_mm == contact_mm


def test_bins_far_from_the_peak_do_not_move_the_contact():
    forces = np.zeros((9, 9), np.float32)
    forces[2, 2], forces[8, 8] = 1.0, 0.9
    centres = BinGrid().centres_mm
    assert contact_position_mm(forces, centres) == tuple(centres[2, 2])


def test_regions_without_markers_do_not_reach_the_network():
    result = ForceEstimator(one_layer()).predict(features(9, 9, 9, 9, confidence=0.4))
    assert result.total_n == 0
    assert result.confidence == 0


def test_confidence_is_the_share_of_learned_regions_that_hold_markers():
    model = one_layer()
    trusted = np.array([[1, 1], [0, 0]], np.float32)
    inputs = dataclasses.replace(model.readout.scaling, trusted=trusted)
    model = dataclasses.replace(model, readout=dataclasses.replace(model.readout, scaling=inputs))
    seen = features(1, 1, 1, 1)
    seen.confidence[0, 0] = 0
    assert ForceEstimator(model).predict(seen).confidence == 0.5


def test_hidden_units_may_be_rectified():
    network = Mlp(
        (np.array([[1.0], [-1.0]], np.float32), np.array([[2.0, 3.0]], np.float32)),
        (np.zeros(2, np.float32), np.array([1.0], np.float32)),
        'relu',
    )
    assert network(np.array([5.0], np.float32)).tolist() == [11.0]
    assert network(np.array([-5.0], np.float32)).tolist() == [16.0]


def test_the_spread_of_the_total_grows_with_it():
    # hypot(0.03, 0.04 * 1) = 0.05
    assert ForceEstimator(one_layer()).predict(features(0, 0, 1, 0)).total_sigma_n == pytest.approx(0.05)


@pytest.mark.parametrize(
    ('encoding', 'rows', 'said'),
    [
        ('cartesian_mean', 3, '2x2 regions of cartesian_mean .* but the features are 3x2 regions'),
        ('polar_mean', 2, 'polar_mean'),
    ],
)
def test_features_of_another_layout_are_refused_with_both(encoding: str, rows: int, said: str):
    other = Features(encoding, np.zeros((rows, 2, 1), np.float32), np.ones((rows, 2), np.float32))
    with pytest.raises(ModelError, match=said):
        ForceEstimator(one_layer()).predict(other)


def test_a_network_that_does_not_fit_its_bins_is_refused():
    with pytest.raises(ModelError, match='4 inputs and 4 outputs does not fit 4 features and 9 bins'):
        dataclasses.replace(one_layer(), bins=BinGrid(3, 3))


PROGRAM = """
import numpy as np, hashlib
from tactile_nodes.sensing.explain.network import Mlp
random = np.random.default_rng(0)
sizes = (3200, 800, 400, 400, 81)
weights = tuple(random.normal(0, 0.03, pair).astype(np.float32) for pair in zip(sizes[1:], sizes[:-1]))
network = Mlp(weights, tuple(np.zeros(n, np.float32) for n in sizes[1:]))
inputs = random.normal(size=3200).astype(np.float32)
print(hashlib.sha256(network(inputs).tobytes()).hexdigest())
"""


@pytest.mark.skipif(
    np.__version__ < '2', reason='OpenBLAS 0.3.23 of numpy 1.26 splits long dot products; launches set one thread'
)
def test_the_papers_network_gives_the_same_bits_in_any_process_and_number_of_threads():
    answers = set()
    for threads in ('1', '2', '2'):
        environment = {**os.environ, 'OPENBLAS_NUM_THREADS': threads}
        run = subprocess.run(
            [sys.executable, '-c', PROGRAM], env=environment, check=True, capture_output=True, text=True
        )
        answers.add(run.stdout)
    assert len(answers) == 1
