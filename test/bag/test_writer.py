"""Writing bags: what is in them, in which order, and that nothing else than the bytes that came in is stored."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import mcap.reader
import pytest
import yaml
from bagging import FORCE, START_NS, Sample, force, samples, text, write, write_in_files
from rosbags.rosbag2 import Reader

from tactile_nodes import messages
from tactile_nodes.bag import growing_file
from tactile_nodes.bag.metadata import BagTopic
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bag.stamps import header_stamp_ns
from tactile_nodes.bag.writer import BagLimits, BagWriter
from tactile_nodes.errors import BagError
from tactile_nodes.messages import types


def summary_of(file: Path):
    with file.open('rb') as opened:
        reader = mcap.reader.make_reader(opened)
        return reader.get_header(), reader.get_summary()


def metadata_of(folder: Path):
    return yaml.safe_load((folder / 'metadata.yaml').read_text())['rosbag2_bagfile_information']


def test_the_bytes_that_came_in_are_what_is_stored(bag: Path) -> None:
    with BagReader(bag) as reader:
        found = [Sample(message.topic, message.log_ns, message.data) for message in reader.messages()]
    assert found == samples(10)


def test_publish_time_is_the_capture_stamp_where_there_is_one(bag: Path) -> None:
    with BagReader(bag) as reader:
        first, second = list(reader.messages())[:2]
    assert (first.topic, first.log_ns - first.publish_ns) == ('/force', 3_000_000)
    assert (second.topic, second.log_ns - second.publish_ns) == ('/text', 1_000_000)


def test_capture_stamp_is_read_from_the_bytes_in_either_byte_order() -> None:
    # XCDR1: 00 01 little endian, 00 00 big endian; then int32 sec, uint32 nanosec.
    little = bytes.fromhex('00010000 02000000 05000000 01000000 00')
    big = bytes.fromhex('00000000 00000002 00000005 00000001 00')
    assert header_stamp_ns(little, FORCE) == header_stamp_ns(big, FORCE) == 2_000_000_005


def test_stamp_that_nobody_set_is_no_capture_stamp() -> None:
    assert header_stamp_ns(messages.encode(types.ForceDistribution()), FORCE) is None


def test_negative_stamp_is_no_capture_stamp_and_the_recording_goes_on(tmp_path: Path) -> None:
    # As of a simulator near time zero that subtracts a latency of 10 ms: -1 s and 990 ms.
    negative = messages.encode(types.ForceDistribution(header=types.Header(stamp=types.Time(-1, 990_000_000))))
    content = [Sample('/force', START_NS, negative), *samples(3)]
    write(tmp_path / 'press', content)
    with BagReader(tmp_path / 'press') as reader:
        found = list(reader.messages())
    assert len(found) == 4
    assert found[0].publish_ns == START_NS - 1_000_000  # when it was sent


def test_file_is_mcap_of_profile_ros2_with_commented_definitions(bag: Path) -> None:
    header, summary = summary_of(bag / 'press_0.mcap')
    schema = next(schema for schema in summary.schemas.values() if schema.name == FORCE)
    assert header.profile == 'ros2'
    assert schema.encoding == 'ros2msg'
    assert b'# sum over the bins [N]' in schema.data
    assert {channel.message_encoding for channel in summary.channels.values()} == {'cdr'}
    assert summary.statistics.message_count == 10


def test_qos_of_the_storage_file_is_that_of_the_metadata(bag: Path) -> None:
    # Readers pair topics by this text; where it differs they find no message and say nothing.
    _, summary = summary_of(bag / 'press_0.mcap')
    stored = {channel.topic: channel.metadata['offered_qos_profiles'] for channel in summary.channels.values()}
    named = [entry['topic_metadata'] for entry in metadata_of(bag)['topics_with_message_count']]
    assert stored == {topic['name']: topic['offered_qos_profiles'] for topic in named}


@pytest.mark.parametrize('compression', ['none', 'lz4', 'zstd'])
def test_rosbags_reads_the_folder(tmp_path: Path, compression: str) -> None:
    write(tmp_path / 'press', samples(10), compression)
    with Reader(tmp_path / 'press') as reader:
        found = [Sample(connection.topic, log_ns, data) for connection, log_ns, data in reader.messages()]
    assert found == samples(10)


def test_messages_that_arrive_late_are_put_in_order(tmp_path: Path) -> None:
    content = samples(10)
    write(tmp_path / 'press', [content[number] for number in (1, 0, 3, 2, 4, 7, 6, 5, 8, 9)])
    with Reader(tmp_path / 'press' / 'press_0.mcap') as reader:
        assert [log_ns for _, log_ns, _ in reader.messages()] == [sample.log_ns for sample in content]


def test_folder_that_exists_is_refused_and_left_alone(tmp_path: Path) -> None:
    (tmp_path / 'press').mkdir()
    (tmp_path / 'press' / 'keep').touch()
    with pytest.raises(BagError, match='already exists and is not overwritten'):
        BagWriter(tmp_path / 'press')
    assert [file.name for file in (tmp_path / 'press').iterdir()] == ['keep']


def test_folder_below_a_file_is_refused_in_one_sentence(tmp_path: Path) -> None:
    (tmp_path / 'file').touch()
    with pytest.raises(BagError, match=r'cannot create the folder .*/file/press for the bag: Not a directory'):
        BagWriter(tmp_path / 'file' / 'press')


def test_unknown_compression_is_refused_before_anything_is_made(tmp_path: Path) -> None:
    with pytest.raises(BagError, match='none, lz4, zstd'):
        BagWriter(tmp_path / 'press', compression='zip')
    assert not (tmp_path / 'press').exists()


def test_bag_without_messages_is_a_bag(tmp_path: Path) -> None:
    write(tmp_path / 'empty', [])
    with BagReader(tmp_path / 'empty') as reader:
        assert (list(reader.messages()), reader.problems) == ([], [])
    with Reader(tmp_path / 'empty') as other:
        assert other.message_count == 0


def test_closed_bag_takes_no_more(tmp_path: Path) -> None:
    writer = write(tmp_path / 'press', samples(2))
    with pytest.raises(BagError, match='is closed'):
        writer.write('/text', text(0), START_NS, START_NS)


def in_small_files(folder: Path, count: int) -> list[int]:
    """Record so many messages, a file each as long as there may be more files; how many each file has."""
    write_in_files(folder, count)
    return [entry['message_count'] for entry in metadata_of(folder)['files']]


def test_splits_when_a_file_is_long_enough_and_there_is_more(tmp_path: Path) -> None:
    # `ros2 bag reindex` takes the earliest of the files' times; that of a file without messages is 1970.
    assert in_small_files(tmp_path / 'press', 3) == [1, 1, 1]
    with BagReader(tmp_path / 'press') as reader:
        assert [reader.decode(message).data for message in reader.messages()] == ['number 0', 'number 1', 'number 2']


def test_slow_disk_drops_counts_and_never_blocks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    disk_is_free = threading.Event()
    pwrite = os.pwrite

    def slow_pwrite(descriptor, data, offset):
        assert offset == 0 or disk_is_free.wait(20)  # the head of the file is written at once
        return pwrite(descriptor, data, offset)

    monkeypatch.setattr(growing_file.os, 'pwrite', slow_pwrite)
    writer = BagWriter(tmp_path / 'press', limits=BagLimits(queue_bytes=1000))
    writer.add_topic(BagTopic.of_type('/force', FORCE))
    data = force(1, START_NS)
    room = 1000 // len(data)
    taken = [writer.write('/force', data, START_NS + number, START_NS) for number in range(room + 3)]
    disk_is_free.set()
    totals = writer.close()
    assert taken == [True] * room + [False] * 3
    assert (totals.messages, totals.dropped, writer.dropped_of['/force']) == (room, 3, 3)


def test_a_recording_is_not_split_into_more_files_than_can_be_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in ('reader', 'writer'):
        monkeypatch.setattr(f'tactile_nodes.bag.{module}.MOST_FILES', 2)
    assert in_small_files(tmp_path / 'press', 4) == [1, 3]
    with BagReader(tmp_path / 'press') as reader:
        assert len(list(reader.messages())) == 4
