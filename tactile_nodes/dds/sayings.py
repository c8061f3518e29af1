"""What Cyclone DDS says: counted, and told in a line a minute for each kind.

Cyclone writes a line of several hundred characters for each packet that is no RTPS, and anybody who reaches its ports
may send thousands a second. Its log therefore comes here instead of to the screen. The library of the wheel exports no
function for that, but it takes C's `stderr` as it is when a domain is made, and that is a variable (glibc manual,
"Standard Streams").
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
_ROOM = 1 << 20  # what an account may ask for, pipe(7); what finds no room there is lost, and nobody waits
_HEADER = re.compile(r'\s*\d+\.\d+ \[\d*\] [^:]*: ')  # time, domain and thread


class CycloneLog:
    """The log of all domains of this process: a pipe that nobody waits for."""

    def __init__(self) -> None:
        self._reading, writing = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        with contextlib.suppress(OSError):  # it works with less room too
            fcntl.fcntl(writing, fcntl.F_SETPIPE_SZ, _ROOM)
        libc = ctypes.CDLL(None)
        libc.fdopen.restype = ctypes.c_void_p
        self._stderr = ctypes.c_void_p.in_dll(libc, 'stderr')
        self._file = libc.fdopen(writing, b'w')

    @contextlib.contextmanager
    def taken(self) -> Iterator[None]:
        """A domain that is made meanwhile says what it has to say here, as long as it lasts."""
        before = self._stderr.value
        self._stderr.value = self._file
        try:
            yield
        finally:
            self._stderr.value = before

    def lines(self) -> list[str]:
        """What was said since, without time, domain and thread."""
        said = b''
        with contextlib.suppress(BlockingIOError):
            while part := os.read(self._reading, _ROOM):
                said += part
        entries = said.decode('utf-8', 'replace').splitlines()
        return [_HEADER.sub('', entry, count=1) for entry in entries if _HEADER.match(entry)]


@functools.cache
def cyclone_log() -> CycloneLog:
    """The one of this process: Cyclone may write to it until that ends."""
    return CycloneLog()


@dataclass
class _Kind:
    text: str = ''
    waiting: int = 0
    told_s: float | None = None

    def is_due(self, now_s: float) -> bool:
        return self.waiting > 0 and (self.told_s is None or now_s - self.told_s >= TELL_EVERY_S)

    def told(self, now_s: float) -> str:
        more = f' (and {self.waiting - 1} more like it)' if self.waiting > 1 else ''
        self.waiting, self.told_s = 0, now_s
        text = self.text if len(self.text) <= _LONGEST else f'{self.text[:_LONGEST]}…'
        return f'Cyclone DDS says: {text}{more}'


class Sayings:
    """Lines by their first two words."""

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
        """What is to be told now: the first line of a kind at once, those after it once a minute."""
        return [kind.told(now_s) for kind in self._kinds.values() if kind.is_due(now_s)]
