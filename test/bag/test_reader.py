"""Reading bags: other people's, cut off anywhere, damaged, and of types that have changed since."""

from __future__ import annotations

import itertools
import math
import struct
import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import lz4.frame
import mcap.writer
import pytest
import zstandard
from bagging import FORCE, START_NS, STRING, Sample, read, refusal, rosbags_bag, samples, text, write, write_in_files
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from rosbags.rosbag2 import StoragePlugin

from tactile_nodes import messages
from tactile_nodes.bag import growing_file, mcap_storage
from tactile_nodes.bag.content import BagMessage
from tactile_nodes.bag.metadata import BagTopic
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bag.writer import BagWriter
from tactile_nodes.errors import BagError, MessageError

# --- bags that others made ------------------------------------------------------------------------------------


@pytest.mark.shared_data
@pytest.mark.parametrize(
    'where', ['mcap/talker', 'sqlite3/talker', 'mcap/talker/talker.mcap', 'sqlite3/talker/talker.db3']
)
def test_all_twenty_messages_of_the_recorded_talker_are_read(shared_data: Path, where: str) -> None:
    with BagReader(shared_data / 'ros2_bags' / where) as reader:
        found = list(reader.messages())
        texts = [reader.decode(message).data for message in found if message.topic == '/topic']
    assert len(found) == 20
    assert texts == [f'Hello, world! {number}' for number in range(10)]
    assert reader.problems == []
    assert [message.log_ns for message in found] == sorted(message.log_ns for message in found)


@pytest.mark.parametrize('storage', list(StoragePlugin))
def test_bags_of_rosbags_are_read(tmp_path: Path, storage: StoragePlugin) -> None:
    content = rosbags_bag(tmp_path / 'other', storage)
    assert read(tmp_path / 'other') == (content, [])


@contextmanager
def foreign_file(path: Path, **options: object) -> Iterator[tuple[mcap.writer.Writer, int]]:
    """A file by the mcap package, and its channel of texts."""
    with path.open('wb') as file:
        writer = mcap.writer.Writer(file, **options)
        writer.start('ros2')
        yield writer, writer.register_channel('/text', 'cdr', writer.register_schema(STRING, 'ros2msg', b'string data'))


def in_chunks_that_overlap(path: Path, **options: object) -> list[Sample]:
    with foreign_file(path, **options) as (writer, channel):
        for number in (0, 5, 1, 6, 2, 9, 3, 4, 7, 8):
            writer.add_message(channel, START_NS + number, text(number), START_NS)
        writer.finish()
    return [Sample('/text', START_NS + number, text(number)) for number in range(10)]


@pytest.mark.parametrize('options', [{'use_chunking': False}, {'chunk_size': 60}], ids=['no chunks', 'overlapping'])
def test_messages_outside_of_chunks_and_in_overlapping_ones_are_read_in_order(
    tmp_path: Path, options: dict[str, object]
) -> None:
    content = in_chunks_that_overlap(tmp_path / 'wild.mcap', **options)
    assert read(tmp_path / 'wild.mcap') == (content, [])


def test_whoever_says_that_all_chunks_are_of_one_time_fills_no_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mcap_storage, 'MOST_WAITING_BYTES', 20)
    content = in_chunks_that_overlap(tmp_path / 'wild.mcap', chunk_size=60)
    found, problems = read(tmp_path / 'wild.mcap')
    assert sorted(found, key=lambda sample: sample.log_ns) == content
    assert problems == [f'{tmp_path / "wild.mcap"}: too many chunks overlap in time; messages are out of order']


def test_topic_described_in_a_chunk_of_others_is_found_without_a_summary(tmp_path: Path) -> None:
    with foreign_file(tmp_path / 'cut.mcap') as (writer, first):
        writer.add_message(first, START_NS, text(0), START_NS)
        second = writer.register_channel('/b', 'cdr', writer.register_schema('lab/msg/Odd', 'ros2msg', b'int32 x'))
        writer.flush()
        writer.add_message(first, START_NS + 1, text(1), START_NS)
        writer.flush()
        writer.add_message(second, START_NS + 2, text(2), START_NS)
        writer.flush()
    with BagReader(tmp_path / 'cut.mcap') as reader:
        assert [(m.topic, m.type_name) for m in reader.messages()] == [('/text', STRING)] * 2 + [('/b', 'lab/msg/Odd')]
        assert reader.counts == {'/text': 2, '/b': 1}


# --- choosing ----------------------------------------------------------------------------------------------------


def test_selects_topics_and_times(bag: Path) -> None:
    with BagReader(bag) as reader:
        found = list(reader.messages(['/force'], START_NS + 20_000_000, START_NS + 60_000_000))
    assert [message.log_ns - START_NS for message in found] == [20_000_000, 40_000_000]


def test_reads_no_more_than_is_asked_for(bag: Path) -> None:
    with BagReader(bag) as reader:
        first = next(reader.messages())
    assert isinstance(first, BagMessage)


def test_topics_tell_who_was_latched(bag: Path) -> None:
    with BagReader(bag) as reader:
        assert {name: topic.latched for name, topic in reader.topics.items()} == {'/force': False, '/text': True}


# --- cut off and damaged -----------------------------------------------------------------------------------------

CONTENT = samples(12)


@pytest.fixture(scope='module')
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp('whole')
    for compression in ('none', 'lz4', 'zstd'):
        write(folder / compression, CONTENT, compression)
    return {name: folder / name / f'{name}_0.mcap' for name in ('none', 'lz4', 'zstd')}


@pytest.fixture(scope='module')
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp('scratch') / 'cut.mcap'


def all_data(content: list[Sample]) -> set[bytes]:
    return {sample.data for sample in content}


@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(where=st.floats(0, 1), compression=st.sampled_from(['none', 'lz4', 'zstd']))
def test_file_cut_anywhere_is_read_up_to_the_cut(whole, scratch: Path, where: float, compression: str) -> None:
    data = whole[compression].read_bytes()
    scratch.write_bytes(data[: int(where * len(data))])
    try:
        found, problems = read(scratch)
    except BagError:
        assert int(where * len(data)) < 8  # not even the magic number
        return
    assert found == CONTENT[: len(found)]
    assert problems or found == CONTENT


def test_uncompressed_file_gives_every_message_that_is_there_in_full(whole, scratch: Path) -> None:
    data = whole['none'].read_bytes()
    for number, sample in enumerate(CONTENT):
        end = data.index(sample.data) + len(sample.data)
        scratch.write_bytes(data[:end])
        assert read(scratch)[0] == CONTENT[: number + 1]
        scratch.write_bytes(data[: end - 1])
        assert read(scratch)[0] == CONTENT[:number]


def test_a_topic_of_which_a_cut_leaves_no_message_has_none(whole, scratch: Path) -> None:
    data = whole['none'].read_bytes()
    first = CONTENT[0]
    scratch.write_bytes(data[: data.index(first.data) + len(first.data)])
    with BagReader(scratch) as reader:
        assert set(reader.counts) == set(reader.topics)
        assert len(reader.topics) > 1
        assert reader.counts == {name: int(name == first.topic) for name in reader.topics}


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(where=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7), compression=st.sampled_from(['none', 'zstd']))
def test_flipped_bit_never_makes_up_a_message(whole, scratch: Path, where: float, bit: int, compression: str) -> None:
    data = bytearray(whole[compression].read_bytes())
    data[int(where * len(data))] ^= 1 << bit
    scratch.write_bytes(data)
    try:
        found, _ = read(scratch)
    except BagError:
        return
    assert {sample.data for sample in found} <= all_data(CONTENT)


@pytest.fixture(scope='module')
def sqlite_bag(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Sample]]:
    folder = tmp_path_factory.mktemp('sqlite') / 'other'
    content = rosbags_bag(folder, StoragePlugin.SQLITE3)
    return folder / 'other.db3', content


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(where=st.floats(0, 1))
@example(where=0.99913646972118)  # in the index of times, whose first entry stands last
def test_sqlite_file_cut_anywhere_gives_messages_or_a_sentence(sqlite_bag, scratch: Path, where: float) -> None:
    file, content = sqlite_bag
    data = file.read_bytes()
    scratch.write_bytes(data[: int(where * len(data))])
    try:
        found, problems = read(scratch)
    except BagError:
        return
    assert found == content[: len(found)]
    assert problems or found == content


def test_folder_without_metadata_is_read_and_reported(bag: Path) -> None:
    (bag / 'metadata.yaml').unlink()
    found, problems = read(bag)
    assert found == samples(10)
    assert problems == [f'{bag} has no metadata.yaml; reading the files in it']


# --- what is no bag ----------------------------------------------------------------------------------------------


def test_path_that_is_not_there(tmp_path: Path) -> None:
    assert refusal(tmp_path / 'none').startswith(f'there is no bag {tmp_path / "none"}')


def test_a_folder_of_bags_names_them(bag: Path) -> None:
    assert refusal(bag.parent).endswith(f'; the bags in it are {bag.name}: give {bag.parent}/*/')


def test_folder_that_is_no_bag(tmp_path: Path) -> None:
    assert 'neither metadata.yaml nor .mcap or .db3 files' in refusal(tmp_path)


def test_empty_file(tmp_path: Path) -> None:
    (tmp_path / 'x.mcap').touch()
    assert refusal(tmp_path / 'x.mcap') == f'{tmp_path / "x.mcap"} is empty'


@pytest.mark.parametrize('left', [b'', bytes(4096)])
def test_files_before_one_that_a_power_cut_left_blank_are_read(tmp_path: Path, left: bytes) -> None:
    write_in_files(tmp_path / 'press', 2)
    blank = tmp_path / 'press' / 'press_1.mcap'
    blank.write_bytes(left)
    found, problems = read(tmp_path / 'press')
    assert found == [Sample('/text', START_NS, text(0))]
    assert problems == [
        f'{blank} is empty, as after a power cut at its start; reading the files before it',
        f'{tmp_path / "press" / "metadata.yaml"} states 2 messages, but the files hold 1',
    ]


@pytest.mark.parametrize('stated_size', [1000, 1 << 40])
@pytest.mark.parametrize('compression', ['zstd', 'lz4'])
def test_chunk_that_would_fill_the_memory_is_left_out(tmp_path: Path, compression: str, stated_size: int) -> None:
    content = bytes(256 << 20)
    packed = zstandard.compress(content) if compression == 'zstd' else lz4.frame.compress(content)
    head = struct.pack('<QQQII', 0, 1, stated_size, 0, len(compression)) + compression.encode()
    chunk = head + struct.pack('<Q', len(packed)) + packed
    forged = tmp_path / 'forged.mcap'
    forged.write_bytes(growing_file.MAGIC + struct.pack('<BQ', Opcode.CHUNK, len(chunk)) + chunk)
    del content
    tracemalloc.start()
    try:
        found, problems = read(forged)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert found == []
    assert 'and is left out' in problems[-1]
    assert most < 32 << 20


def test_file_that_is_something_else(tmp_path: Path) -> None:
    (tmp_path / 'x.mcap').write_text('hello, this is no recording')
    assert refusal(tmp_path / 'x.mcap').endswith('is not a bag: neither MCAP nor SQLite')


@pytest.mark.parametrize(
    ('old', 'new', 'said'),
    [
        ('relative_file_paths:', '[', 'metadata.yaml is damaged'),
        (
            'storage_identifier: mcap',
            'storage_identifier: tape',
            "has storage 'tape'; only mcap and sqlite3 can be read",
        ),
        ('version: 8', 'version: 99', 'has version 99; versions up to 9 can be read'),
    ],
)
def test_metadata_that_cannot_be_read(bag: Path, old: str, new: str, said: str) -> None:
    metadata = bag / 'metadata.yaml'
    metadata.write_text(metadata.read_text().replace(old, new))
    assert said in refusal(bag)


def test_storage_file_that_is_missing(bag: Path) -> None:
    (bag / 'press_0.mcap').unlink()
    assert 'lists press_0.mcap, which is not in the folder' in refusal(bag)


# --- types -------------------------------------------------------------------------------------------------------


def bag_of_type(folder: Path, type_name: str, definition: str, data: bytes) -> BagReader:
    writer = BagWriter(folder)
    writer.add_topic(BagTopic('/odd', type_name, definition))
    writer.write('/odd', data, START_NS, START_NS)
    writer.close()
    return BagReader(folder)


INT32_7 = bytes.fromhex('00010000 07000000')


def test_type_that_nobody_knows_here_is_decoded_by_the_definition_in_the_bag(tmp_path: Path) -> None:
    with bag_of_type(tmp_path / 'odd', 'lab_msgs/msg/Odd', 'int32 count  # of something', INT32_7) as reader:
        assert [reader.decode(message).count for message in reader.messages()] == [7]
        assert not reader.types.is_ours('lab_msgs/msg/Odd')


def test_older_version_of_our_type_is_decoded_as_it_was_and_not_taken_for_ours(tmp_path: Path) -> None:
    with bag_of_type(tmp_path / 'old', FORCE, 'int32 newtons', INT32_7) as reader:
        assert [reader.decode(message).newtons for message in reader.messages()] == [7]
        assert not reader.types.is_ours(FORCE)


def test_forces_of_an_earlier_release_say_of_what_they_lack_that_it_is_not_known() -> None:
    with BagReader(Path(__file__).parents[2] / 'examples/press_bag') as reader:  # of before shear was published
        assert reader.types.is_completed(FORCE)
        found = [reader.decode(message) for message in reader.messages(['/force_distribution'])]
    pressed = max(found, key=lambda each: each.total)
    assert pressed.total == pytest.approx(float(pressed.normal_force.sum()), abs=1e-6)
    assert math.isnan(pressed.contacts[0].shear_x)
    assert pressed.contacts[0].force == pytest.approx(pressed.total, abs=1e-3)
    assert math.isnan(pressed.wrench.force.x)
    assert pressed.wrench_covariance.tolist() == [-1.0] + [0.0] * 35
    assert (pressed.explanation, pressed.shear_force_x.size) == (pressed.EXPLANATION_UNKNOWN, 0)
    assert messages.decode(messages.encode(pressed), FORCE).total == pressed.total


def test_our_own_definitions_are_recognised(bag: Path) -> None:
    with BagReader(bag) as reader:
        assert reader.types.is_ours(FORCE)
        assert reader.types.is_ours(STRING)


@pytest.mark.parametrize(
    'definition', ['int32 __import__', 'int32 x\n' * 3, 'int32 x; import os', 'Odd inner', 'int32[', '\0', 'int32 def']
)
def test_strange_definitions_run_nothing_and_break_nothing(tmp_path: Path, definition: str) -> None:
    with bag_of_type(tmp_path / 'odd', 'lab_msgs/msg/Odd', definition, INT32_7) as reader:
        (message,) = reader.messages()
        try:
            reader.decode(message)
        except MessageError as error:
            assert 'lab_msgs/msg/Odd' in str(error)


def test_type_without_any_definition_is_a_message_error(tmp_path: Path) -> None:
    with (
        bag_of_type(tmp_path / 'odd', 'lab_msgs/msg/Odd', '', INT32_7) as reader,
        pytest.raises(MessageError, match='lab_msgs/msg/Odd'),
    ):
        reader.decode(next(itertools.islice(reader.messages(), 1)))
