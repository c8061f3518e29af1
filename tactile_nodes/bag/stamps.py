"""The capture stamp of a message, read from its bytes without decoding it."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from functools import cache
from typing import Any

from rosbags.interfaces import Nodetype

from tactile_nodes.clock import NS_PER_S
from tactile_nodes.messages.store import store

_HEADER = (Nodetype.NAME, 'std_msgs/msg/Header')


def is_headed(fields: Sequence[Any]) -> bool:
    """Whether the first field of a type is a std_msgs/Header."""
    return list(fields[:1]) == [('header', _HEADER)]


@cache
def starts_with_header(type_name: str) -> bool:
    """Whether our version of a type does."""
    known = store().fielddefs
    return type_name in known and is_headed(known[type_name][1])


def header_stamp_ns(data: bytes, type_name: str) -> int | None:
    """The stamp of the header of a message of our version of a type; None if it has none, and as `first_stamp_ns`."""
    return first_stamp_ns(data) if starts_with_header(type_name) else None


def first_stamp_ns(data: bytes) -> int | None:
    """The stamp in ns with which a message begins; None if it is not set or negative, or if the bytes are no CDR.

    >>> first_stamp_ns(bytes.fromhex('00010000 02000000 05000000 01000000 00'))
    2000000005
    """
    if len(data) < 12 or data[0] != 0:
        return None
    # Four bytes say how the rest is encoded: 0, then 1 for little endian, 0, 0. Then int32 sec, uint32 nanosec.
    sec, nanosec = struct.unpack_from('<iI' if data[1] & 1 else '>iI', data, 4)
    stamp_ns: int = sec * NS_PER_S + nanosec
    return stamp_ns if stamp_ns > 0 else None  # zero: not set; no bag can hold a negative one
