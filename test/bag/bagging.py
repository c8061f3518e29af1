"""Bags made of real messages, and what is in them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from tactile_nodes import messages
from tactile_nodes.bag.metadata import BagTopic
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bag.writer import BagLimits, BagWriter
from tactile_nodes.errors import BagError
from tactile_nodes.messages import types

START_NS = 1_700_000_000_000_000_000
STEP_NS = 10_000_000
STRING = 'std_msgs/msg/String'
FORCE = 'tactile_nodes/msg/ForceDistribution'


@dataclass(frozen=True)
class Sample:
    """One message as it was handed to a writer."""

    topic: str
    log_ns: int
    data: bytes = field(repr=False)


def force(number: int, stamp_ns: int, **fields) -> bytes:
    values = np.linspace(0, number, 81, dtype=np.float32)
    header = types.Header(stamp=messages.time_from_ns(stamp_ns), frame_id='gel_surface')
    return messages.encode(types.ForceDistribution(**{'header': header, 'normal_force': values, **fields}))


def text(number: int) -> bytes:
    return messages.encode(types.String(data=f'number {number}'))


def samples(count: int) -> list[Sample]:
    """Forces and texts in turn; forces were captured 3 ms before they were received."""
    found = []
    for number in range(count):
        log_ns = START_NS + number * STEP_NS
        data = force(number, log_ns - 3_000_000) if number % 2 == 0 else text(number)
        found.append(Sample('/force' if number % 2 == 0 else '/text', log_ns, data))
    return found


def write(folder: Path, content: list[Sample], compression: str = 'none', limits: BagLimits | None = None) -> BagWriter:
    """A closed bag of `content`, which was sent 1 ms before it was received."""
    writer = BagWriter(folder, compression=compression, limits=limits)
    writer.add_topic(BagTopic.of_type('/force', FORCE, depth=1))
    writer.add_topic(BagTopic.of_type('/text', STRING, latched=True))
    for number, sample in enumerate(content):
        writer.write(sample.topic, sample.data, sample.log_ns, sample.log_ns - 1_000_000, number)
    writer.close()
    return writer


def rosbags_bag(folder: Path, storage: StoragePlugin, mode: CompressionMode = CompressionMode.NONE) -> list[Sample]:
    """A bag of texts that another library wrote, in one file."""
    content = [Sample('/text', START_NS + number, text(number)) for number in range(5)]
    writer = Writer(folder, version=8, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection('/text', STRING, typestore=get_typestore(Stores.ROS2_HUMBLE))
        for sample in content:
            writer.write(connection, sample.log_ns, sample.data)
    return content


def read(path: Path) -> tuple[list[Sample], list[str]]:
    """The messages of a bag, and the problems that were reported."""
    with BagReader(path) as reader:
        found = [Sample(message.topic, message.log_ns, message.data) for message in reader.messages()]
        return found, reader.problems


def refusal(path: Path) -> str:
    """The sentence with which a bag is refused."""
    with pytest.raises(BagError) as caught:
        BagReader(path)
    return str(caught.value)


def write_in_files(folder: Path, count: int) -> None:
    """Texts, numbered, in a file each."""
    writer = BagWriter(folder, limits=BagLimits(file_bytes=1))
    writer.add_topic(BagTopic.of_type('/text', STRING))
    for number in range(count):
        writer.write('/text', text(number), START_NS + number, START_NS)
        until(lambda number=number: writer.totals.messages == number + 1)
    writer.close()


def until(condition: Callable[[], object]) -> None:
    """Wait for a writer's thread."""
    waiting = threading.Event()
    for _ in range(12_000):
        if condition():
            return
        waiting.wait(0.005)
    raise AssertionError('it did not happen in time')
