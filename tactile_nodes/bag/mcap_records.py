"""MCAP's records, read so that a file may end, or be damaged, anywhere.

The reader of the `mcap` package hands on whatever a short read gives it, and refuses a file without an ending; here a
record counts only when all its bytes are there, and an unfinished chunk gives the messages it holds in full.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import Any, BinaryIO, NamedTuple

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

_HEAD = struct.Struct('<BQ')
_CHUNK = struct.Struct('<QQQII')
_MESSAGE = struct.Struct('<HIQQ')
HEAD_BYTES = _HEAD.size
LARGEST_BYTES = 1 << 30
"""No chunk or message unpacks to more; recorders make chunks of some MB. A forged one of 1 MB could fill any memory."""


class Record(NamedTuple):
    """Where a record lies: `start` is that of its content."""

    opcode: int
    start: int
    length: int


class ChunkHead(NamedTuple):
    """What a chunk says of itself before its content."""

    start_ns: int
    end_ns: int
    size: int
    crc: int
    compression: str
    stored: int


class Message(NamedTuple):
    """A message record, its data still a view."""

    channel: int
    log_ns: int
    publish_ns: int
    data: memoryview


def walk(file: BinaryIO, start: int, end: int) -> Iterator[Record]:
    """The records from `start` on; the last one may reach beyond `end`, the file's size, and is then cut off."""
    position = start
    while position + HEAD_BYTES <= end:
        file.seek(position)
        opcode, length = _HEAD.unpack(file.read(HEAD_BYTES))
        yield Record(opcode, position + HEAD_BYTES, length)
        position += HEAD_BYTES + length


def walk_bytes(data: memoryview) -> Iterator[tuple[int, memoryview]]:
    """The records inside a chunk that are there in full."""
    position = 0
    while position + HEAD_BYTES <= len(data):
        opcode, length = _HEAD.unpack_from(data, position)
        position += HEAD_BYTES + length
        if position > len(data):
            return
        yield opcode, data[position - length : position]


def read_chunk_head(content: bytes) -> tuple[ChunkHead, int] | None:
    """The head of a chunk and its length in bytes; None when `content`, the chunk's first bytes, is too short."""
    if len(content) < _CHUNK.size:
        return None
    start_ns, end_ns, size, crc, name_length = _CHUNK.unpack_from(content)
    length = _CHUNK.size + name_length + 8
    if len(content) < length:
        return None
    name = content[_CHUNK.size : length - 8].decode(errors='replace')
    (stored,) = struct.unpack_from('<Q', content, length - 8)
    return ChunkHead(start_ns, end_ns, size, crc, name, stored), length


def unpack_chunk(head: ChunkHead, stored: bytes) -> memoryview:
    """The records of a chunk; of one that is cut off, as many bytes as can be had.

    Raises:
        ValueError: damaged, or compressed in a way we do not know.
    """
    whole = len(stored) == head.stored
    if head.compression and head.size > LARGEST_BYTES:
        raise ValueError(f'it is said to unpack to {head.size} bytes')
    try:
        data = _decompress(head.compression, stored, head.size)
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError) as error:
        raise ValueError(str(error)) from error
    if whole and (len(data) != head.size or (head.crc and zlib.crc32(data) != head.crc)):
        raise ValueError('its checksum is wrong')
    return memoryview(data)


def unpack_zstd(stored: bytes, limit: int) -> bytes:
    """What was packed, or `limit` + 1 bytes of what is longer; of what is cut off, what can be had.

    Raises:
        zstandard.ZstdError: damaged.
    """
    return bytes(zstandard.ZstdDecompressor().stream_reader(stored).read(limit + 1))


def _decompress(name: str, stored: bytes, limit: int) -> bytes:
    if name == '':
        return stored
    if name == 'zstd':
        return unpack_zstd(stored, limit)
    if name == 'lz4':
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(stored, max_length=limit + 1))
    raise ValueError(f'its compression {name!r} is unknown here; known are lz4 and zstd')


def message_of(content: memoryview) -> Message | None:
    """The content of a message record; None when it is too short to be one."""
    if len(content) < _MESSAGE.size:
        return None
    channel, _, log_ns, publish_ns = _MESSAGE.unpack_from(content)
    return Message(channel, log_ns, publish_ns, content[_MESSAGE.size :])


def channel_of(content: bytes) -> Channel:
    """Raises ValueError when it is none."""
    return _parsed(Channel, content)  # type: ignore[no-any-return]


def schema_of(content: bytes) -> Schema:
    """Raises ValueError when it is none."""
    return _parsed(Schema, content)  # type: ignore[no-any-return]


def _parsed(kind: Any, content: bytes) -> Any:
    try:
        return kind.read(ReadDataStream(BytesIO(content)))
    except Exception as error:  # the parser fails in its own ways on damaged bytes
        raise ValueError(f'a damaged {kind.__name__} record') from error


def index_of(content: bytes) -> tuple[int, int]:
    """Channel and number of messages that a message index lists."""
    channel, length = struct.unpack_from('<HI', content)
    return channel, length // 16


CHUNK, MESSAGE, MESSAGE_INDEX, CHANNEL, SCHEMA, DATA_END, FOOTER = (
    int(opcode)
    for opcode in (
        Opcode.CHUNK, Opcode.MESSAGE, Opcode.MESSAGE_INDEX, Opcode.CHANNEL, Opcode.SCHEMA, Opcode.DATA_END,
        Opcode.FOOTER,
    )
)  # fmt: skip
KNOWN = {int(opcode) for opcode in Opcode}
