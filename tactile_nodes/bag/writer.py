"""Records messages into a rosbag2 folder, in a separate thread that never blocks the caller."""

from __future__ import annotations

import contextlib
import os
import threading
from collections import Counter
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path

from tactile_nodes.bag.mcap_file import COMPRESSIONS, Entry, McapFile
from tactile_nodes.bag.metadata import FILE_NAME, MOST_FILES, BagMetadata, BagTopic, Extent
from tactile_nodes.bag.stamps import header_stamp_ns
from tactile_nodes.clock import NS_PER_S, monotonic_s
from tactile_nodes.errors import BagError

FLUSH_EVERY_S = 0.2
SYNC_EVERY_S = 1.0
_FLUSH_AT_BYTES = 8 << 20
_HOLD_NS = 50_000_000


@dataclass(frozen=True)
class BagLimits:
    """`queue_bytes`: buffer for the disk; `file_bytes` and `file_s` split a bag into several files (0: never).

    The last of `MOST_FILES` files takes all the rest.
    """

    queue_bytes: int = 256 << 20
    file_bytes: int = 0
    file_s: float = 0.0


@dataclass(frozen=True)
class BagTotals:
    """Statistics of a writer: messages and payload bytes in the file, and messages dropped for a slow disk."""

    messages: int
    bytes: int
    dropped: int
    seconds: float


class BagWriter:
    """Writes into the new folder `folder`: ``<name>_0.mcap``, … and ``metadata.yaml``.

    Messages given to `write` are in the file at most 2 `FLUSH_EVERY_S` later, even if the process is killed; at most
    `SYNC_EVERY_S` (plus the disk's own delay) after that even if the power fails. Messages that arrive within one
    `FLUSH_EVERY_S` of each other are sorted by receive time, because some readers need it.

    Raises:
        BagError: the folder exists or cannot be written.
    """

    def __init__(self, folder: str | Path, *, compression: str = 'none', limits: BagLimits | None = None) -> None:
        if compression not in COMPRESSIONS:
            raise BagError(f'unknown compression {compression!r}; available: {", ".join(COMPRESSIONS)}')
        self.folder = Path(folder)
        self.limits = limits or BagLimits()
        self.counts: Counter[str] = Counter()
        self.dropped_of: Counter[str] = Counter()
        self._compression = compression
        self._metadata = BagMetadata(ros_distro=os.environ.get('ROS_DISTRO', ''))  # as `ros2 bag record` does
        self._arrived = threading.Condition()
        self._entries: list[Entry] = []
        self._held: list[Entry] = []
        self._newest_ns = 0
        self._new_topics: list[BagTopic] = []
        self._described: list[BagTopic] = []
        self._queued_bytes = self._written_bytes = self._accepted = 0
        self.failure: BagError | None = None  # why nothing is written any more
        self._sync_failure: OSError | None = None
        self._closing = False
        self._dirty = threading.Event()
        self._ended = threading.Event()
        self._file = self._open_first()
        self._threads = [
            threading.Thread(target=self._write_all, name='bag writer', daemon=True),
            threading.Thread(target=self._sync_all, name='bag sync', daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    # --- called by the receiver of messages

    def add_topic(self, topic: BagTopic) -> None:
        """Describe a topic, before its first message."""
        with self._arrived:
            if topic.name not in self._metadata.topics:
                self._metadata.topics[topic.name] = topic
                self._new_topics.append(topic)

    def write(self, topic: str, data: bytes, log_ns: int, source_ns: int, sequence: int = 0) -> bool:
        """Add one serialized message; returns at once. False: dropped, because the disk is too slow.

        Args:
            topic: a topic that was added.
            data: its CDR bytes.
            log_ns: time of receipt.
            source_ns: time of publication; used if the message has no capture stamp.
            sequence: its publisher's sequence number.

        Raises:
            BagError: an earlier write has failed, or the bag is closed.
        """
        stamp_ns = header_stamp_ns(data, self._metadata.topics[topic].type_name)
        entry = Entry(log_ns, source_ns if stamp_ns is None else stamp_ns, topic, sequence, data)
        with self._arrived:
            self._check_open()
            if self._queued_bytes + len(data) > self.limits.queue_bytes:
                self.dropped_of[topic] += 1
                return False
            self._queued_bytes += len(data)
            self._accepted += 1
            self._entries.append(entry)
            if self._queued_bytes > _FLUSH_AT_BYTES:
                self._arrived.notify()
        return True

    @property
    def totals(self) -> BagTotals:
        """What is in the file so far."""
        with self._arrived:  # the writing thread adds files
            extent = Extent.union(self._metadata.files.values())
        dropped = sum(self.dropped_of.values())
        return BagTotals(extent.messages, self._written_bytes, dropped, extent.duration_ns / NS_PER_S)

    def begin_to_close(self, patience_s: float) -> int:
        """Accept no more messages, and wait for the disk; returns how many messages are still waiting after that."""
        with self._arrived:
            self._closing = True
            self._arrived.notify()
        self._ended.wait(patience_s)
        return 0 if self.failure is not None else self._accepted - self.totals.messages

    def close(self) -> BagTotals:
        """Write the waiting messages, the indexes and ``metadata.yaml``. Closing twice is harmless.

        Raises:
            BagError: not everything could be written; the written part can be read.
        """
        self.begin_to_close(0.0)
        for thread in self._threads:
            thread.join()
        if self.failure is not None:
            raise self.failure
        return self.totals

    def discard_empty(self) -> None:
        """Close an empty bag, and remove its files and folder; a bag with content is left alone.

        Raises:
            BagError: not everything could be written.
        """
        self.close()
        if self._accepted:
            return
        for name in (FILE_NAME, *self._metadata.files):
            (self.folder / name).unlink(missing_ok=True)
        with contextlib.suppress(OSError):  # another program put a file there meanwhile
            self.folder.rmdir()

    def _check_open(self) -> None:
        if self.failure is not None:
            raise self.failure
        if self._closing:
            raise BagError(f'the bag {self.folder} is closed')

    # --- the writing thread ---------------------------------------------------------------------------------

    def _open_first(self) -> McapFile:
        try:
            self.folder.mkdir(parents=True)
        except FileExistsError as error:
            raise BagError(f'{self.folder} already exists and is not overwritten; choose another name') from error
        except OSError as error:
            raise BagError(f'cannot create the folder {self.folder} for the bag: {error.strerror}') from error
        try:
            return self._open_file()
        except OSError as error:
            with contextlib.suppress(OSError):  # another program put a file there meanwhile
                self.folder.rmdir()
            raise BagError(f'cannot write a bag into {self.folder}: {error.strerror}') from error

    def _open_file(self) -> McapFile:
        file = McapFile(self.folder / f'{self.folder.name}_{len(self._metadata.files)}.mcap', self._compression)
        with self._arrived:
            self._metadata.files[file.path.name] = Extent()
        return file

    def _write_all(self) -> None:
        try:
            self._write_until_closed()
        except OSError as error:
            self._fail(error.strerror or str(error), error)
        except Exception as error:  # noqa: BLE001 - a bug; the recorder must report it instead of writing on
            self._fail(repr(error), error)
        finally:
            self._ended.set()

    def _write_until_closed(self) -> None:
        self._save_metadata()
        saved_s = monotonic_s()
        while not self._closing:
            with self._arrived:
                self._arrived.wait_for(self._is_urgent, FLUSH_EVERY_S)
            self._write_ready()
            if monotonic_s() - saved_s >= SYNC_EVERY_S:
                self._save_metadata()
                saved_s = monotonic_s()
        self._write_ready()
        self._write_ready()  # those held back by the first call
        self._file.close(self._metadata_now().to_record())
        self._save_metadata(durable=True)

    def _is_urgent(self) -> bool:
        return self._closing or self._queued_bytes > _FLUSH_AT_BYTES

    def _write_ready(self) -> None:
        if self._sync_failure is not None:
            raise self._sync_failure
        entries, topics = self._take_ready()
        if entries and self._is_full():  # not before: ros2 bag reindex uses the time of an empty file, which is 1970
            self._split()
        for topic in topics:
            self._file.add_topic(topic)
            self._described.append(topic)
        for entry in entries:
            self._file.add(entry)
        if entries:
            self._file.flush()
            self._account(entries)
            self._dirty.set()

    def _take_ready(self) -> tuple[list[Entry], list[BagTopic]]:
        with self._arrived:
            waiting, self._entries = self._held + self._entries, []
            topics, self._new_topics = self._new_topics, []
        newest_ns = max((entry.log_ns for entry in waiting), default=0)
        cutoff_ns = max(newest_ns - _HOLD_NS, self._newest_ns)
        self._held = [entry for entry in waiting if entry.log_ns > cutoff_ns]
        self._newest_ns = max(self._newest_ns, newest_ns)
        ready = [entry for entry in waiting if entry.log_ns <= cutoff_ns]
        return sorted(ready, key=attrgetter('log_ns')), topics

    def _account(self, entries: list[Entry]) -> None:
        size = sum(len(entry.data) for entry in entries)
        self.counts.update(entry.topic for entry in entries)
        with self._arrived:
            self._metadata.files[self._file.path.name] = replace(self._file.extent)
            self._written_bytes += size
            self._queued_bytes -= size

    def _is_full(self) -> bool:
        extent, limits = self._file.extent, self.limits
        too_big = 0 < limits.file_bytes <= self._file.size
        too_long = 0.0 < limits.file_s <= extent.duration_ns / NS_PER_S
        return extent.messages > 0 and (too_big or too_long) and len(self._metadata.files) < MOST_FILES

    def _split(self) -> None:
        self._file.close(self._metadata_now().to_record())
        self._file = self._open_file()
        for topic in self._described:
            self._file.add_topic(topic)
        self._save_metadata()  # before the first message: readers open only the files listed in it

    def _metadata_now(self) -> BagMetadata:
        with self._arrived:
            now = self._metadata
            return replace(now, files=dict(now.files), topics=dict(now.topics), counts=dict(self.counts))

    def _save_metadata(self, durable: bool = False) -> None:
        text, draft = self._metadata_now().to_yaml(), self.folder / f'.{FILE_NAME}'
        try:
            with draft.open('w', encoding='utf-8') as file:
                file.write(text)
                file.flush()
                if durable:
                    os.fsync(file.fileno())
            draft.replace(self.folder / FILE_NAME)
        except OSError:
            draft.unlink(missing_ok=True)
            raise

    def _fail(self, reason: str, cause: BaseException) -> None:
        self._file.abandon()
        with contextlib.suppress(OSError):  # the older one remains, and readers compare it with the files
            self._save_metadata()
        with self._arrived:
            written = self.totals.messages
            lost = self._accepted - written
            self.failure = BagError(
                f'cannot continue to write the bag {self.folder}: {reason}; '
                f'it can be read and holds the messages written before ({written}); lost: {lost}'
            )
            self.failure.__cause__ = cause

    # --- the syncing thread: a disk that takes its time must not hold up the writing -------------------------

    def _sync_all(self) -> None:
        while not self._ended.wait(SYNC_EVERY_S):
            if self._dirty.is_set():
                self._dirty.clear()
                try:
                    self._file.sync()
                except OSError as error:
                    self._sync_failure = error
                    return
