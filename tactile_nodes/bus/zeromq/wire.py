"""The frames that travel between processes.

A message: ``[header + CDR bytes]``, or ``[header, CDR bytes]`` when it is large, which saves a copy. The header holds
what a subscriber must know before it touches the bytes.
A call: ``[CALL, id, service, type, CDR bytes]``; its answer: ``[ANSWER, id, b'ok' or b'error', CDR bytes or text]``.
A ping: ``[PING, id]``; its answer ``[ANSWER, id, b'ok', b'']``.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from tactile_nodes import messages
from tactile_nodes.errors import MessageError

CALL = b'TNC1'
ANSWER = b'TNA1'
PING = b'TNP1'

_MAGIC = b'TNM1'
_HEADER = struct.Struct('<4s16s8sQq')
HEADER_SIZE = _HEADER.size


class Header(NamedTuple):
    """Who sent the message (`gid`, at most 16 characters), as which of theirs, when, and of which type."""

    gid: bytes
    type_key: bytes
    sequence: int
    source_ns: int


def type_key(type_name: str) -> bytes:
    """Eight bytes that tell a type, its fields included, from others: the head of its RIHS01 hash."""
    return bytes.fromhex(messages.type_hash(type_name).removeprefix('RIHS01_')[:16])


def pack_header(gid: bytes, key: bytes, sequence: int, source_ns: int) -> bytes:
    """What goes before the bytes of a message."""
    return _HEADER.pack(_MAGIC, gid, key, sequence, source_ns)


def unpack_header(frame: bytes | memoryview) -> Header:
    """The header with which `frame` begins.

    Raises:
        MessageError: no header of ours.
    """
    if len(frame) < HEADER_SIZE:
        raise MessageError('a frame that was not sent by this bus')
    magic, gid, key, sequence, source_ns = _HEADER.unpack_from(frame)
    if magic != _MAGIC:
        raise MessageError('a frame that was not sent by this bus')
    return Header(gid.rstrip(b'\0'), key, sequence, source_ns)
