"""CDR bytes of generated messages."""

from __future__ import annotations

from typing import Any

from rclpy.generated import Generated, ours, theirs
from tactile_nodes import messages

NEVER_SET = b'?' * 9
"""As with Fast DDS, whose bytes are as long as it had estimated before it made them."""


def on_the_wire(message: Any) -> bytes:
    if not isinstance(message, Generated):
        raise AttributeError(f'{type(message).__name__} has no type support')  # noqa: TRY004 - as rclpy does
    return messages.encode(ours(message))


def serialize_message(message: Any) -> bytes:
    return on_the_wire(message) + NEVER_SET


def deserialize_message(serialized_message: bytes, message_type: Any) -> Any:
    assert isinstance(serialized_message, bytes)
    return theirs(messages.decode_within(serialized_message, message_type.__msgtype__))
