"""CDR bytes of generated messages."""

from __future__ import annotations

from typing import Any

from rclpy.generated import Generated, ours, theirs
from tactile_nodes import messages


def serialize_message(message: Any) -> bytes:
    if not isinstance(message, Generated):
        raise AttributeError(f'{type(message).__name__} has no type support')  # noqa: TRY004 - as rclpy does
    return messages.encode(ours(message))


def deserialize_message(serialized_message: bytes, message_type: Any) -> Any:
    assert isinstance(serialized_message, bytes)
    return theirs(messages.decode(serialized_message, message_type.__msgtype__))
