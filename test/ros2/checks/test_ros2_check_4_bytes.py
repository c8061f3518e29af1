"""Check 4: the bytes of our codec are those of rclpy's, for every type that the package sends.

Expected: for each type, with all fields zero and with several fillings, `rclpy.serialization.serialize_message` of what
`deserialize_message` read from our bytes gives our bytes again, padding at the end aside. Fast DDS leaves padding, in
between too, as it found it: there the message that is read from its bytes has to give ours.
"""

from __future__ import annotations

import pytest
from filled_messages import filled
from ros2_here import ROOT, needs_ros

from tactile_nodes import messages
from tactile_nodes.bus.topics import TOPICS
from tactile_nodes.messages.services import SERVICES

OWN = {f'tactile_nodes/msg/{file.stem}' for file in (ROOT / 'msg').glob('*.msg')}
TYPES = sorted(OWN | {topic.type_name for topic in TOPICS.values()})
HALVES = sorted(SERVICES)


def _generated(type_name: str) -> object:
    import importlib

    package, kind, name = type_name.split('/')
    if kind == 'msg':
        return getattr(importlib.import_module(f'{package}.msg'), name)
    service, _, half = name.rpartition('_')
    return getattr(getattr(importlib.import_module(f'{package}.srv'), service), half)


def _through_rclpy(data: bytes, type_name: str) -> bytes:
    from rclpy.serialization import deserialize_message, serialize_message

    return bytes(serialize_message(deserialize_message(data, _generated(type_name))))


def _require_same(theirs: bytes, ours: bytes, type_name: str) -> None:
    from rclpy.utilities import get_rmw_implementation_identifier

    if 'fastrtps' in get_rmw_implementation_identifier():
        theirs = messages.encode(messages.decode_within(theirs, type_name))
    assert theirs[: len(ours)] == ours
    assert set(theirs[len(ours) :]) <= {0}


@needs_ros
@pytest.mark.parametrize('type_name', TYPES + HALVES)
def test_rclpy_reads_our_bytes_and_writes_them_again(type_name: str) -> None:
    zeros = messages.encode(messages.message_class(type_name)())
    for data in [zeros, *(messages.encode(filled(type_name, seed)) for seed in range(5))]:
        _require_same(_through_rclpy(data, type_name), data, type_name)


@needs_ros
@pytest.mark.parametrize('type_name', TYPES + HALVES)
def test_a_message_of_rclpys_that_nobody_filled_is_ours(type_name: str) -> None:
    from rclpy.serialization import serialize_message

    ours = messages.encode(messages.message_class(type_name)())
    _require_same(bytes(serialize_message(_generated(type_name)())), ours, type_name)


def test_the_byte_of_a_request_without_fields_is_never_set() -> None:
    """rosidl's converter for Python writes a 0 there, whatever was read (`_msg_support.c.em`)."""
    assert {messages.encode(filled('std_srvs/srv/Trigger_Request', seed)) for seed in range(5)} == {b'\0\1\0\0\0'}


@pytest.mark.parametrize('type_name', TYPES + HALVES)
def test_our_codec_reads_what_it_wrote(type_name: str) -> None:
    """The half of the check that needs no ROS 2."""
    data = messages.encode(filled(type_name, 1))
    assert messages.encode(messages.decode(data, type_name)) == data
