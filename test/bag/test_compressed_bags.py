"""Bags that `ros2 bag record` compressed: each message alone, or each file as a whole."""

from __future__ import annotations

from pathlib import Path

import pytest
import zstandard
from bagging import FORCE, START_NS, force, read, refusal, rosbags_bag
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from tactile_nodes import messages
from tactile_nodes.bag.reader import BagReader

ENDINGS = {StoragePlugin.MCAP: 'mcap', StoragePlugin.SQLITE3: 'db3'}
CAPTURED_NS = START_NS - 3_000_000


def unpack(folder: Path) -> None:
    """As ``zstd -d FOLDER/*.zstd``."""
    for file in folder.glob('*.zstd'):
        with file.open('rb') as packed, file.with_suffix('').open('wb') as unpacked:
            zstandard.ZstdDecompressor().copy_stream(packed, unpacked)


# --- each message alone -----------------------------------------------------------------------------------------


@pytest.mark.parametrize('storage', list(StoragePlugin))
def test_messages_that_are_compressed_one_by_one_are_unpacked(tmp_path: Path, storage: StoragePlugin) -> None:
    content = rosbags_bag(tmp_path / 'other', storage, CompressionMode.MESSAGE)
    assert read(tmp_path / 'other') == (content, [])


@pytest.mark.parametrize('storage', list(StoragePlugin))
def test_compressed_messages_are_unpacked_without_metadata(tmp_path: Path, storage: StoragePlugin) -> None:
    content = rosbags_bag(tmp_path / 'other', storage, CompressionMode.MESSAGE)
    (tmp_path / 'other' / 'metadata.yaml').unlink()  # which a killed recorder has not written
    assert read(tmp_path / 'other' / f'other.{ENDINGS[storage]}') == (content, [])
    assert read(tmp_path / 'other')[0] == content


def test_capture_stamp_is_not_taken_from_compressed_bytes(tmp_path: Path) -> None:
    writer = Writer(tmp_path / 'other', version=8, storage_plugin=StoragePlugin.SQLITE3)
    writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    with writer:
        definition, digest = messages.definition(FORCE), messages.type_hash(FORCE)
        connection = writer.add_connection('/force', FORCE, msgdef=definition, rihs01=digest)
        writer.write(connection, START_NS, force(1, CAPTURED_NS))
    with BagReader(tmp_path / 'other') as reader:
        assert [message.publish_ns for message in reader.messages()] == [CAPTURED_NS]


def test_messages_that_cannot_be_unpacked_are_left_out_and_reported(tmp_path: Path) -> None:
    content = rosbags_bag(tmp_path / 'other', StoragePlugin.SQLITE3, CompressionMode.MESSAGE)
    file = tmp_path / 'other' / 'other.db3'
    packed = zstandard.compress(content[1].data)
    file.write_bytes(file.read_bytes().replace(packed, packed[:6] + b'\xff' * (len(packed) - 6)))
    found, problems = read(file)
    assert found == [content[0], *content[2:]]
    assert problems == [f'{file}: messages on /text cannot be unpacked and are left out']


# --- each file as a whole ---------------------------------------------------------------------------------------


@pytest.mark.parametrize('storage', list(StoragePlugin))
def test_files_compressed_as_a_whole_are_refused_until_they_are_unpacked(
    tmp_path: Path, storage: StoragePlugin
) -> None:
    bag, name = tmp_path / 'other', f'other.{ENDINGS[storage]}'
    content = rosbags_bag(bag, storage, CompressionMode.FILE)
    assert refusal(bag) == f'{name}.zstd must be unpacked first (zstd -d {bag}/*.zstd)'
    assert refusal(bag / f'{name}.zstd') == f'{bag / name}.zstd must be unpacked first (zstd -d {bag / name}.zstd)'
    unpack(bag)
    assert read(bag) == (content, [])


def test_compressed_files_of_a_killed_recorder_are_not_passed_over(tmp_path: Path) -> None:
    bag = tmp_path / 'other'
    content = rosbags_bag(bag, StoragePlugin.SQLITE3, CompressionMode.FILE)
    (bag / 'metadata.yaml').unlink()
    refused = f'other.db3.zstd must be unpacked first (zstd -d {bag}/*.zstd)'
    assert refusal(bag) == refused
    last = rosbags_bag(tmp_path / 'last', StoragePlugin.SQLITE3, CompressionMode.NONE)
    (tmp_path / 'last' / 'last.db3').rename(bag / 'other_1.db3')
    without = f'{bag} has no metadata.yaml; reading the files in it'
    assert read(bag) == (last, [without, f'left out: {refused}'])
    unpack(bag)
    assert read(bag) == (sorted([*content, *last], key=lambda sample: sample.log_ns), [without])
