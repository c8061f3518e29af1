"""Reads MCAP records, also from a file that is cut off or damaged anywhere.

The reader of the `mcap` package passes on incomplete reads, and refuses a file without an ending. Here a record counts
only if it is complete, and an unfinished chunk gives its complete messages.
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
"""Largest unpacked chunk or message; recorders make chunks of some MB. A forged one of 1 MB could fill any memory."""


class Record(NamedTuple):
    """The place of a record in a file; `start` is where its content begins."""

    opcode: int
    start: int
    length: int


class ChunkHead(NamedTuple):
    """The header of a chunk."""

    start_ns: int
    end_ns: int
    size: int
    crc: int
    compression: str
    stored: int


class Message(NamedTuple):
    """A message record; its data is still a view."""

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
    """The complete records inside a chunk."""
    position = 0
    while position + HEAD_BYTES <= len(data):
        opcode, length = _HEAD.unpack_from(data, position)
        position += HEAD_BYTES + length
        if position > len(data):
            return
        yield opcode, data[position - length : position]


def read_chunk_head(content: bytes) -> tuple[ChunkHead, int] | None:
    """The header of a chunk and its length in bytes; None if `content`, the chunk's first bytes, is too short."""
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
    """The records of a chunk; if it is cut off, as many bytes as can be unpacked.

    Raises:
        ValueError: damaged, or of unknown compression.
    """
    whole = len(stored) == head.stored
    if head.compression and head.size > LARGEST_BYTES:
        raise ValueError(f'its header states an unpacked size of {head.size} bytes')
    try:
        data = _decompress(head.compression, stored, head.size)
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError) as error:
        raise ValueError(str(error)) from error
    if whole and (len(data) != head.size or (head.crc and zlib.crc32(data) != head.crc)):
        raise ValueError('its checksum is wrong')
    return memoryview(data)


def unpack_zstd(stored: bytes, limit: int) -> bytes:
    """The unpacked data, or its first `limit` + 1 bytes if it is longer; if it is cut off, what can be unpacked.

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
    raise ValueError(f'its compression {name!r} is not supported; lz4 and zstd are')


def message_of(content: memoryview) -> Message | None:
    """The content of a message record; None if it is too short."""
    if len(content) < _MESSAGE.size:
        return None
    channel, _, log_ns, publish_ns = _MESSAGE.unpack_from(content)
    return Message(channel, log_ns, publish_ns, content[_MESSAGE.size :])


def channel_of(content: bytes) -> Channel:
    """The channel record in `content`; raises ValueError if it is not one."""
    return _parsed(Channel, content)  # type: ignore[no-any-return]


def schema_of(content: bytes) -> Schema:
    """The schema record in `content`; raises ValueError if it is not one."""
    return _parsed(Schema, content)  # type: ignore[no-any-return]


def _parsed(kind: Any, content: bytes) -> Any:
    try:
        return kind.read(ReadDataStream(BytesIO(content)))
    except Exception as error:  # the parser fails in its own ways on damaged bytes
        raise ValueError(f'a damaged {kind.__name__} record') from error


def index_of(content: bytes) -> tuple[int, int]:
    """The channel of a message index, and how many messages it lists."""
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
