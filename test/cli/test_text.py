"""Messages as text."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes.cli.running.text import Shown, field_of, to_csv, to_python, to_yaml
from tactile_nodes.errors import MessageError
from tactile_nodes.messages import types

ALL = Shown(None)


def wrench() -> types.WrenchStamped:
    header = types.Header(stamp=types.Time(sec=3, nanosec=4), frame_id='gel')
    force = types.Vector3(x=0.5, y=0.0, z=-1.0)
    return types.WrenchStamped(header=header, wrench=types.Wrench(force=force))


def test_yaml_keeps_the_order_of_the_fields() -> None:
    assert to_yaml(wrench().header, ALL) == 'stamp:\n  sec: 3\n  nanosec: 4\nframe_id: gel\n'


def test_flow_style_is_one_line_and_a_single_number_is_printed_alone() -> None:
    assert to_yaml(wrench().header, ALL, flow_style=True) == '{stamp: {sec: 3, nanosec: 4}, frame_id: gel}\n'
    assert to_yaml(0.5, ALL) == '0.5\n'


def test_long_arrays_and_texts_end_in_dots() -> None:
    image = types.Image(encoding='mono8', data=np.arange(5, dtype=np.uint8))
    printed = to_yaml(image, Shown(3))
    assert 'encoding: mon...\n' in printed
    assert printed.endswith("data:\n- 0\n- 1\n- 2\n- '...'\n")


@pytest.mark.parametrize(
    ('message', 'shown', 'field'),
    [
        (types.Image(data=np.zeros(7, np.uint8)), Shown(arrays=False), "data: '<sequence type: uint8, length: 7>'"),
        (types.CameraInfo(), Shown(arrays=False), "k: '<array type: float64[9]>'"),
        (wrench().header, Shown(strings=False), "frame_id: '<string length: <3>>'"),
        (types.Image(data=np.zeros(200, np.uint8)), ALL, 'data:\n' + '- 0\n' * 200),
    ],
    ids=['type and length of an array', 'size of a fixed array', 'length of a text', 'full length'],
)
def test_arrays_and_texts_can_be_reported_by_their_size(message: object, shown: Shown, field: str) -> None:
    assert field in to_yaml(message, shown)


def test_csv_holds_all_values_of_nested_messages() -> None:
    assert to_csv(wrench(), ALL) == '3,4,gel,0.5,0.0,-1.0,0.0,0.0,0.0'


def test_a_message_looks_like_that_of_ros2() -> None:
    assert to_python(types.Trigger_Response(success=True, message='ok')) == (
        "std_srvs.srv.Trigger_Response(success=True, message='ok')"
    )
    assert to_python(types.Trigger_Request()) == 'std_srvs.srv.Trigger_Request()'


def test_a_field_is_found_by_its_path_and_an_element_by_its_number() -> None:
    assert field_of(wrench(), 'wrench.force.z') == -1.0
    assert field_of(types.Image(data=np.arange(5, dtype=np.uint8)), 'data[3]') == 3


def test_a_wrong_field_is_answered_with_those_there_are() -> None:
    with pytest.raises(MessageError, match=r"has no 'wrench.froce': its fields are force, torque"):
        field_of(wrench(), 'wrench.froce')


def test_an_element_beyond_the_end_is_answered_with_the_length() -> None:
    with pytest.raises(MessageError, match='it holds 5 elements'):
        field_of(types.Image(data=np.arange(5, dtype=np.uint8)), 'data[5]')
