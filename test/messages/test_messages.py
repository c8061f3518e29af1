"""Messages: definitions, classes, bytes, hashes."""

from __future__ import annotations

import dataclasses
import re
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from reference import stubs
from tactile_nodes import messages
from tactile_nodes.errors import MessageError
from tactile_nodes.messages import types
from tactile_nodes.messages.store import own_texts, store

OWN = {name: text for name, text in own_texts().items() if name.startswith('tactile_nodes/')}


def test_header_bytes_are_xcdr1_little_endian() -> None:
    header = types.Header(stamp=types.Time(sec=1, nanosec=2), frame_id='gel')
    # DDS-XTypes 1.3, 7.4: encapsulation 00 01 00 00, then sec, nanosec, string length with its NUL, characters.
    assert messages.encode(header) == b'\x00\x01\x00\x00' + struct.pack('<iII', 1, 2, 4) + b'gel\x00'


def test_a_path_that_is_not_utf_8_is_sent_with_the_codes_of_its_odd_letters() -> None:
    """'m' and 'ü' in Latin-1, as Python has the name of such a folder; the state of a recorder names it."""
    odd, shown = b'/m\xfc/bag'.decode(errors='surrogateescape'), r'/m\udcfc/bag'
    status = types.DiagnosticStatus(level=1, message=odd, values=[types.KeyValue(key='bag', value=odd)])
    (sent,) = messages.decode(
        messages.encode(types.DiagnosticArray(status=[status])), 'diagnostic_msgs/msg/DiagnosticArray'
    ).status
    assert (sent.level, sent.message, sent.values[0].value) == (1, shown, shown)


def test_fields_not_given_are_zero_as_in_ros_2() -> None:
    message = types.ForceDistribution()
    assert (message.rows, message.total, message.status, message.provenance.model) == (0, 0.0, 0, '')
    assert message.normal_force.shape == (0,)
    assert types.WrenchStamped().wrench.force.z == 0.0


def test_messages_are_frozen() -> None:
    message = types.ForceDistribution()
    with pytest.raises(dataclasses.FrozenInstanceError):
        message.total = 1.0


def test_decoded_arrays_are_read_only_views() -> None:
    data = messages.encode(types.FlowFeatures(values=np.arange(4, dtype=np.float32)))
    values = messages.decode(data, 'tactile_nodes/msg/FlowFeatures').values
    assert values.tolist() == [0.0, 1.0, 2.0, 3.0]
    with pytest.raises(ValueError, match='read-only'):
        values[0] = 1.0


def test_hash_of_a_standard_type_is_the_one_ros_2_jazzy_publishes() -> None:
    # type_hashes in share/std_msgs/msg/String.json of ROS 2 Jazzy.
    assert (
        messages.type_hash('std_msgs/msg/String')
        == 'RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18'
    )


def test_definition_keeps_our_comments_and_adds_the_types_it_is_made_of() -> None:
    text = messages.definition('tactile_nodes/msg/ForceDistribution')
    assert 'positive presses into the gel' in text
    for part in ('MSG: std_msgs/Header', 'MSG: tactile_nodes/Provenance', 'MSG: builtin_interfaces/Time'):
        assert part in text


@pytest.mark.parametrize('name', sorted(OWN))
def test_own_definitions_follow_the_rules_of_rosidl(name: str) -> None:
    # rosidl_adapter.parser: VALID_FIELD_NAME_PATTERN, VALID_CONSTANT_NAME_PATTERN, VALID_MESSAGE_NAME_PATTERN.
    assert re.fullmatch(r'[A-Z][A-Za-z0-9]*', name.rpartition('/')[2])
    for line in OWN[name].splitlines():
        declaration = line.partition('#')[0].strip()
        if not declaration:
            continue
        _, field = declaration.split(maxsplit=1)
        if '=' in field:
            assert re.fullmatch(r'[A-Z](?:[A-Z0-9_]?[A-Z0-9]+)*', field.partition('=')[0])
        else:
            assert re.fullmatch(r'(?!.*__)[a-z](?:[a-z0-9_]*[a-z0-9])?', field)


@pytest.mark.parametrize('name', sorted(OWN))
def test_every_number_of_ours_says_its_meaning_in_a_comment(name: str) -> None:
    bare = [line for line in OWN[name].splitlines() if re.match(r'(float|u?int)\S* [a-z]', line) and '#' not in line]
    assert bare == []


def test_stub_file_matches_the_definitions() -> None:
    assert stubs.FILE.read_text(encoding='utf-8') == stubs.stub_text(), 'run: python -m reference.stubs'


def test_definitions_that_programs_read_are_those_of_msg_and_of_rosbags() -> None:
    assert store().fielddefs == stubs.definitions(), 'run: python -m reference.stubs'


def test_stamp_survives_the_round_trip_to_the_nanosecond() -> None:
    assert messages.stamp_ns(messages.time_from_ns(1_790_000_000_123_456_789)) == 1_790_000_000_123_456_789


def test_from_dict_reads_what_a_person_types() -> None:
    message = messages.from_dict('geometry_msgs/msg/WrenchStamped', {'wrench': {'force': {'z': -1}}})
    assert message.wrench.force.z == -1.0
    assert messages.to_dict(message)['wrench']['force'] == {'x': 0.0, 'y': 0.0, 'z': -1.0}


def test_a_rotation_not_given_is_none_as_in_ros_2() -> None:
    """Quaternion.msg has the default w = 1; tf2 refuses a quaternion of zeros."""
    transform = messages.from_dict('geometry_msgs/msg/TransformStamped', {'child_frame_id': 'tip'}).transform
    assert messages.to_dict(transform.rotation) == {'x': 0.0, 'y': 0.0, 'z': 0.0, 'w': 1.0}


def test_from_dict_takes_no_text_for_a_list_of_its_letters() -> None:
    with pytest.raises(MessageError, match=r"JointState\.name cannot be 'wrist': expected a list"):
        messages.from_dict('sensor_msgs/msg/JointState', {'name': 'wrist', 'position': [1.0]})


@pytest.mark.parametrize(
    ('values', 'sentence'),
    [
        ({'forse': 1}, "has no field 'forse'; it has: header, wrench"),
        ({'header': {'stamp': {'sec': 'soon'}}}, r"sec cannot be 'soon'"),
        ({'header': {'stamp': {'sec': 2**40}}}, 'has an invalid value'),
        ({'wrench': 5}, 'cannot be 5'),
    ],
)
def test_from_dict_says_what_is_wrong(values: dict[str, object], sentence: str) -> None:
    with pytest.raises(MessageError, match=sentence):
        messages.from_dict('geometry_msgs/msg/WrenchStamped', values)


@pytest.mark.parametrize('name', ['nothing', 'a/b', 'a/msg/B', '', 'std_msgs/msg/'])
def test_unknown_type_is_a_message_error(name: str) -> None:
    with pytest.raises(MessageError, match='no message type'):
        messages.decode(b'', name)


@settings(max_examples=300, deadline=None)
@given(data=st.binary(max_size=300), name=st.sampled_from([*sorted(OWN), 'sensor_msgs/msg/Image']))
def test_random_bytes_decode_or_raise_a_message_error(data: bytes, name: str) -> None:
    with_header = b'\x00\x01\x00\x00' + data
    for candidate in (data, with_header):
        try:
            messages.decode(candidate, name)
        except MessageError:
            continue


@settings(max_examples=200, deadline=None)
@given(cut=st.integers(0, 10_000), flips=st.lists(st.tuples(st.integers(0, 10_000), st.integers(1, 255)), max_size=5))
def test_cut_or_altered_messages_decode_or_raise_a_message_error(cut: int, flips: list[tuple[int, int]]) -> None:
    message = types.ForceDistribution(rows=9, cols=9, normal_force=np.ones(81, np.float32))
    data = bytearray(messages.encode(message))
    for position, change in flips:
        data[position % len(data)] ^= change
    try:
        messages.decode(bytes(data[: cut % len(data)]), 'tactile_nodes/msg/ForceDistribution')
    except MessageError:
        return


def test_a_message_is_read_whatever_follows_it_where_that_is_asked_for() -> None:
    """Fast DDS gives rclpy as many bytes as it had estimated; what follows the message is whatever was there."""
    data = messages.encode(types.SetBool_Request(data=True)) + b'?' * 9
    assert messages.decode_within(data, 'std_srvs/srv/SetBool_Request').data is True
    with pytest.raises(MessageError, match=r'14 bytes are not a std_srvs/srv/SetBool_Request'):
        messages.decode(data, 'std_srvs/srv/SetBool_Request')


@pytest.mark.parametrize('data', [b'', b'\0\1', b'\0\1\0\0', b'\0\3\0\0\1', b'\0\1\0\0\xff\xff'])
def test_bytes_that_begin_with_no_such_message_are_refused(data: bytes) -> None:
    with pytest.raises(MessageError, match='are not a std_msgs/msg/String'):
        messages.decode_within(data, 'std_msgs/msg/String')
