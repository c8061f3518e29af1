"""Reads files from other sources: regular files only, with a size limit for each kind.

A refused file raises an OSError whose `strerror` gives the reason, so that callers translate one kind of error.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO

TEXT_BYTES = 4 << 20
"""Size limit of text files: parameters, launch files, lists, descriptions of bags."""
PICTURE_BYTES = 256 << 20
"""Size limit of a file with one image."""


def open_plain(path: str | Path, largest: int | None = None) -> BinaryIO:
    """Open a file for reading; a named pipe, which would wait for ever, a folder or a device is refused.

    Raises:
        OSError: it is not a regular file, has more than `largest` bytes, or cannot be opened.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    except ValueError as error:  # the name contains a zero byte or half a character
        raise OSError(errno.EINVAL, 'it is not a valid file name', str(path)) from error
    try:
        _check(os.fstat(descriptor), path, largest)
        return os.fdopen(descriptor, 'rb')
    except OSError:
        os.close(descriptor)
        raise


def read_plain(path: str | Path, largest: int) -> bytes:
    """All bytes of a file with at most `largest` bytes. Raises the errors of `open_plain`."""
    with open_plain(path, largest) as opened:
        # Only the file's size, because read() allocates all that is requested. Files of the kernel report size 0.
        size = os.fstat(opened.fileno()).st_size or largest
        return opened.read(min(size, largest))


def read_text(path: str | Path, largest: int = TEXT_BYTES, encoding: str = 'utf-8') -> str:
    """The text of a file. Raises the errors of `open_plain`, and UnicodeDecodeError."""
    return read_plain(path, largest).decode(encoding).replace('\r\n', '\n')


def separator_of(line: str) -> str:
    """What separates the cells of a line of CSV: a tab, a semicolon or a comma.

    Where it is not a comma, numbers may have decimal commas.
    """
    return max('\t;,', key=line.count)


def check_size(path: str | Path, largest: int) -> None:
    """Raise the errors of `open_plain`, for a file that a library opens by its name."""
    open_plain(path, largest).close()


def bytes_there(opened: BinaryIO, enough: int) -> int:
    """The number of bytes stored in a file, without holes; counted up to `enough`."""
    descriptor, found, end = opened.fileno(), 0, 0
    place = os.lseek(descriptor, 0, os.SEEK_CUR)
    try:
        while found < enough:
            begin = os.lseek(descriptor, end, os.SEEK_DATA)
            end = os.lseek(descriptor, begin, os.SEEK_HOLE)
            found += end - begin
    except OSError as error:
        if error.errno != errno.ENXIO:  # which means that no more data follow
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
