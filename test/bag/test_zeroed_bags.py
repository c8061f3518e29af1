"""Bags after a power cut, which may leave zeros behind what was written; and chunks that need not be read."""

from __future__ import annotations

import time
from collections import Counter
from io import BytesIO
from pathlib import Path

import pytest
from bagging import START_NS, force, samples, text, write

from tactile_nodes.bag import mcap_records
from tactile_nodes.bag.metadata import BagTopic
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bag.writer import BagWriter

ZEROS = bytes(4096)


def test_topics_are_counted_as_they_are_read_wherever_the_zeros_begin(tmp_path: Path) -> None:
    write(tmp_path / 'whole', samples(12), 'zstd')
    data = (tmp_path / 'whole/whole_0.mcap').read_bytes()
    file = tmp_path / 'zeroed.mcap'
    records = list(mcap_records.walk(BytesIO(data), 8, len(data)))
    for end in (end for each in records for end in (each.start, each.start + each.length // 2)):
        file.write_bytes(data[:end] + ZEROS)
        with BagReader(file) as bag:
            found = Counter(message.topic for message in bag.messages())
            assert +Counter(bag.counts) == found, end
            assert len(list(bag.messages(['/text']))) == found['/text'], end


def test_chunks_without_the_wanted_topics_are_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    writer = BagWriter(tmp_path / 'bag')
    writer.add_topic(BagTopic.of_type('/text', 'std_msgs/msg/String'))
    writer.add_topic(BagTopic.of_type('/force', 'tactile_nodes/msg/ForceDistribution'))
    writer.write('/text', text(0), START_NS, START_NS)
    while not writer.totals.messages:  # then its chunk is in the file
        time.sleep(0.01)
    for second in (1, 2):
        at_ns = START_NS + second * 1_000_000_000
        writer.write('/force', force(second, at_ns), at_ns, at_ns)
    writer.close()
    unpacked = []
    unpack = mcap_records.unpack_chunk
    monkeypatch.setattr(mcap_records, 'unpack_chunk', lambda *part: unpacked.append(part) or unpack(*part))
    with BagReader(tmp_path / 'bag') as bag:
        assert [message.topic for message in bag.messages(['/text'])] == ['/text']
    assert len(unpacked) == 1
