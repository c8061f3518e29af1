"""A model that inverts the gel's response, in the node: what is no number, and what is not seen, is no force."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from feeding import START_NS, run

from tactile_nodes import conversions
from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.arguments import parse_arguments
from tactile_nodes.bus.protocol import Publisher
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.topics import Topic
from tactile_nodes.clock import SteppedClock
from tactile_nodes.messages import types
from tactile_nodes.model_file import find_model, load_model
from tactile_nodes.nodes.force_estimator import ForceEstimatorNode
from tactile_nodes.sensing.explain.measured.readout import ResponseReadout
from tactile_nodes.sensing.explain.splines import value_and_slopes

FORCE = types.ForceDistribution
Ask = Callable[[np.ndarray, float], types.ForceDistribution]


@pytest.fixture
def ask(
    bus: InProcessBus,
    clock: SteppedClock,
    listen: Callable[[Topic], Subscription],
    publisher: Callable[[Topic], Publisher],
) -> Ask:
    """What the shipped model says of 10x10 regions' motion and their confidence."""
    forces, source = listen(topics.FORCE_DISTRIBUTION), publisher(topics.FLOW_FEATURES)
    tested = ForceEstimatorNode(bus, parse_arguments(['--ros-args', '-p', 'model:=fast']), clock)

    def answer(values: np.ndarray, confidence: float) -> types.ForceDistribution:
        source.publish(
            types.FlowFeatures(
                header=conversions.header(START_NS, 'camera'), rows=10, cols=10, channels=2, encoding='cartesian_mean',
                values=values, confidence=np.full(100, confidence, np.float32), image_width=440, image_height=440,
                reference_id='0123456789ab',
            )
        )  # fmt: skip
        run(tested)
        received = forces.take()
        assert received is not None
        found: types.ForceDistribution = received.message
        return found

    return answer


def test_still_features_are_valid_and_no_contact(ask: Ask) -> None:
    force = ask(np.zeros(200, np.float32), 1.0)
    assert (force.status, force.reasons, force.in_contact, force.total) == (FORCE.STATUS_OK, 0, False, 0.0)


def test_features_that_are_no_numbers_are_invalid(ask: Ask) -> None:
    values = np.zeros(200, np.float32)
    values[111] = np.nan
    force = ask(values, 1.0)
    assert force.status == FORCE.STATUS_INVALID
    assert force.reasons & FORCE.REASON_NOT_FINITE
    assert not force.in_contact


def test_a_lens_that_is_covered_is_invalid_and_not_a_gel_at_rest(ask: Ask) -> None:
    force = ask(np.zeros(200, np.float32), 0.0)
    assert force.status == FORCE.STATUS_INVALID
    assert force.reasons & FORCE.REASON_LOW_CONFIDENCE
    assert not force.in_contact


def test_motion_of_all_regions_alike_is_unlike_any_press(ask: Ask) -> None:
    force = ask(np.full(200, 1.0, np.float32), 1.0)
    assert force.status == FORCE.STATUS_DEGRADED
    assert force.reasons & FORCE.REASON_UNLIKE_TRAINING


def noisy_press(number: int) -> np.ndarray:
    """The motion of 0.5 N near the middle of the gel, in four times the noise of the training; another each time."""
    readout = load_model(find_model('fast')).model.readout
    assert isinstance(readout, ResponseReadout)
    response, scaling = readout.response, readout.scaling
    made = value_and_slopes(response.axes, response.coefficients, (1.0, -2.0, 0.5))[0]
    inputs = readout.likeness.directions.T @ np.linalg.solve(readout.whitening.astype(float), made)
    inputs = inputs + 4 * np.random.default_rng(number).normal(size=inputs.shape)
    trusted = scaling.trusted[..., None] > 0
    values = np.where(trusted, inputs.reshape(scaling.mean.shape) / np.maximum(scaling.gain, 1e-6), 0) + scaling.mean
    return np.asarray(values, np.float32).reshape(-1)


@pytest.mark.parametrize('asked', [True, False])
def test_forces_in_noisy_pictures_are_averaged_unless_the_parameter_says_otherwise(
    bus: InProcessBus,
    clock: SteppedClock,
    listen: Callable[[Topic], Subscription],
    publisher: Callable[[Topic], Publisher],
    *,
    asked: bool,
) -> None:
    forces, source = listen(topics.FORCE_DISTRIBUTION), publisher(topics.FLOW_FEATURES)
    words = ['--ros-args', '-p', 'model:=fast', '-p', f'average_noise:={str(asked).lower()}']
    tested = ForceEstimatorNode(bus, parse_arguments(words), clock)
    for number in range(3):
        source.publish(
            types.FlowFeatures(
                header=conversions.header(START_NS + 16_000_000 * number, 'camera'), rows=10, cols=10, channels=2,
                encoding='cartesian_mean', values=noisy_press(number), confidence=np.ones(100, np.float32),
                image_width=440, image_height=440, reference_id='0123456789ab', reasons=FORCE.REASON_BLURRED,
            )
        )  # fmt: skip
        run(tested)
    received = [forces.take() for _ in range(3)]
    assert [each is not None and each.message.averaged > 0 for each in received] == [False, asked, asked]
