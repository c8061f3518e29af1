"""Bags that somebody made to harm, or that are no files at all: messages or a sentence, soon, and never a traceback."""

from __future__ import annotations

import os
import shutil
import sqlite3
import struct
from pathlib import Path

import pytest
from bagging import START_NS, STRING, refusal, text
from mcap.opcode import Opcode
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from tactile_nodes.bag import growing_file
from tactile_nodes.bag.metadata import BagTopic
from tactile_nodes.bag.reader import BagReader

COUNT = 200
LEAF, INTERIOR = 0x0D, 0x05
HEAD = """rosbag2_bagfile_information:
  version: 8
  storage_identifier: mcap
  message_count: 0
  topics_with_message_count: []
  relative_file_paths:
{names}
"""


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """An SQLite bag of texts, numbered."""
    writer = Writer(tmp_path / 'press', version=8, storage_plugin=StoragePlugin.SQLITE3)
    with writer:
        connection = writer.add_connection('/text', STRING, typestore=get_typestore(Stores.ROS2_HUMBLE))
        for number in range(COUNT):
            writer.write(connection, START_NS + number, text(number))
    return tmp_path / 'press' / 'press.db3'


def numbers(path: Path) -> tuple[list[int], list[str]]:
    with BagReader(path) as reader:
        found = [message.log_ns - START_NS for message in reader.messages()]
        return found, reader.problems


def change(path: Path, *statements: str) -> None:
    connection = sqlite3.connect(path)
    for statement in statements:
        connection.execute(statement)
    connection.commit()
    connection.close()


def test_a_damaged_index_of_times_hides_no_message(bag: Path) -> None:
    data = bytearray(bag.read_bytes())
    connection = sqlite3.connect(bag)
    (page,) = connection.execute("SELECT rootpage FROM sqlite_master WHERE name = 'timestamp_idx'").fetchone()
    connection.close()
    data[page * 4096 - 600 : page * 4096] = bytes(600)  # where its first entries stand
    bag.write_bytes(data)
    assert numbers(bag) == (list(range(COUNT)), [])


def test_messages_with_cells_of_wrong_types_are_left_out_and_reported(bag: Path) -> None:
    change(
        bag,
        "UPDATE messages SET data = 'no bytes' WHERE id = 1",
        "UPDATE messages SET timestamp = 'noon' WHERE id = 2",
        "UPDATE messages SET topic_id = x'00' WHERE id = 3",
        'UPDATE messages SET timestamp = 1.5 WHERE id = 4',
    )
    assert numbers(bag) == (
        list(range(4, COUNT)), [f'{bag}: messages left out because they have cells of wrong types: 4']
    )  # fmt: skip


def test_a_topic_with_cells_of_wrong_types_is_left_out_and_reported(bag: Path) -> None:
    change(bag, "UPDATE topics SET name = x'ff'")
    assert numbers(bag) == (
        [], [f'{bag}: a topic is left out, because its description has cells of wrong types']
    )  # fmt: skip


@pytest.mark.parametrize(
    ('statement', 'reason'),
    [
        (
            'CREATE VIEW messages AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) '
            "SELECT i AS id, 1 AS topic_id, i AS timestamp, x'00' AS data FROM n",
            'it has no tables topics and messages',
        ),
        (
            'CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, '
            'data BLOB GENERATED ALWAYS AS (zeroblob(900000000)))',
            'its table messages has no column data',
        ),
        (
            'CREATE TABLE messages (id INTEGER PRIMARY KEY)',
            'its table messages has no column data, timestamp, topic_id',
        ),
    ],
)
def test_what_only_looks_like_a_table_of_messages_is_refused(bag: Path, statement: str, reason: str) -> None:
    change(bag, 'DROP TABLE messages', statement)
    assert reason in refusal(bag)


@pytest.mark.parametrize('name', ['a.mcap', 'a.db3', 'metadata.yaml'])
def test_a_named_pipe_is_refused_and_not_waited_for(tmp_path: Path, name: str) -> None:
    (tmp_path / 'bag').mkdir()
    os.mkfifo(tmp_path / 'bag' / name)
    assert refusal(tmp_path / 'bag') == f'cannot read {tmp_path / "bag" / name}: it is not a regular file'


def test_metadata_of_a_length_that_no_bag_needs_are_not_read(tmp_path: Path) -> None:
    with (tmp_path / 'metadata.yaml').open('wb') as file:
        file.truncate(20 << 30)
    assert refusal(tmp_path).endswith('it has 21474836480 bytes, more than the limit of 1048576')


def test_more_files_than_can_be_opened_are_refused_in_one_sentence(tmp_path: Path) -> None:
    for number in range(1001):
        (tmp_path / f'bag_{number}.mcap').touch()
    assert (
        refusal(tmp_path) == f'{tmp_path} lists 1001 files, but at most 1000 can be read; open some of them separately'
    )


def test_of_many_files_that_are_missing_three_are_named(tmp_path: Path) -> None:
    names = [f'bag_{number}.mcap' for number in range(500)]
    (tmp_path / 'metadata.yaml').write_text(
        'rosbag2_bagfile_information: {version: 8, storage_identifier: mcap, message_count: 0, '
        f'topics_with_message_count: [], relative_file_paths: [{", ".join(names)}]}}'
    )
    assert 'lists bag_0.mcap, bag_1.mcap, bag_2.mcap and 497 more, which is not' in refusal(tmp_path)


@pytest.mark.parametrize('opcode', [Opcode.MESSAGE, Opcode.CHUNK, Opcode.SCHEMA, Opcode.CHANNEL])
def test_a_record_of_gigabytes_of_nothing_is_not_read(tmp_path: Path, opcode: Opcode) -> None:
    length = 20 << 30
    head = struct.pack('<QQQII', 0, 1, length, 0, 0) + struct.pack('<Q', length - 40)
    with (tmp_path / 'a.mcap').open('wb') as file:
        file.write(growing_file.MAGIC + struct.pack('<BQ', opcode, length) + head)
        file.truncate(file.tell() + length)
    with BagReader(tmp_path / 'a.mcap') as reader:
        assert list(reader.messages()) == []
        assert reader.problems


def test_many_names_of_files_are_counted_soon(tmp_path: Path) -> None:
    """Of 60 000 a YAML reader in Python took a quarter of a minute."""
    names = '\n'.join(f'  - {number}.mcap' for number in range(6_000))
    (tmp_path / 'metadata.yaml').write_text(HEAD.format(names=names))
    assert 'lists 6000 files, but at most 1000 can be read' in refusal(tmp_path)


def test_a_few_lines_that_unfold_to_gigabytes_are_refused(tmp_path: Path) -> None:
    folded = '\n'.join(f'x{level}: &x{level} [{", ".join(9 * [f"*x{level - 1}"])}]' for level in range(1, 10))
    (tmp_path / 'metadata.yaml').write_text(f'x0: &x0 x\n{folded}\n{HEAD.format(names="  - *x9")}')
    assert 'is damaged and does not describe the bag' in refusal(tmp_path)


@pytest.mark.parametrize(
    'qos', ['- durability: 2001-99-99', 3000 * '[', '- durability: *x', '[{durability: !!int "x"}]']
)
def test_a_quality_of_service_that_is_none_keeps_no_message(qos: str) -> None:
    assert BagTopic('/text', STRING, qos=qos).latched is False


def test_messages_whose_numbers_are_all_alike_keep_their_data(bag: Path) -> None:
    change(
        bag, 'CREATE TABLE others (id INTEGER, topic_id INTEGER, timestamp INTEGER, data BLOB)',
        'INSERT INTO others SELECT 1, topic_id, timestamp, data FROM messages', 'DROP TABLE messages',
        'ALTER TABLE others RENAME TO messages',
    )  # fmt: skip
    with BagReader(bag) as reader:
        assert [message.data for message in reader.messages()] == [text(number) for number in range(COUNT)]


@pytest.mark.parametrize('ending', ['-journal', '-wal'])
def test_a_named_pipe_beside_a_bag_is_not_waited_for(bag: Path, ending: str) -> None:
    os.mkfifo(f'{bag}{ending}')
    assert 'is not a file; move it away from press.db3' in refusal(bag)


def test_a_journal_that_cannot_be_read_is_reported(bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a folder that the reader may not write to SQLite opens no WAL; root may write to every folder."""
    connection = sqlite3.connect(bag)
    connection.execute('PRAGMA journal_mode = WAL')
    connection.execute('PRAGMA wal_autocheckpoint = 0')
    connection.execute('DELETE FROM messages WHERE id > 5')
    connection.commit()
    shutil.copytree(bag.parent, bag.parent.with_name('copied'), ignore=shutil.ignore_patterns('*-shm'))
    connection.close()
    copied = bag.parent.with_name('copied') / bag.name
    real = sqlite3.connect

    class Refusing(sqlite3.Connection):
        def execute(self, *_: object) -> sqlite3.Cursor:
            raise sqlite3.OperationalError('attempt to write a readonly database')

    monkeypatch.setattr(
        sqlite3, 'connect',
        lambda name, **options: real(name, **options, factory=Refusing if 'mode=ro' in name else sqlite3.Connection),
    )  # fmt: skip
    found, problems = numbers(copied)
    assert len(found) == COUNT
    assert problems == [
        f'{copied}: press.db3-wal cannot be used in this folder, so messages may be missing; '
        'copy it with the bag to a writable folder'
    ]


def test_pages_that_go_in_a_circle_are_no_reason_to_count_for_ever(tmp_path: Path) -> None:
    """Interior pages of the table of messages (fileformat.html 1.6) name their child a hundred times, seven deep."""
    path, size = tmp_path / 'circle.db3', 1024
    connection = sqlite3.connect(path)
    connection.execute(f'PRAGMA page_size = {size}')
    connection.execute('CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)')
    connection.execute('CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)')
    connection.executemany('INSERT INTO messages VALUES (?, 1, ?, ?)', [(n, n, text(n)) for n in range(1, 4000)])
    connection.commit()
    (root,) = connection.execute("SELECT rootpage FROM sqlite_master WHERE name = 'messages'").fetchone()
    connection.close()
    data = bytearray(path.read_bytes())
    leaf, *others = [page for page in range(root + 1, len(data) // size) if data[(page - 1) * size] == LEAF]
    for page, child in zip([*others[:7], root], [leaf, *others[:7]], strict=True):
        offsets = [size - 5 * (number + 1) for number in range(100)]
        interior = bytearray(size)
        struct.pack_into('>BHHHBI', interior, 0, INTERIOR, 0, 100, offsets[-1], 0, child)
        for number, offset in enumerate(offsets):
            struct.pack_into('>H', interior, 12 + 2 * number, offset)
            struct.pack_into('>IB', interior, offset, child, number + 1)
        data[(page - 1) * size : page * size] = interior
    path.write_bytes(data)
    assert 'its pages reference each other in a circle' in refusal(path)
