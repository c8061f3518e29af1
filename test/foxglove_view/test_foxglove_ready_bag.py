"""A bag is what Foxglove opens: indexed, and with every definition inside (foxglove.dev, "MCAP for ROS 2")."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.summary import Summary

from tactile_nodes import messages
from tactile_nodes.bag.metadata import BagTopic
from tactile_nodes.bag.writer import BagWriter
from tactile_nodes.bus.topics import TOPICS
from tactile_nodes.paths import share_directory


def laid_out() -> dict[str, str]:
    """The topics that the layout shows, with their types."""
    text = (share_directory() / 'config/foxglove/tactile.json').read_text(encoding='utf-8')
    names = {name.partition('.')[0] for name in re.findall(r'"(/[^"]*)"', json.dumps(json.loads(text)))}
    return {name: (TOPICS.get(name) or TOPICS[name[1:]]).type_name for name in names}


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A message of each topic of the layout."""
    writer = BagWriter(tmp_path_factory.mktemp('foxglove') / 'touch')
    for number, (name, type_name) in enumerate(laid_out().items(), start=1):
        writer.add_topic(BagTopic.of_type(name, type_name))
        writer.write(name, messages.encode(messages.message_class(type_name)()), number, number, 1)
    writer.close()
    return writer.folder / 'touch_0.mcap'


@pytest.fixture
def summary(bag: Path) -> Summary:
    with bag.open('rb') as stream:
        found = make_reader(stream).get_summary()
    assert found is not None, 'without a summary Foxglove reads the whole file before it shows anything'
    return found


def test_it_is_marked_as_ros_2s(bag: Path) -> None:
    with bag.open('rb') as stream:
        assert make_reader(stream).get_header().profile == 'ros2'


def test_its_chunks_are_indexed_for_every_message(summary: Summary) -> None:
    assert summary.chunk_indexes
    assert all(index.message_index_offsets for index in summary.chunk_indexes)
    assert summary.statistics is not None
    assert summary.statistics.message_count == len(laid_out())


def test_each_topic_of_the_layout_has_its_definition_inside(summary: Summary) -> None:
    inside = {
        channel.topic: (channel.message_encoding, schema.encoding, schema.name, schema.data.decode())
        for channel in summary.channels.values()
        for schema in (summary.schemas[channel.schema_id],)
    }
    assert inside == {name: ('cdr', 'ros2msg', kind, messages.definition(kind)) for name, kind in laid_out().items()}
