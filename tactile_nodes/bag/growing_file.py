"""A file that is complete after every flush, even if its writer is killed.

MCAP ends with a footer, and many readers refuse a file without one. A killed recorder leaves such a file. Here every
flush writes the new records *and* the shortest legal ending (no summary, 50 bytes) in one call. The next flush
overwrites that ending. So flushed data never needs repair.
"""

from __future__ import annotations

import contextlib
import os
import threading
from pathlib import Path

from mcap.data_stream import RecordBuilder
from mcap.records import DataEnd, Footer

MAGIC = b'\x89MCAP0\r\n'


def _ending() -> bytes:
    builder = RecordBuilder()
    DataEnd(data_section_crc=0).write(builder)
    Footer(summary_start=0, summary_offset_start=0, summary_crc=0).write(builder)
    return bytes(builder.end()) + MAGIC  # type: ignore[no-untyped-call]


ENDING = _ending()


class GrowingFile:
    """The output of an MCAP writer: `write`, `tell` and `flush` of a stream.

    Raises:
        OSError: the file exists, or its folder is not writable.
    """

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        self._end = 0  # of the records that are in the file
        self._waiting: list[bytes] = []
        self._position = 0
        self._syncing = threading.Lock()

    def write(self, data: bytes) -> int:
        """Keep `data` for the next flush."""
        self._waiting.append(data)
        self._position += len(data)
        return len(data)

    def tell(self) -> int:
        return self._position

    def flush(self) -> None:
        """Write the waiting data to the file, followed by an ending.

        Raises:
            OSError: it does not fit; the file is restored to its state before.
        """
        self._commit(ENDING)

    def finish(self) -> None:
        """Write the waiting data, which has its own ending. Raises as `flush`."""
        self._commit(b'')

    def sync(self) -> None:
        """Sync the file to disk, so that a power cut loses nothing. May be called from any thread.

        Raises:
            OSError: the disk failed.
        """
        with self._syncing:
            if self._descriptor >= 0:
                os.fdatasync(self._descriptor)

    def close(self) -> None:
        """Close the file as it is; closing twice is harmless."""
        with self._syncing:
            if self._descriptor >= 0:
                os.close(self._descriptor)
                self._descriptor = -1

    def _commit(self, ending: bytes) -> None:
        try:
            self._put(b''.join([*self._waiting, ending]), self._end)
        except OSError:
            self._go_back()
            raise
        self._waiting.clear()
        self._end = self._position

    def _put(self, data: bytes, offset: int) -> None:
        view = memoryview(data)
        while view:
            written = os.pwrite(self._descriptor, view, offset)
            view, offset = view[written:], offset + written

    def _go_back(self) -> None:
        # Suppressed because the caller gets the first failure; records can be read even without an ending.
        with contextlib.suppress(OSError):
            os.ftruncate(self._descriptor, self._end + len(ENDING) if self._end else 0)
            self._put(ENDING if self._end else b'', self._end)
