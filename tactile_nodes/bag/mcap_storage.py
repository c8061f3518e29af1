"""Reads one MCAP file, complete or cut off, in order of receive times, one chunk at a time."""

from __future__ import annotations

import heapq
import itertools
import struct
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from mcap.records import Channel

from tactile_nodes.bag import mcap_records as records
from tactile_nodes.bag.content import BagMessage, Complain, Selection
from tactile_nodes.bag.growing_file import MAGIC
from tactile_nodes.bag.mcap_records import ChunkHead, Message, Record
from tactile_nodes.bag.metadata import BagTopic, Extent
from tactile_nodes.files import TEXT_BYTES, open_plain

_RUN_BYTES = 4 << 20
_INDEX_HEAD = struct.calcsize('<HI')
MOST_WAITING_BYTES = 256 << 20


@dataclass
class _Block:
    """A chunk, or (`head` None) a run of messages outside of chunks. `counts` by channel."""

    start: int
    length: int
    start_ns: int
    end_ns: int
    head: ChunkHead | None = None
    counts: Counter[int] = field(default_factory=Counter)


class McapStorage:
    """The file is scanned once, record by record, so that its content is known and not taken from its summary.

    Raises:
        OSError: it cannot be read.
    """

    def __init__(self, path: Path, complain: Complain) -> None:
        self.path = path
        self.topics: dict[str, BagTopic] = {}
        self.counts: dict[str, int] = {}
        self.extent = Extent()
        self._complain = complain
        self._size = path.stat().st_size
        self._file = open_plain(path)
        self._schemas = {0: ('', '', '')}
        self._channels: dict[int, Channel] = {}
        self._blocks: list[_Block] = []
        self._walk()
        self._find_channels()
        self._count_all()

    def close(self) -> None:
        self._file.close()

    def messages(self, selection: Selection) -> Iterator[BagMessage]:
        """The selected messages in order of receive times; messages with equal times in file order.

        At most `MOST_WAITING_BYTES` of chunks with overlapping times are kept in memory.
        """
        waiting: list[tuple[int, int, Message]] = []
        held, in_order = 0, True
        order = itertools.count()
        wanted = {number for number, channel in self._channels.items() if selection.has(channel.topic)}
        for block in sorted(self._blocks, key=lambda block: block.start_ns):
            while waiting and (waiting[0][0] < block.start_ns or held > MOST_WAITING_BYTES):
                if in_order and waiting[0][0] >= block.start_ns:
                    self._complain(f'{self.path}: too many chunks overlap in time; messages are out of order')
                    in_order = False
                message = heapq.heappop(waiting)[2]
                held -= len(message.data)
                yield self._bag_message(message)
            overlaps = block.end_ns >= selection.start_ns and block.start_ns < selection.end_ns
            if overlaps and wanted & block.counts.keys():  # chunks without these topics are not read from the disk
                for message in self._messages_of(block):
                    if self._is_wanted(message, selection):
                        heapq.heappush(waiting, (message.log_ns, next(order), message))
                        held += len(message.data)
        while waiting:
            yield self._bag_message(heapq.heappop(waiting)[2])

    # --- scanning --------------------------------------------------------------------------

    def _walk(self) -> None:
        start = len(MAGIC)
        for record in records.walk(self._file, start, self._size):
            if record.opcode not in records.KNOWN and record.opcode < 0x80:
                self._complain(f'{self.path} is damaged at byte {record.start - records.HEAD_BYTES}; read up to there')
                self._distrust_last_indexes()
                return
            if record.start + record.length > self._size:
                self._add_cut_off(record)
                return
            self._add(record)
            if record.opcode == records.FOOTER:
                return
        self._complain(f'{self.path} has no ending; read up to its last byte')

    def _add_cut_off(self, record: Record) -> None:
        self._complain(f'{self.path} is cut off at byte {self._size}; read up to there')
        if record.opcode == records.CHUNK:
            self._add(record)
        self._distrust_last_indexes()

    def _distrust_last_indexes(self) -> None:
        if self._blocks:
            self._blocks[-1].counts.clear()  # some of its indexes may be missing: count its messages

    def _add(self, record: Record) -> None:
        if record.opcode == records.CHUNK:
            self._add_chunk(record)
        elif record.opcode == records.MESSAGE_INDEX and self._blocks and record.length >= _INDEX_HEAD:
            channel, count = records.index_of(self._read(record.start, _INDEX_HEAD))
            self._blocks[-1].counts[channel] += count
        elif record.opcode == records.MESSAGE:
            self._add_message(record)
        elif record.opcode in {records.SCHEMA, records.CHANNEL} and record.length <= TEXT_BYTES:
            self._describe(record.opcode, self._read(record.start, record.length))

    def _add_chunk(self, record: Record) -> None:
        found = records.read_chunk_head(self._read(record.start, min(record.length, 64)))
        if found is not None:
            head, length = found
            stored = min(head.stored, record.length - length)
            self._blocks.append(_Block(record.start + length, stored, head.start_ns, head.end_ns, head))

    def _add_message(self, record: Record) -> None:
        message = records.message_of(memoryview(self._read(record.start, min(record.length, 22))))
        if message is None:
            return
        start = record.start - records.HEAD_BYTES
        last = self._blocks[-1] if self._blocks else None
        if last is None or last.head is not None or last.length > _RUN_BYTES or last.start + last.length != start:
            last = _Block(start, 0, message.log_ns, message.log_ns)
            self._blocks.append(last)
        last.length += records.HEAD_BYTES + record.length
        last.start_ns, last.end_ns = min(last.start_ns, message.log_ns), max(last.end_ns, message.log_ns)
        last.counts[message.channel] += 1

    def _find_channels(self) -> None:
        """Descriptions are in the summary, or else in a chunk before their first use."""
        unread: list[_Block] = []
        for block in self._blocks:
            unread.append(block)
            if not block.counts:
                self._count(unread.pop())
            while unread and not self._describes(block.counts):
                self._count(unread.pop())

    def _describes(self, channels: Iterable[int]) -> bool:
        return all(
            channel in self._channels and self._channels[channel].schema_id in self._schemas for channel in channels
        )

    def _count(self, block: _Block) -> None:
        block.counts = Counter(message.channel for message in self._messages_of(block))

    def _count_all(self) -> None:
        filled = [block for block in self._blocks if block.counts]
        total: Counter[int] = sum((block.counts for block in filled), Counter())
        for channel, count in total.items():
            if channel in self._channels and self._topic(channel).encoding == 'cdr':
                name = self._topic(channel).name
                self.counts[name] = self.counts.get(name, 0) + count
        if unknown := total.keys() - self._channels.keys():
            count = sum(total[channel] for channel in unknown)
            self._complain(f'{self.path}: messages left out because the description of their topic is damaged: {count}')
        for channel in self._channels:
            self.topics.setdefault(self._topic(channel).name, self._topic(channel))
        if filled:
            start_ns, end_ns = min(block.start_ns for block in filled), max(block.end_ns for block in filled)
            self.extent = Extent(sum(self.counts.values()), start_ns, end_ns)

    # --- reading --------------------------------------------------------------------------------------------

    def _read(self, start: int, length: int) -> bytes:
        self._file.seek(start)
        return self._file.read(min(length, max(0, self._size - start)))

    def _messages_of(self, block: _Block) -> Iterator[Message]:
        for opcode, content in records.walk_bytes(self._content(block)):
            if opcode == records.MESSAGE:
                message = records.message_of(content)
                if message is not None:
                    yield message
            elif opcode in {records.SCHEMA, records.CHANNEL}:
                self._describe(opcode, bytes(content))

    def _content(self, block: _Block) -> memoryview:
        try:
            if block.length > records.LARGEST_BYTES:
                raise ValueError(f'it holds {block.length} bytes')
            stored = self._read(block.start, block.length)
            return memoryview(stored) if block.head is None else records.unpack_chunk(block.head, stored)
        except ValueError as error:
            self._complain(f'{self.path}: the chunk at byte {block.start} cannot be read ({error}) and is left out')
            return memoryview(b'')

    def _describe(self, opcode: int, content: bytes) -> None:
        try:
            if opcode == records.SCHEMA:
                schema = records.schema_of(content)
                text = schema.data.decode(errors='replace')
                self._schemas.setdefault(schema.id, (schema.name, schema.encoding, text))
            else:  # the first counts: a copy at the end of a file may be half written
                channel = records.channel_of(content)
                self._channels.setdefault(channel.id, channel)
        except ValueError as error:
            self._complain(f'{self.path}: {error} is left out')

    def _topic(self, channel_id: int) -> BagTopic:
        channel = self._channels[channel_id]
        type_name, encoding, text = self._schemas.get(channel.schema_id, ('', '', ''))
        facts = channel.metadata
        qos, type_hash = facts.get('offered_qos_profiles', ''), facts.get('topic_type_hash', '')
        return BagTopic(channel.topic, type_name, text, type_hash, qos, channel.message_encoding, encoding)

    def _is_wanted(self, message: Message, selection: Selection) -> bool:
        channel = self._channels.get(message.channel)
        return (
            channel is not None and channel.message_encoding == 'cdr' and selection.wants(channel.topic, message.log_ns)
        )

    def _bag_message(self, message: Message) -> BagMessage:
        channel = self._channels[message.channel]
        type_name = self._schemas.get(channel.schema_id, ('', '', ''))[0]
        return BagMessage(channel.topic, type_name, message.log_ns, message.publish_ns, bytes(message.data))
