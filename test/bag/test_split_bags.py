"""Bags of several files: each is read when its time has come, since a file that is read keeps a chunk in memory."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from bagging import Sample, samples, write

from tactile_nodes.bag.content import BagMessage, Selection
from tactile_nodes.bag.mcap_storage import McapStorage
from tactile_nodes.bag.reader import BagReader


@pytest.fixture
def begun(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Collects the names of the files whose messages are being read, in the order in which that began."""
    names: list[str] = []
    messages = McapStorage.messages

    def watched(self: McapStorage, selection: Selection) -> Iterator[BagMessage]:
        names.append(self.path.name)
        yield from messages(self, selection)

    monkeypatch.setattr(McapStorage, 'messages', watched)
    return names


def _bag_of(folder: Path, *parts: list[Sample]) -> Path:
    """A folder without metadata that holds one file for each part."""
    bag = folder / 'bag'
    bag.mkdir()
    for number, part in enumerate(parts):
        write(folder / f'part{number}', part)
        (folder / f'part{number}' / f'part{number}_0.mcap').rename(bag / f'bag_{number}.mcap')
    return bag


def test_files_that_follow_each_other_are_begun_one_after_the_other(tmp_path: Path, begun: list[str]) -> None:
    content = samples(12)
    with BagReader(_bag_of(tmp_path, content[8:], content[:4], content[4:8])) as bag:
        messages = bag.messages()
        first = next(messages)
        assert begun == ['bag_1.mcap']
        found = [first, *messages]
    assert begun == ['bag_1.mcap', 'bag_2.mcap', 'bag_0.mcap']
    assert [Sample(each.topic, each.log_ns, each.data) for each in found] == content


def test_files_of_the_same_time_are_merged(tmp_path: Path, begun: list[str]) -> None:
    content = samples(12)
    with BagReader(_bag_of(tmp_path, content[9:], content[:9:2], content[1:9:2])) as bag:
        found = [Sample(each.topic, each.log_ns, each.data) for each in bag.messages()]
    assert sorted(begun[:2]) == ['bag_1.mcap', 'bag_2.mcap']
    assert found == content


def test_message_at_the_end_of_one_file_and_the_beginning_of_the_next_is_read_from_both(tmp_path: Path) -> None:
    content = samples(6)
    with BagReader(_bag_of(tmp_path, content[:4], content[3:])) as bag:
        assert [each.log_ns for each in bag.messages()] == [
            each.log_ns for each in [*content[:4], content[3], *content[4:]]
        ]
