"""One MCAP file of a bag being recorded."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Schema
from mcap.writer import CompressionType, Writer

from tactile_nodes.bag.growing_file import GrowingFile
from tactile_nodes.bag.metadata import BagTopic, Extent
from tactile_nodes.paths import PACKAGE

COMPRESSIONS = {'none': CompressionType.NONE, 'lz4': CompressionType.LZ4, 'zstd': CompressionType.ZSTD}
_CHUNK_BYTES = 4 << 20


class Entry(NamedTuple):
    """One message to be written. `publish_ns`: capture stamp, or the time of publication."""

    log_ns: int
    publish_ns: int
    topic: str
    sequence: int
    data: bytes


class McapFile:
    """Writes entries into `path`, chunked and indexed.

    Raises:
        OSError: it exists or cannot be written; no file is left behind.
    """

    def __init__(self, path: Path, compression: str = 'none') -> None:
        self.path = path
        self.extent = Extent()
        self._stream = GrowingFile(path)
        self._writer: Any = Writer(self._stream, _CHUNK_BYTES, COMPRESSIONS[compression])  # type: ignore[arg-type]
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        try:
            self._writer.start('ros2', f'{PACKAGE} (mcap {version("mcap")})')
            self._stream.flush()
        except OSError:
            self.abandon()
            path.unlink()
            raise

    @property
    def size(self) -> int:
        """Bytes written, including those that wait for a flush."""
        return self._stream.tell()

    def add_topic(self, topic: BagTopic) -> None:
        """Describe a topic, before its first entry."""
        if topic.type_name not in self._schemas:
            schema = self._writer.register_schema(topic.type_name, topic.definition_format, topic.definition.encode())
            self._schemas[topic.type_name] = schema
        facts = {'offered_qos_profiles': topic.qos, 'topic_type_hash': topic.type_hash}
        schema = self._schemas[topic.type_name]
        channel = self._writer.register_channel(topic.name, topic.encoding, schema, facts)
        self._channels[topic.name] = channel
        self._describe_outside_of_chunks(topic, Channel(channel, topic.name, topic.encoding, facts, schema))

    def _describe_outside_of_chunks(self, topic: BagTopic, channel: Channel) -> None:
        """The writer describes topics inside a chunk; this copy keeps other chunks readable if that one is damaged."""
        builder = RecordBuilder()
        Schema(
            id=channel.schema_id,
            name=topic.type_name,
            encoding=topic.definition_format,
            data=topic.definition.encode(),
        ).write(builder)
        channel.write(builder)
        self._stream.write(builder.end())  # type: ignore[no-untyped-call]

    def add(self, entry: Entry) -> None:
        """Add one message; it is in the file after the next `flush`."""
        self._writer.add_message(
            self._channels[entry.topic], entry.log_ns, entry.data, entry.publish_ns, entry.sequence & 0xFFFFFFFF
        )
        self.extent.include(entry.log_ns)

    def flush(self) -> None:
        """Write everything added so far; the file is then a legal MCAP file.

        Raises:
            OSError: it cannot be written; the file keeps its previous content, and should be abandoned.
        """
        self._writer.flush()

    def sync(self) -> None:
        """Sync to disk, so that a power cut loses nothing. Raises OSError if the disk fails."""
        self._stream.sync()

    def close(self, metadata: str) -> None:
        """Write the rest, `metadata` in rosbag2's format, indexes and summary. Raises as `flush`."""
        self._writer.add_metadata('rosbag2', {'serialized_metadata': metadata})
        self._writer.finish()
        self._stream.finish()
        self._stream.sync()
        self._stream.close()

    def abandon(self) -> None:
        """Leave the file as it was after the last flush."""
        self._stream.close()
