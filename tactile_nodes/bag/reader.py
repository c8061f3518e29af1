"""Reads bags: rosbag2 folders, single .mcap and .db3 files; complete, cut off, or never closed."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import chain
from operator import attrgetter
from pathlib import Path
from types import TracebackType
from typing import Any

import zstandard

from tactile_nodes.bag import growing_file, sqlite_storage
from tactile_nodes.bag.content import ALWAYS_NS, BagMessage, Selection
from tactile_nodes.bag.mcap_records import LARGEST_BYTES, unpack_zstd
from tactile_nodes.bag.mcap_storage import McapStorage
from tactile_nodes.bag.metadata import FILE_NAME, LARGEST_METADATA_BYTES, MOST_FILES, BagMetadata, BagTopic, Extent
from tactile_nodes.bag.sqlite_storage import SqliteStorage
from tactile_nodes.bag.stamps import first_stamp_ns, header_stamp_ns
from tactile_nodes.bag.types import BagTypes
from tactile_nodes.clock import NS_PER_S
from tactile_nodes.errors import BagError
from tactile_nodes.files import open_plain, read_plain

Storage = McapStorage | SqliteStorage
_SUFFIXES = {'.mcap': 'mcap', '.db3': 'sqlite3'}
REACHES_S = 2.0, 20.0, 200.0, 1e9
"""How far back from the end of a bag to search first; the last is longer than any."""
_PACKED = '.zstd'  # behind the name of a file that ros2 bag record compressed as a whole
_ZSTD = b'\x28\xb5\x2f\xfd'  # how zstd begins; a message that is not compressed begins with 0


class BagReader:
    """A bag opened for reading.

    The content is taken from the storage files. ``metadata.yaml`` is only compared with them, because it may be
    outdated, or describe files that were cut off. `problems` holds a sentence for each inconsistency; more may be added
    while messages are read.

    Raises:
        BagError: there is no bag, or nothing in it can be read.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.problems: list[str] = []
        self.types = BagTypes()
        self._storages: list[Storage] = []
        try:
            self._open_all()
        except OSError as error:
            self.close()
            raise BagError(f'cannot read {error.filename or self.path}: {error.strerror}') from error
        except BagError:
            self.close()
            raise
        self.storage_id = 'mcap' if isinstance(self._storages[0], McapStorage) else 'sqlite3'
        self._take_stock()

    def __enter__(self) -> BagReader:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Close the files; closing twice is harmless."""
        for storage in self._storages:
            storage.close()

    def messages(
        self, topics: Iterable[str] | None = None, start_ns: int = ALWAYS_NS[0], end_ns: int = ALWAYS_NS[1]
    ) -> Iterator[BagMessage]:
        """The messages in order of their receive times, read on demand.

        Args:
            topics: only these; None: all.
            start_ns: only those received from this time on.
            end_ns: only those received before this time.
        """
        selection = Selection(None if topics is None else frozenset(topics), start_ns, end_ns)
        merged = chain.from_iterable(
            heapq.merge(*(storage.messages(selection) for storage in together), key=attrgetter('log_ns'))
            for together in _overlapping(self._storages)
        )
        return self._decompressed(merged)

    def decode(self, message: BagMessage) -> Any:
        """The message as an object, with the definition in the bag.

        Raises:
            MessageError: the bytes are not such a message, or its type is unknown.
        """
        return self.types.decode(message.data, message.type_name)

    def stamp_ns(self, message: BagMessage) -> int | None:
        """The stamp of its header, by the definition in the bag; None if it has no header, or no stamp is set."""
        return first_stamp_ns(message.data) if self.types.starts_with_header(message.type_name) else None

    def newest_stamps_ns(self, topics: Iterable[str]) -> dict[str, int]:
        """The newest stamp of each of the topics that has any; searched from the end, where most have messages."""
        left, found = {topic for topic in topics if self.counts.get(topic)}, dict[str, int]()
        for reach_s in REACHES_S:
            start_ns = self.extent.end_ns - round(reach_s * NS_PER_S)
            for message in self.messages(left, start_ns) if left else ():
                if (stamp_ns := self.stamp_ns(message)) is not None:
                    found[message.topic] = max(stamp_ns, found.get(message.topic, stamp_ns))
            left -= found.keys()
        return found

    # --- opening --------------------------------------------------------------------------------------------

    def _open_all(self) -> None:
        self.metadata, self.files = self._find()
        *before, last = self.files
        if before and _is_blank(last):
            self._complain(f'{last} is empty, as after a power cut at its start; reading the files before it')
            self.files = before
        for file in self.files:
            self._storages.append(_open(file, self._complain))
        self.size = sum(file.stat().st_size for file in self.files)

    def _find(self) -> tuple[BagMetadata, list[Path]]:
        if self.path.name == FILE_NAME:
            self.path = self.path.parent
        if not self.path.is_dir():
            if not self.path.exists():
                raise BagError(f'there is no bag {self.path}; give a folder, a .mcap file or a .db3 file')
            return BagMetadata(storage_id=''), [self.path]
        if (self.path / FILE_NAME).exists():
            return self._from_metadata()
        files, packed = self._storage_files(), self._packed_names()
        if packed and not files:
            raise self._compressed(packed)
        if not files:
            missing = f'it contains neither {FILE_NAME} nor .mcap or .db3 files'
            raise BagError(f'{self.path} is not a bag: {missing}{self._bags_within()}')
        self._complain(f'{self.path} has no {FILE_NAME}; reading the files in it')
        if packed:
            self._complain(f'left out: {self._compressed(packed)}')
        return BagMetadata(storage_id=''), files

    def _bags_within(self) -> str:
        """What to give instead of a folder of bags, such as that of a collection."""
        bags = sorted(file.parent.name for file in self.path.glob('*/*.mcap'))
        return f'; the bags in it are {", ".join(bags)}: give {self.path}/*/' if bags else ''

    def _from_metadata(self) -> tuple[BagMetadata, list[Path]]:
        source = self.path / FILE_NAME
        text = read_plain(source, LARGEST_METADATA_BYTES).decode(errors='replace')
        if not text.strip('\0 \n') and self._storage_files():
            self._complain(f'{source} is empty; reading the files beside it')
            return BagMetadata(storage_id=''), self._storage_files()
        metadata = BagMetadata.from_yaml(text, str(source))
        if metadata.storage_id not in _SUFFIXES.values():
            raise BagError(f'{source} has storage {metadata.storage_id!r}; only mcap and sqlite3 can be read')
        files = [self.path / name.removesuffix(_PACKED) for name in metadata.files]
        _check_number(files, source)
        if packed := [f'{file.name}{_PACKED}' for file in files if _is_packed(file)]:
            raise self._compressed(packed)
        if missing := [file.name for file in files if not file.exists()]:
            raise BagError(f'{source} lists {_listed(missing)}, which is not in the folder; open another file in it')
        if not files:
            raise BagError(f'{source} lists no storage file')
        return metadata, files

    def _storage_files(self) -> list[Path]:
        found = [file for file in self.path.iterdir() if file.suffix in _SUFFIXES]
        _check_number(found, self.path)
        return _in_order(found)

    def _packed_names(self) -> list[str]:
        """The compressed files in the folder that nobody has unpacked beside them."""
        unpacked = [file.with_suffix('') for file in self.path.iterdir() if file.suffix == _PACKED]
        found = [file for file in unpacked if file.suffix in _SUFFIXES and not file.exists()]
        return [f'{file.name}{_PACKED}' for file in _in_order(found)]

    def _compressed(self, names: list[str]) -> BagError:
        return BagError(f'{_listed(names)} must be unpacked first (zstd -d {self.path}/*{_PACKED})')

    def _take_stock(self) -> None:
        self.topics: dict[str, BagTopic] = dict(self.metadata.topics)
        for storage in self._storages:
            self.topics.update(storage.topics)
        # A file that is cut off may announce topics without messages.
        self.counts: dict[str, int] = dict.fromkeys(self.topics, 0)
        for storage in self._storages:
            for name, count in storage.counts.items():
                self.counts[name] = self.counts.get(name, 0) + count
        for topic in self.topics.values():
            self.types.learn(topic)
            if topic.encoding != 'cdr':
                self._complain(f'{topic.name} has encoding {topic.encoding!r} and is left out; only cdr can be read')
        self.extent = Extent.union(storage.extent for storage in self._storages)
        announced = self.metadata.message_count
        if self.metadata.topics and announced != self.extent.messages:
            self._complain(
                f'{self.path / FILE_NAME} states {announced} messages, but the files hold {self.extent.messages}'
            )

    def _complain(self, sentence: str) -> None:
        if sentence not in self.problems:
            self.problems.append(sentence)

    def _decompressed(self, parts: Iterator[BagMessage]) -> Iterator[BagMessage]:
        """Unpack what was compressed message by message; a file alone, or of a killed recorder, may not say so."""
        for message in parts:
            if not message.data.startswith(_ZSTD):
                yield message
                continue
            try:
                data = _unpacked(message.data)
            except (zstandard.ZstdError, ValueError):
                self._complain(f'{self.path}: messages on {message.topic} cannot be unpacked and are left out')
                continue
            stamp_ns = header_stamp_ns(data, message.type_name) if self.storage_id == 'sqlite3' else None
            yield replace(message, data=data, publish_ns=message.publish_ns if stamp_ns is None else stamp_ns)


def _overlapping(storages: list[Storage]) -> list[list[Storage]]:
    """The files in groups that follow each other in time: each file that is being read keeps a chunk in memory."""
    groups: list[list[Storage]] = []
    end_ns = 0
    for storage in sorted(storages, key=lambda each: each.extent.start_ns):
        if not groups or storage.extent.start_ns >= end_ns:
            groups.append([])
        groups[-1].append(storage)
        end_ns = max(end_ns, storage.extent.end_ns)
    return groups


def _unpacked(data: bytes) -> bytes:
    stated_size = zstandard.frame_content_size(data)  # -1: not stated
    limit = min(stated_size if stated_size >= 0 else LARGEST_BYTES, LARGEST_BYTES)
    found = unpack_zstd(data, limit)
    if len(found) > limit or stated_size not in (-1, len(found)):
        raise ValueError('its unpacked size differs from the stated one, or is too large')
    return found


def _check_number(files: list[Path], source: Path) -> None:
    if len(files) > MOST_FILES:
        raise BagError(
            f'{source} lists {len(files)} files, but at most {MOST_FILES} can be read; open some of them separately'
        )


def _in_order(files: list[Path]) -> list[Path]:
    return sorted(files, key=lambda file: (len(file.name), file.name))  # bag_10 after bag_9


def _is_packed(file: Path) -> bool:
    return not file.exists() and file.with_name(f'{file.name}{_PACKED}').exists()


def _listed(names: list[str]) -> str:
    return ', '.join(names[:3]) + (f' and {len(names) - 3} more' if len(names) > 3 else '')


def _is_blank(file: Path) -> bool:
    with open_plain(file) as opened:
        return not opened.read(16).strip(b'\0')


def _open(file: Path, complain: Callable[[str], None]) -> Storage:
    with open_plain(file) as opened:
        head = opened.read(16)
    if not head:
        raise BagError(f'{file} is empty')
    if head.startswith(growing_file.MAGIC):
        return McapStorage(file, complain)
    if head.startswith(sqlite_storage.MAGIC):
        return SqliteStorage(file, complain)
    if growing_file.MAGIC.startswith(head) or sqlite_storage.MAGIC.startswith(head):
        raise BagError(f'{file} is cut off within its first bytes; it contains no data')
    if head.startswith(_ZSTD):
        raise BagError(f'{file} must be unpacked first (zstd -d {file})')
    raise BagError(f'{file} is not a bag: neither MCAP nor SQLite')
