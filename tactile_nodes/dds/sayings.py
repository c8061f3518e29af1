"""Counts the log lines of Cyclone DDS, and reports one line a minute for each kind.

Cyclone logs several hundred characters for each packet that is not RTPS, and anyone who reaches its ports can send
thousands a second. Its log is therefore read here instead of going to the screen. The wheel's library exports no
function for that. But it uses the value that C's `stderr` has when a domain is created, and `stderr` is a variable
(glibc manual, "Standard Streams").
"""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import functools
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass

TELL_EVERY_S = 60.0
MALFORMED = 'malformed packet'
_LONGEST = 160  # a line of Cyclone's ends in a dump of the packet
_MOST_KINDS = 20
_ROOM = 1 << 20  # pipe size allowed to users, pipe(7); lines that do not fit are lost, and no writer waits
_HEADER = re.compile(r'\s*\d+\.\d+ \[\d*\] [^:]*: ')  # time, domain and thread


class CycloneLog:
    """The log of all domains of this process: a pipe whose writers never wait."""

    def __init__(self) -> None:
        self._reading, writing = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        with contextlib.suppress(OSError):  # a smaller pipe works too
            fcntl.fcntl(writing, fcntl.F_SETPIPE_SZ, _ROOM)
        libc = ctypes.CDLL(None)
        libc.fdopen.restype = ctypes.c_void_p
        self._stderr = ctypes.c_void_p.in_dll(libc, 'stderr')
        self._file = libc.fdopen(writing, b'w')

    @contextlib.contextmanager
    def taken(self) -> Iterator[None]:
        """A domain created meanwhile logs here for its whole life."""
        before = self._stderr.value
        self._stderr.value = self._file
        try:
            yield
        finally:
            self._stderr.value = before

    def lines(self) -> list[str]:
        """New lines since the last call, without time, domain and thread."""
        text = b''
        with contextlib.suppress(BlockingIOError):
            while part := os.read(self._reading, _ROOM):
                text += part
        entries = text.decode('utf-8', 'replace').splitlines()
        return [_HEADER.sub('', entry, count=1) for entry in entries if _HEADER.match(entry)]


@functools.cache
def cyclone_log() -> CycloneLog:
    """The log of this process, which Cyclone may write to until the process ends."""
    return CycloneLog()


@dataclass
class _Kind:
    text: str = ''
    waiting: int = 0
    reported_s: float | None = None

    def is_due(self, now_s: float) -> bool:
        return self.waiting > 0 and (self.reported_s is None or now_s - self.reported_s >= TELL_EVERY_S)

    def report(self, now_s: float) -> str:
        more = f' (and {self.waiting - 1} more like it)' if self.waiting > 1 else ''
        self.waiting, self.reported_s = 0, now_s
        text = self.text if len(self.text) <= _LONGEST else f'{self.text[:_LONGEST]}…'
        return f'Cyclone DDS says: {text}{more}'


class Sayings:
    """Lines grouped by their first two words."""

    def __init__(self) -> None:
        self.malformed = 0
        """Packets that were no RTPS."""
        self._kinds: dict[str, _Kind] = {}

    def take(self, text: str) -> None:
        """Count a line."""
        words = ' '.join(text.split()[:2])
        if words not in self._kinds and len(self._kinds) >= _MOST_KINDS:
            words = ''
        kind = self._kinds.setdefault(words, _Kind())
        kind.text = kind.text if kind.waiting else text
        kind.waiting += 1
        self.malformed += text.startswith(MALFORMED)

    def due(self, now_s: float) -> list[str]:
        """The lines to report now: the first of a kind at once, later ones once a minute."""
        return [kind.report(now_s) for kind in self._kinds.values() if kind.is_due(now_s)]
