"""How files from elsewhere are read: plain ones alone, and none that is larger than its like can be.

What is refused is an OSError whose `strerror` says why, so that whoever reads translates one kind of error.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO

TEXT_BYTES = 4 << 20
"""No text that a person or this package writes is longer: parameters, launch files, lists, what describes a bag."""
PICTURE_BYTES = 256 << 20
"""No file of one picture is larger."""


def open_plain(path: str | Path, largest: int | None = None) -> BinaryIO:
    """Open a file for reading; a named pipe is refused, which would wait for ever, and so is a folder or a device.

    Raises:
        OSError: it is no plain file, holds more than `largest` bytes, or cannot be opened.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    except ValueError as error:  # a zero byte within it, or half a character
        raise OSError(errno.EINVAL, 'it is not a valid file name', str(path)) from error
    try:
        _check(os.fstat(descriptor), path, largest)
        return os.fdopen(descriptor, 'rb')
    except OSError:
        os.close(descriptor)
        raise


def read_plain(path: str | Path, largest: int) -> bytes:
    """All bytes of a file, if it holds no more than `largest`. Raises as `open_plain`."""
    with open_plain(path, largest) as opened:
        # As many as there are: read() takes memory for all that it is asked for. The kernel's own files claim none.
        size = os.fstat(opened.fileno()).st_size or largest
        return opened.read(min(size, largest))


def read_text(path: str | Path, largest: int = TEXT_BYTES, encoding: str = 'utf-8') -> str:
    """The text of a file. Raises as `open_plain`, and UnicodeDecodeError."""
    return read_plain(path, largest).decode(encoding).replace('\r\n', '\n')


def check_size(path: str | Path, largest: int) -> None:
    """Raise what `open_plain` raises, for a file that a library opens by its name."""
    open_plain(path, largest).close()


def bytes_there(opened: BinaryIO, enough: int) -> int:
    """How many bytes of a file are there, holes left out; counted up to `enough`."""
    descriptor, found, end = opened.fileno(), 0, 0
    place = os.lseek(descriptor, 0, os.SEEK_CUR)
    try:
        while found < enough:
            begin = os.lseek(descriptor, end, os.SEEK_DATA)
            end = os.lseek(descriptor, begin, os.SEEK_HOLE)
            found += end - begin
    except OSError as error:
        if error.errno != errno.ENXIO:  # which says that no more follow
            raise
    finally:
        os.lseek(descriptor, place, os.SEEK_SET)
    return found


def _check(found: os.stat_result, path: str | Path, largest: int | None) -> None:
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EINVAL, 'it is not a regular file', str(path))
    if largest is not None and found.st_size > largest:
        raise OSError(errno.EFBIG, f'it has {found.st_size} bytes, more than the limit of {largest}', str(path))
