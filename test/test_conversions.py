"""Arrays to messages and back, by hand-calculated values."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tactile_nodes import conversions, messages
from tactile_nodes.errors import ImageError, MessageError
from tactile_nodes.messages import types
from tactile_nodes.sensing.explain.reading import Contact
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.simulation.scene import Truth

HEAD = types.Header(stamp=types.Time(sec=5, nanosec=6), frame_id='camera')


def test_image_survives_the_trip_through_bytes() -> None:
    image = np.arange(12, dtype=np.uint8).reshape(3, 4)
    data = messages.encode(conversions.image_message(image, HEAD))
    back = messages.decode(data, 'sensor_msgs/msg/Image')
    assert (back.height, back.width, back.step, back.encoding) == (3, 4, 4, 'mono8')
    assert (conversions.image_array(back) == image).all()


def test_image_message_does_not_freeze_the_buffer_it_was_cut_from() -> None:
    whole = np.zeros((4, 4), np.uint8)
    message = conversions.image_message(whole[1:3, 1:3], HEAD)
    message.data.flags.writeable = False  # as publishing does
    whole[1, 1] = 7
    assert message.data[0] == 0


def test_rows_with_padding_are_read_by_their_step() -> None:
    padded = np.array([1, 2, 99, 3, 4, 99], np.uint8)
    message = types.Image(height=2, width=2, encoding='mono8', step=3, data=padded)
    assert conversions.image_array(message).tolist() == [[1, 2], [3, 4]]


def test_colour_becomes_luma_by_its_order_of_channels() -> None:
    red = types.Image(height=1, width=1, encoding='rgb8', step=3, data=np.array([255, 0, 0], np.uint8))
    # ITU-R BT.601: 0.299 * 255 = 76.2
    assert conversions.image_array(red)[0, 0] == 76


@pytest.mark.parametrize(
    ('message', 'sentence'),
    [
        (types.Image(height=1, width=1, encoding='32FC1', step=4, data=np.zeros(4, np.uint8)), "encoding '32FC1'"),
        (types.Image(height=2, width=2, encoding='mono8', step=2, data=np.zeros(3, np.uint8)), 'has 3 bytes'),
        (types.Image(height=1, width=2, encoding='bgr8', step=2, data=np.zeros(6, np.uint8)), 'step of 2'),
    ],
)
def test_image_that_cannot_be_read_is_refused_with_a_reason(message: types.Image, sentence: str) -> None:
    with pytest.raises(ImageError, match=sentence):
        conversions.image_array(message)


def test_features_of_the_wrong_length_are_refused() -> None:
    message = types.FlowFeatures(rows=2, cols=2, channels=2, values=np.zeros(7, np.float32))
    with pytest.raises(MessageError, match='2x2x2 have 7 values'):
        conversions.features_array(message)


def test_force_fields_are_in_metres_and_newtons() -> None:
    forces = np.zeros((9, 9), np.float32)
    forces[0, 1] = 0.25
    fields = conversions.force_fields(forces, BinGrid(), [Contact(-14.2, 3.0, 0.25, 0.05, 0.003)])
    assert fields['bin_width'] == pytest.approx(0.032 / 9)
    assert (fields['origin'].x, fields['origin'].y) == (-0.016, -0.016)
    assert (fields['total'], fields['peak']) == (0.25, 0.25)
    assert fields['normal_force'][1] == np.float32(0.25)
    assert fields['contact'].x == pytest.approx(-0.0142)
    assert fields['contacts'][0].position_sigma == pytest.approx(5e-5)
    assert (fields['contacts'][0].force, fields['contacts'][0].force_sigma) == (0.25, 0.003)


def test_without_contact_the_position_is_nan() -> None:
    fields = conversions.force_fields(np.zeros((9, 9), np.float32), BinGrid())
    assert not fields['in_contact']
    assert all(math.isnan(value) for value in (fields['contact'].x, fields['contact'].y, fields['contact'].z))


def test_wrench_pushes_against_z_and_turns_about_the_middle() -> None:
    forces = np.zeros((9, 9), np.float32)
    forces[4, 8] = 2.0  # row 4: y = 0; column 8: x = 14.222 mm
    force = types.ForceDistribution(
        header=HEAD, **conversions.force_fields(forces, BinGrid(), [Contact(14.2, 0.0, 2.0)])
    )
    wrench = conversions.wrench_message(force).wrench
    assert wrench.force.z == -2.0
    assert wrench.torque.x == pytest.approx(0.0, abs=1e-12)
    # r x F = (x, 0, 0) x (0, 0, -2) = (0, 2 x, 0), x = 14.222 mm
    assert wrench.torque.y == pytest.approx(2 * 0.032 * 4 / 9)


@pytest.mark.parametrize(('by_place', 'explained'), [(False, 'EXPLANATION_TIPS'), (True, 'EXPLANATION_FIELD')])
def test_the_truth_says_where_its_forces_are_and_that_it_took_no_time(by_place: bool, explained: str) -> None:
    """All in the bin of its centre for a tip; no camera, flow or model was at work."""
    shear_n = np.full((1, 1, 2), (0.5, -0.25), np.float32)
    truth = Truth(np.ones((1, 1), np.float32), 1.0, (0.0, 0.0), True, shear_n, 2.0, by_place)
    force = types.ForceDistribution(**conversions.truth_fields(truth, BinGrid(1, 1)))
    assert force.explanation == getattr(force, explained)
    assert (force.contacts[0].shear_x, force.contacts[0].shear_y, force.contacts[0].torsion) == (0.5, -0.25, 0.002)
    assert all(math.isnan(getattr(force.stages, name)) for name in ('acquire', 'flow', 'features', 'predict'))
