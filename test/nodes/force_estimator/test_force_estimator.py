"""Features in, force out: stamps, provenance, status."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from feeding import START_NS, came, features, given, run, taken

from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.arguments import parse_arguments
from tactile_nodes.bus.protocol import Publisher
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.topics import Topic
from tactile_nodes.clock import SteppedClock
from tactile_nodes.errors import ConfigurationError, ModelError
from tactile_nodes.messages import stamp_ns, types
from tactile_nodes.nodes.force_estimator import ForceEstimatorNode
from tactile_nodes.paths import share_directory

Listen = Callable[[Topic], Subscription]
Advertise = Callable[[Topic], Publisher]
FORCE = types.ForceDistribution


def node(bus: InProcessBus, clock: SteppedClock, model: Path | str, *parameters: str) -> ForceEstimatorNode:
    return ForceEstimatorNode(bus, given(f'model:={model}', *parameters), clock)


@pytest.fixture
def chain(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise, small_model: Path
) -> Callable[[types.FlowFeatures], types.ForceDistribution]:
    forces, source = listen(topics.FORCE_DISTRIBUTION), publisher(topics.FLOW_FEATURES)
    tested = node(bus, clock, small_model)

    def answer(message: types.FlowFeatures) -> types.ForceDistribution:
        source.publish(message)
        run(tested)
        return came(forces)

    return answer


def test_pictures_of_another_size_than_the_models_are_reported_once_with_what_to_do(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise, small_model: Path
) -> None:
    logs, source = listen(topics.ROSOUT), publisher(topics.FLOW_FEATURES)
    tested = node(bus, clock, small_model)
    for side in (200, 200, 160):
        source.publish(features(side=side))
        run(tested)
    lines = [each.msg for each in taken(logs)]
    misfit, fits = [line for line in lines if line.startswith('pictures: ')]
    assert misfit == (
        'pictures: they have 200x200 pixels, but model small was trained on 160x160 pixels; '
        'set the crop of camera or flow_features, or choose a model of that size'
    )
    assert fits == 'pictures: they fit the model'


def test_force_says_when_where_and_with_what(chain: Callable[[types.FlowFeatures], types.ForceDistribution]) -> None:
    force = chain(features())
    assert stamp_ns(force.header.stamp) == START_NS
    assert force.header.frame_id == 'gel_surface'
    assert force.total == pytest.approx(0.5)
    assert force.normal_force[5] == np.float32(0.5)
    assert force.in_contact
    # All of the force is in the bin whose centre is (10, 0) mm.
    assert (force.contact.x, force.contact.y) == pytest.approx((0.010, 0.0))
    assert force.status == FORCE.STATUS_OK
    provenance = force.provenance
    assert (provenance.model, provenance.gel, provenance.reference_id) == ('small', 'gel of the test', '0123456789ab')
    assert len(provenance.model_id) == 12


def test_an_untouched_frame_is_no_force_whatever_the_model_makes_of_no_motion(
    chain: Callable[[types.FlowFeatures], types.ForceDistribution],
) -> None:
    still = dataclasses.replace(features(), untouched=True)
    force = chain(still)
    assert (force.total, force.peak, force.in_contact) == (0.0, 0.0, False)
    assert not np.asarray(force.normal_force).any()
    assert (force.status, force.reasons) == (FORCE.STATUS_OK, 0)
    assert chain(features()).total == pytest.approx(0.5)


@pytest.mark.parametrize(
    ('message', 'status', 'reason'),
    [
        (features(reasons=FORCE.REASON_DARK_IMAGE), FORCE.STATUS_INVALID, FORCE.REASON_DARK_IMAGE),
        (features(side=240), FORCE.STATUS_INVALID, FORCE.REASON_OTHER_IMAGE),
        (features(confidence=0.1), FORCE.STATUS_DEGRADED, FORCE.REASON_LOW_CONFIDENCE),
    ],
)
def test_status_says_why_the_numbers_are_not_to_be_trusted(
    chain: Callable[[types.FlowFeatures], types.ForceDistribution],
    message: types.FlowFeatures,
    status: int,
    reason: int,
) -> None:
    force = chain(message)
    assert (force.status, force.reasons) == (status, reason)
    assert force.in_contact == (status != FORCE.STATUS_INVALID)


def test_wrench_goes_with_every_force(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise, small_model: Path
) -> None:
    wrenches, source, tested = listen(topics.WRENCH), publisher(topics.FLOW_FEATURES), node(bus, clock, small_model)
    source.publish(features())
    run(tested)
    received = came(wrenches)
    assert received.wrench.force.z == pytest.approx(-0.5)
    assert stamp_ns(received.header.stamp) == START_NS


def test_no_wrench_is_made_that_nobody_takes(
    bus: InProcessBus, clock: SteppedClock, publisher: Advertise, listen: Listen, small_model: Path
) -> None:
    source, tested = publisher(topics.FLOW_FEATURES), node(bus, clock, small_model)
    for _ in range(2):
        source.publish(features())
        run(tested)
    wrenches = listen(topics.WRENCH)
    source.publish(features())
    run(tested)
    received = wrenches.take()
    assert received is not None and received.sequence == 1


def test_features_for_another_model_are_reported_and_do_not_end_the_node(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise, small_model: Path
) -> None:
    forces, source = listen(topics.FORCE_DISTRIBUTION), publisher(topics.FLOW_FEATURES)
    tested = node(bus, clock, small_model)
    source.publish(features(rows=5))
    run(tested)
    assert forces.take() is None
    errors = [status.message for status in tested.diagnostics.message(0).status if status.level == 2]
    assert len(errors) == 1
    assert '4x4 regions' in errors[0]
    assert '5x4 regions' in errors[0]
    source.publish(features())
    run(tested)
    assert forces.take() is not None


def test_missing_model_names_those_that_ship(bus: InProcessBus, clock: SteppedClock) -> None:
    with pytest.raises(ModelError, match=r"no model 'none'.*shipped model"):
        node(bus, clock, 'none')


def test_a_typo_in_its_own_block_is_an_error(bus: InProcessBus, clock: SteppedClock) -> None:
    with pytest.raises(ConfigurationError, match="unknown parameter 'modell'"):
        ForceEstimatorNode(bus, parse_arguments(['--ros-args', '-p', 'force_estimator:modell:=x']), clock)


def test_forces_have_the_frame_of_the_described_sensor_unless_a_parameter_names_one(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise, small_model: Path, tmp_path: Path
) -> None:
    (tmp_path / 'mine.yaml').write_text('image: {crop: 160}\nframe: {id: left_finger}\n')
    forces, source = listen(topics.FORCE_DISTRIBUTION), publisher(topics.FLOW_FEATURES)
    tested = node(bus, clock, small_model, f'sensor:={tmp_path}/mine.yaml')
    for frame_id, expected in (('', 'left_finger'), ('skin', 'skin')):
        tested._parameters.change({'frame_id': frame_id})
        source.publish(features())
        run(tested)
        received = came(forces)
        assert received.header.frame_id == expected


@pytest.mark.parametrize(
    ('model', 'sensor', 'cause'),
    [
        ('field', 'digit_like', 'reads images of 440x440, and this sensor gives 240x320'),
        ('field', 'wide', 'it was made from the description simulated'),
        ('fast', 'digit_like', 'reads images of 440x440, and this sensor gives 240x320'),
    ],
)
def test_a_model_of_another_sensor_is_refused_with_the_command_that_makes_one(
    bus: InProcessBus, clock: SteppedClock, tmp_path: Path, model: str, sensor: str, cause: str
) -> None:
    """The second reads pictures of the same size, and was made of a gel of 32 mm."""
    if sensor == 'wide':
        (tmp_path / 'wide.yaml').write_text('name: wide\ngel: {width_mm: 30.0}\n')
        sensor = str(tmp_path / 'wide.yaml')
    made = f'{Path(sensor).stem}.safetensors'
    with pytest.raises(ModelError) as caught:
        node(bus, clock, model, f'sensor:={sensor}')
    assert cause in str(caught.value)
    assert f'`tactile calibrate --sensor {sensor} --model field -o {made}` and start with model:={made}' in str(
        caught.value
    )


def test_a_model_that_is_older_than_the_description_says_so_for_as_long_as_it_is_used(
    bus: InProcessBus, clock: SteppedClock, tmp_path: Path
) -> None:
    text = (share_directory() / 'config/sensors/simulated.yaml').read_text(encoding='utf-8')
    reports = []
    for focal in ('290.0', '280.0'):
        (tmp_path / 'mine.yaml').write_text(text.replace('focal_px_per_rad: 290.0', f'focal_px_per_rad: {focal}'))
        tested = node(bus, clock, 'field', f'sensor:={tmp_path}/mine.yaml')
        reports += [each for each in tested.diagnostics.message(0).status if each.name.endswith(': model')]
        tested.close()
    assert [each.level for each in reports] == [0, 1]
    assert 'has changed' not in reports[0].message
    assert reports[1].message.startswith('field (')
    assert 'mine.yaml has changed since model field was made' in reports[1].message


@pytest.mark.parametrize('model', ['field', 'fast'])
def test_models_of_the_simulated_sensor_are_taken_for_it(bus: InProcessBus, clock: SteppedClock, model: str) -> None:
    assert node(bus, clock, model, 'sensor:=simulated').params.model == model
