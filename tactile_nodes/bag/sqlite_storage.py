"""Reads one SQLite file of a rosbag2 folder, as ROS 2 up to Humble records by default."""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

from tactile_nodes.bag.content import BagMessage, Complain, Selection
from tactile_nodes.bag.metadata import BagTopic, Extent
from tactile_nodes.bag.stamps import header_stamp_ns
from tactile_nodes.errors import BagError

MAGIC = b'SQLite format 3\x00'
_NS_LIMITS = (-(2**63), 2**63 - 1)


class SqliteStorage:
    """The file is only read, also when a recorder that was killed left its journal beside it.

    Raises:
        BagError: it is no bag, or damaged where it describes itself.
    """

    def __init__(self, path: Path, complain: Complain) -> None:
        self.path = path
        self._complain = complain
        if _is_cut_off(path):
            complain(f'{path} is cut off at byte {path.stat().st_size}; read what is left')
        self._connection = _connect(path)
        try:
            self._by_id = self._read_topics()
            self.topics = {topic.name: topic for topic in self._by_id.values()}
            self.counts, self.extent = self._count()
        except sqlite3.Error as error:
            self._connection.close()
            raise BagError(f'{path} is damaged or no bag: {error}') from error

    def close(self) -> None:
        self._connection.close()

    def messages(self, selection: Selection) -> Iterator[BagMessage]:
        """In order of receive times, up to where the file is damaged."""
        low, high = (min(max(limit, _NS_LIMITS[0]), _NS_LIMITS[1]) for limit in (selection.start_ns, selection.end_ns))
        query = 'SELECT topic_id, timestamp, data FROM messages WHERE timestamp BETWEEN ? AND ? ORDER BY timestamp, id'
        try:
            for topic_id, log_ns, data in self._connection.execute(query, (low, high)):
                topic = self._by_id.get(topic_id)
                if topic is not None and topic.encoding == 'cdr' and selection.wants(topic.name, log_ns):
                    stamp_ns = header_stamp_ns(data, topic.type_name)
                    yield BagMessage(
                        topic.name, topic.type_name, log_ns, log_ns if stamp_ns is None else stamp_ns, data
                    )
        except sqlite3.Error as error:
            self._complain(f'{self.path} is damaged ({error}); read up to there')

    def _read_topics(self) -> dict[int, BagTopic]:
        definitions = self._read_definitions()
        found = {}
        for row in self._rows('topics'):
            type_name = str(row['type'])
            encoding, text = definitions.get(type_name, ('', ''))
            found[int(row['id'])] = BagTopic(
                str(row['name']),
                type_name,
                text,
                str(row.get('type_description_hash') or ''),
                str(row.get('offered_qos_profiles') or ''),
                str(row['serialization_format']),
                encoding,
            )
        return found

    def _read_definitions(self) -> dict[str, tuple[str, str]]:
        tables = {row['name'] for row in self._rows('sqlite_master')}
        if not {'topics', 'messages'} <= tables:
            raise BagError(f'{self.path} is an SQLite file, but no bag: it has no tables topics and messages')
        if 'message_definitions' not in tables:
            return {}
        return {
            str(row['topic_type']): (str(row['encoding']), str(row['encoded_message_definition']))
            for row in self._rows('message_definitions')
        }

    def _rows(self, table: str) -> Iterator[dict[str, Any]]:
        cursor = self._connection.execute(f'SELECT * FROM {table}')  # noqa: S608 - our own names
        columns = [column[0] for column in cursor.description]
        return (dict(zip(columns, row, strict=True)) for row in cursor)

    def _count(self) -> tuple[dict[str, int], Extent]:
        query = 'SELECT topic_id, count(*), min(timestamp), max(timestamp) FROM messages GROUP BY topic_id'
        counts: dict[str, int] = {}
        parts = []
        for topic_id, count, start_ns, end_ns in self._connection.execute(query):
            topic = self._by_id.get(topic_id)
            if topic is not None and topic.encoding == 'cdr':
                counts[topic.name] = count
                parts.append(Extent(count, start_ns, end_ns))
        return counts, Extent.union(parts)


def _is_cut_off(path: Path) -> bool:
    """SQLite reads a shortened file without a word, so compare its length with what its head says."""
    with path.open('rb') as file:
        head = file.read(32)
    if len(head) < 32:
        return True
    # https://www.sqlite.org/fileformat.html 1.3: page size at 16 (1 means 65536), number of pages at 28.
    page_size, pages = struct.unpack_from('>H', head, 16)[0], struct.unpack_from('>I', head, 28)[0]
    return bool(path.stat().st_size < (65536 if page_size == 1 else page_size) * pages)


def _connect(path: Path) -> sqlite3.Connection:
    # A journal that cannot be opened (a folder we may not write to) is passed over by the second try.
    for mode in ('mode=ro', 'immutable=1'):
        connection = sqlite3.connect(f'file:{quote(str(path))}?{mode}', uri=True, check_same_thread=False)
        try:
            connection.execute('SELECT count(*) FROM sqlite_master').fetchone()
        except sqlite3.OperationalError:
            connection.close()
        except sqlite3.Error as error:
            connection.close()
            raise BagError(f'{path} is damaged: {error}') from error
        else:
            return connection
    raise BagError(f'cannot open {path}: SQLite refuses it; is it being written by somebody else?')
