"""What the state of the calibration does to every force: by the stamp of its image, whenever the message came."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from feeding import START_NS, came, features, given, run

from tactile_nodes import conversions, model_file
from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.protocol import Publisher
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.topics import Topic
from tactile_nodes.clock import SteppedClock
from tactile_nodes.messages import time_from_ns, types
from tactile_nodes.nodes.force_estimator import ForceEstimatorNode

Listen = Callable[[Topic], Subscription]
Advertise = Callable[[Topic], Publisher]
FORCE, STATE = types.ForceDistribution, types.CalibrationState
S = 1_000_000_000


@pytest.fixture
def judged(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise, small_model: Path
) -> Callable[[list[types.CalibrationState], int], types.ForceDistribution]:
    forces, source, states = (
        listen(topics.FORCE_DISTRIBUTION),
        publisher(topics.FLOW_FEATURES),
        publisher(topics.CALIBRATION_STATE),
    )
    tested = ForceEstimatorNode(bus, given(f'model:={small_model}'), clock)

    def force(published: list[types.CalibrationState], stamp_ns: int) -> types.ForceDistribution:
        for each in published:
            states.publish(each)
            run(tested)
        source.publish(features(stamp_ns))
        run(tested)
        return came(forces)

    return force


def state(level: int, from_ns: int, reasons: int = 0) -> types.CalibrationState:
    return STATE(level=level, reasons=reasons, valid_from=time_from_ns(from_ns))


@pytest.mark.parametrize(
    ('level', 'status', 'reasons'),
    [
        (STATE.LEVEL_VALID, FORCE.STATUS_OK, 0),
        (STATE.LEVEL_UNKNOWN, FORCE.STATUS_OK, 0),
        (STATE.LEVEL_AGEING, FORCE.STATUS_DEGRADED, FORCE.REASON_CALIBRATION_AGEING),
        (STATE.LEVEL_INVALID, FORCE.STATUS_INVALID, FORCE.REASON_CALIBRATION_INVALID),
    ],
)
def test_an_ageing_calibration_degrades_a_force_and_an_invalid_one_voids_it(
    judged: Callable[..., types.ForceDistribution], level: int, status: int, reasons: int
) -> None:
    force = judged([state(level, START_NS)], START_NS)
    assert (force.status, force.reasons) == (status, reasons)
    assert force.in_contact  # what is read is still published


def test_a_moved_picture_is_foreign_motion(judged: Callable[..., types.ForceDistribution]) -> None:
    force = judged([state(STATE.LEVEL_INVALID, START_NS, STATE.REASON_PICTURE_MOVED)], START_NS)
    assert force.reasons == FORCE.REASON_CALIBRATION_INVALID | FORCE.REASON_FOREIGN_MOTION


def test_a_state_counts_from_its_stamp_on_however_early_it_came(
    judged: Callable[..., types.ForceDistribution],
) -> None:
    states = [state(STATE.LEVEL_AGEING, START_NS + S), state(STATE.LEVEL_VALID, START_NS + 3 * S)]
    found = [judged(states if at == 0 else [], START_NS + at * S).status for at in range(5)]
    ok, degraded = FORCE.STATUS_OK, FORCE.STATUS_DEGRADED
    assert found == [ok, degraded, degraded, ok, ok]


def test_the_rest_image_of_the_model_file_is_reported_to_those_who_compare_with_it(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, small_model: Path, tmp_path: Path
) -> None:
    loaded = model_file.load_model(small_model)
    picture = np.random.default_rng(0).integers(0, 255, (160, 160), np.uint8)
    model_id = model_file.save_model(tmp_path / 'with.safetensors', loaded.model, loaded.card, picture)
    shown = listen(topics.CALIBRATION_IMAGE)
    ForceEstimatorNode(bus, given(f'model:={tmp_path}/with.safetensors'), clock)
    received = came(shown)
    np.testing.assert_array_equal(conversions.image_array(received), picture)
    assert received.header.frame_id == model_id
