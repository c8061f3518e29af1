"""Every ZeroMQ socket of this package is made here, with a limit to what it takes in.

A longer frame ends the connection that it comes by before it is read into memory (``ZMQ_MAXMSGSIZE``); the other
connections of the socket go on.
"""

from __future__ import annotations

from enum import IntEnum
from functools import cache
from typing import Any

import zmq

from tactile_nodes import messages


class Longest(IntEnum):
    """The longest frame [bytes], by what there can be in it."""

    WORD = 64  # to a publisher: a subscription, or the hand-shake, which is shorter than 64; ours subscribe to all
    CALL = 4 << 20  # requests and answers: the largest, all parameters of a node described, is 40 kB
    TEXT = 1 << 20  # messages without arrays: a stamp, numbers, names, a line of the log
    NUMBERS = 16 << 20  # arrays of numbers: 1000 x 1000 bins are 4 MB
    PICTURE = 128 << 20  # bytes: a picture of 8K in colour is 100 MB


_BYTES = frozenset({'uint8', 'int8', 'byte', 'char', 'octet'})


def open_socket(context: zmq.Context[Any], kind: int, longest: int) -> Any:
    """A socket of `kind`, say ``zmq.SUB``, that takes in no frame of more than `longest` bytes."""
    opened = context.socket(kind)
    opened.set(zmq.MAXMSGSIZE, int(longest))
    return opened


@cache
def longest_message(type_name: str) -> int:
    """How many bytes a message of a type may have, by what there can be any number of in it.

    >>> longest_message('sensor_msgs/msg/Image') >> 20, longest_message('geometry_msgs/msg/WrenchStamped') >> 20
    (128, 1)

    Raises:
        MessageError: no such type.
    """
    many = messages.repeated(type_name)
    if many & _BYTES:
        return Longest.PICTURE
    return Longest.NUMBERS if many else Longest.TEXT
