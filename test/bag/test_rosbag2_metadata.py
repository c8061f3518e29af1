"""What the tools of ROS 2 read of a bag before its first message, checked against what rosbag2's source takes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mcap.reader
import mcap.records
import pytest
import rosbag2_yaml
from bagging import FORCE, START_NS, STEP_NS, STRING, samples, write, write_in_files

from tactile_nodes import messages


def record_of(file: Path) -> Any:
    """The node that `MCAPStorage::read_metadata` decodes: of the records `rosbag2` the text `serialized_metadata`."""
    with file.open('rb') as opened:
        found = [entry for entry in mcap.reader.make_reader(opened).iter_metadata() if entry.name == 'rosbag2']
    (record,) = found
    return rosbag2_yaml.load(record.metadata['serialized_metadata'])


def channels_of(file: Path) -> dict[str, mcap.records.Channel]:
    with file.open('rb') as opened:
        summary = mcap.reader.make_reader(opened).get_summary()
    assert summary is not None
    return {channel.topic: channel for channel in summary.channels.values()}


QOS = {
    'history': 1, 'reliability': 1, 'liveliness': 1, 'deadline': rosbag2_yaml.INFINITE,
    'lifespan': rosbag2_yaml.INFINITE, 'liveliness_lease_duration': rosbag2_yaml.INFINITE,
}  # fmt: skip
TOPICS = {
    '/force': {
        'type': FORCE, 'serialization_format': 'cdr', 'message_count': 5,
        'type_description_hash': messages.type_hash(FORCE), 'qos': [{**QOS, 'durability': 2, 'depth': 1}],
    },
    '/text': {
        'type': STRING, 'serialization_format': 'cdr', 'message_count': 5,
        'type_description_hash': messages.type_hash(STRING), 'qos': [{**QOS, 'durability': 1, 'depth': 10}],
    },
}  # fmt: skip
DISTRO = 'jazzy'
EXTENT = {'starting_time': START_NS, 'duration': 9 * STEP_NS, 'message_count': 10}


def expected(file: str) -> dict[str, Any]:
    return {
        'version': 8, 'storage_identifier': 'mcap', **EXTENT, 'topics': TOPICS, 'relative_file_paths': [file],
        'compression': ('', ''), 'files': [{'path': file, **EXTENT}], 'custom_data': {}, 'ros_distro': DISTRO,
    }  # fmt: skip


@pytest.fixture(autouse=True)
def _sourced(monkeypatch: pytest.MonkeyPatch) -> None:
    """What `ros2 bag info` calls the ROS distro is that of the recorder."""
    monkeypatch.setenv('ROS_DISTRO', DISTRO)


@pytest.mark.parametrize('compression', ['none', 'lz4', 'zstd'])
def test_the_record_in_a_closed_file_is_what_ros_2_bag_play_decodes(tmp_path: Path, compression: str) -> None:
    write(tmp_path / 'press', samples(10), compression)
    assert rosbag2_yaml.decoded(record_of(tmp_path / 'press' / 'press_0.mcap')) == expected('press_0.mcap')


def test_metadata_yaml_is_what_ros_2_bag_info_decodes(bag: Path) -> None:
    file = rosbag2_yaml.load((bag / 'metadata.yaml').read_text())
    assert list(file) == ['rosbag2_bagfile_information']
    assert rosbag2_yaml.decoded(file['rosbag2_bagfile_information']) == expected('press_0.mcap')


def test_quality_of_service_at_a_channel_is_what_ros_2_bag_play_decodes(bag: Path) -> None:
    channels = channels_of(bag / 'press_0.mcap')
    stored = {name: channel.metadata['offered_qos_profiles'] for name, channel in channels.items()}
    assert {name: rosbag2_yaml.channel_profiles(text) for name, text in stored.items()} == {
        name: topic['qos'] for name, topic in TOPICS.items()
    }
    assert {name: channel.metadata['topic_type_hash'] for name, channel in channels.items()} == {
        name: topic['type_description_hash'] for name, topic in TOPICS.items()
    }


def test_every_file_of_a_split_bag_has_a_record_that_is_decoded(tmp_path: Path) -> None:
    write_in_files(tmp_path / 'press', 3)
    for number in range(3):
        found = rosbag2_yaml.decoded(record_of(tmp_path / 'press' / f'press_{number}.mcap'))
        assert [entry['message_count'] for entry in found['files']] == [1] * (number + 1)
