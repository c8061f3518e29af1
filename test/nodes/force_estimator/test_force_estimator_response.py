"""A model that inverts the gel's response, in the node: what is no number, and what is not seen, is no force."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from feeding import START_NS, came, given, run

from tactile_nodes import conversions
from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.protocol import Publisher
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.topics import Topic
from tactile_nodes.clock import SteppedClock
from tactile_nodes.messages import types
from tactile_nodes.nodes.force_estimator import ForceEstimatorNode

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
    tested = ForceEstimatorNode(bus, given('model:=fast'), clock)

    def answer(values: np.ndarray, confidence: float) -> types.ForceDistribution:
        source.publish(
            types.FlowFeatures(
                header=conversions.header(START_NS, 'camera'), rows=10, cols=10, channels=2, encoding='cartesian_mean',
                values=values, confidence=np.full(100, confidence, np.float32), image_width=440, image_height=440,
                reference_id='0123456789ab',
            )
        )  # fmt: skip
        run(tested)
        return came(forces)

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
