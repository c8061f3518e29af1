"""Reads one SQLite file of a rosbag2 folder, as ROS 2 up to Humble records by default."""

from __future__ import annotations

import os
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
from tactile_nodes.files import open_plain

MAGIC = b'SQLite format 3\x00'
_NS_LIMITS = (-(2**63), 2**63 - 1)
_MOST_TOPICS = 100_000
_TOPIC_TEXTS = ('name', 'type', 'serialization_format')
_KINDS = {'id': 'integer', 'topic_id': 'integer', 'timestamp': 'integer', 'data': 'blob'}
_SOUND = ' AND '.join(f"typeof({name}) = '{kind}'" for name, kind in _KINDS.items())
_WHOLE = f'FROM messages NOT INDEXED WHERE {_SOUND}'
_STEPS, _STEPS_A_BYTE = 100_000, 20  # of SQLite's virtual machine; to open a bag of empty messages takes 3 a byte
_OTHERS = f'SELECT count(*) FROM messages NOT INDEXED WHERE NOT ({_SOUND})'  # noqa: S608 - our own names


class SqliteStorage:
    """The file is only read, also if a killed recorder left its journal beside it.

    Raises:
        BagError: it is not a bag, or its description is damaged.
    """

    def __init__(self, path: Path, complain: Complain) -> None:
        self.path = path
        self._complain = complain
        if _is_cut_off(path):
            complain(f'{path} is cut off at byte {path.stat().st_size}; reading the rest')
        self._connection, passed_over = _connect(path)
        if passed_over:
            complain(
                f'{path}: {passed_over} cannot be used in this folder, so messages may be missing; '
                'copy it with the bag to a writable folder'
            )
        self._connection.set_progress_handler(_Patience(path), _STEPS)
        try:
            self._connection.execute('PRAGMA trusted_schema = OFF')
            self._by_id = self._read_topics()
            self.topics = {topic.name: topic for topic in self._by_id.values()}
            self.counts, self.extent = self._count()
            self._connection.set_progress_handler(None, 0)
        except BagError:
            self._connection.close()
            raise
        except (sqlite3.Error, UnicodeDecodeError) as error:
            self._connection.close()
            why = 'its pages reference each other in a circle' if str(error) == 'interrupted' else error
            raise BagError(f'{path} is damaged or not a bag: {why}') from error

    def close(self) -> None:
        self._connection.close()

    def messages(self, selection: Selection) -> Iterator[BagMessage]:
        """The selected messages in order of receive times, up to where the file is damaged."""
        low, high = (min(max(limit, _NS_LIMITS[0]), _NS_LIMITS[1]) for limit in (selection.start_ns, selection.end_ns))
        # Not by the index of times: if the index is damaged, messages would silently be missing.
        query = f'SELECT rowid, topic_id, timestamp {_WHOLE} AND timestamp BETWEEN ? AND ? ORDER BY timestamp, rowid'
        try:
            for row, topic_id, log_ns in self._connection.execute(query, (low, high)):
                topic = self._by_id.get(topic_id)
                if topic is not None and topic.encoding == 'cdr' and selection.wants(topic.name, log_ns):
                    yield self._message(topic, row, log_ns)
        except (sqlite3.Error, MemoryError, OverflowError) as error:
            self._complain(f'{self.path} is damaged ({error}); read up to there')

    def _message(self, topic: BagTopic, row: int, log_ns: int) -> BagMessage:
        found = self._connection.execute('SELECT data FROM messages WHERE rowid = ?', (row,)).fetchone()
        if found is None:
            raise sqlite3.DatabaseError('a message is missing at its position')
        data = found[0]
        stamp_ns = header_stamp_ns(data, topic.type_name)
        return BagMessage(topic.name, topic.type_name, log_ns, log_ns if stamp_ns is None else stamp_ns, data)

    def _read_topics(self) -> dict[int, BagTopic]:
        definitions = self._read_definitions()
        found: dict[int, BagTopic] = {}
        for row in self._rows('topics'):
            if not isinstance(row['id'], int) or not all(isinstance(row[name], str) for name in _TOPIC_TEXTS):
                self._complain(f'{self.path}: a topic is left out, because its description has cells of wrong types')
                continue
            encoding, text = definitions.get(row['type'], ('', ''))
            type_hash, qos = (str(row.get(name) or '') for name in ('type_description_hash', 'offered_qos_profiles'))
            found[row['id']] = BagTopic(
                row['name'], row['type'], text, type_hash, qos, row['serialization_format'], encoding
            )
        return found

    def _read_definitions(self) -> dict[str, tuple[str, str]]:
        # Only real tables: a view may be endless, and a computed column may generate data.
        rows = self._connection.execute("SELECT name FROM sqlite_master WHERE type = 'table' AND rootpage > 0")
        tables = {name for (name,) in rows}
        if not {'topics', 'messages'} <= tables:
            raise BagError(f'{self.path} is an SQLite file, but not a bag: it has no tables topics and messages')
        self._require('topics', {'id', *_TOPIC_TEXTS})
        self._require('messages', set(_KINDS))
        if 'message_definitions' not in tables:
            return {}
        self._require('message_definitions', {'topic_type', 'encoding', 'encoded_message_definition'})
        return {
            str(row['topic_type']): (str(row['encoding']), str(row['encoded_message_definition']))
            for row in self._rows('message_definitions')
        }

    def _require(self, table: str, columns: set[str]) -> None:
        found = self._connection.execute(f'PRAGMA table_xinfo({table})').fetchall()
        if missing := columns - {str(row[1]) for row in found if row[6] == 0}:
            raise BagError(f'{self.path} is not a bag: its table {table} has no column {", ".join(sorted(missing))}')
        if any(row[6] for row in found):
            raise BagError(f'{self.path} is not a bag: its table {table} has computed columns')

    def _rows(self, table: str) -> Iterator[dict[str, Any]]:
        cursor = self._connection.execute(f'SELECT * FROM {table} LIMIT {_MOST_TOPICS}')  # noqa: S608 - our own names
        columns = [column[0] for column in cursor.description]
        return (dict(zip(columns, row, strict=True)) for row in cursor)

    def _count(self) -> tuple[dict[str, int], Extent]:
        query = f'SELECT topic_id, count(*), min(timestamp), max(timestamp) {_WHOLE} GROUP BY topic_id'
        counts: dict[str, int] = {}
        parts = []
        for topic_id, count, start_ns, end_ns in self._connection.execute(query):
            topic = self._by_id.get(topic_id)
            if topic is not None and topic.encoding == 'cdr':
                counts[topic.name] = count
                parts.append(Extent(count, start_ns, end_ns))
        (others,) = self._connection.execute(_OTHERS).fetchone()
        if others:
            self._complain(f'{self.path}: messages left out because they have cells of wrong types: {others}')
        return counts, Extent.union(parts)


class _Patience:
    """Aborts the opening of an endless file: pages that reference each other in a circle give rows without end."""

    def __init__(self, path: Path) -> None:
        size = sum(each.stat().st_size for each in (path, Path(f'{path}-wal')) if each.is_file())
        self._left = 10 + size * _STEPS_A_BYTE // _STEPS

    def __call__(self) -> bool:
        self._left -= 1
        return self._left < 0


def _is_cut_off(path: Path) -> bool:
    """SQLite silently reads a truncated file, so compare its length with the one in its header."""
    with open_plain(path) as file:
        head = file.read(32)
    if len(head) < 32:
        return True
    # https://www.sqlite.org/fileformat.html 1.3: page size at 16 (1 means 65536), number of pages at 28.
    page_size, pages = struct.unpack_from('>H', head, 16)[0], struct.unpack_from('>I', head, 28)[0]
    return bool(path.stat().st_size < (65536 if page_size == 1 else page_size) * pages)


def _connect(path: Path) -> tuple[sqlite3.Connection, str]:
    """The open file, and the files beside it that were skipped.

    A journal that cannot be opened (read-only folder) is skipped in the second try.
    """
    beside = [each for each in (Path(f'{path}{ending}') for ending in ('-journal', '-wal')) if os.path.lexists(each)]
    for each in beside:
        if not each.is_file():  # SQLite would wait for a named pipe
            raise BagError(f'{each} is not a file; move it away from {path.name}')
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
            left = [each.name for each in beside if each.stat().st_size] if mode != 'mode=ro' else []
            return connection, ' and '.join(left)
    raise BagError(f'cannot open {path}: SQLite refuses it; is another program writing it?')
