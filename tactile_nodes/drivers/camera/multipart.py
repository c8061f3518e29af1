"""The parts of a ``multipart/x-mixed-replace`` stream, parsed from bytes that arrive in arbitrary pieces.

The format is RFC 2046, 5.1: ``--boundary``, header lines, an empty line, the body. Many servers deviate: boundaries
with extra dashes, bare line feeds, no Content-Length or a wrong one. The delimiter decides where a part ends; the
length only allows returning it before the next delimiter has arrived.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

LONGEST_HEADER = 8 * 1024
LONGEST_BODY = 32 * 1024 * 1024


@dataclass(frozen=True)
class Part:
    """One part's body, and the arrival time of its first byte."""

    body: bytes
    arrival_ns: int


class MultipartParser:
    """Takes bytes as they arrive, and returns the parts that are complete.

    Args:
        boundary: as in the Content-Type, with or without leading dashes.
    """

    def __init__(self, boundary: str) -> None:
        self._delimiter = b'--' + boundary.strip('"').lstrip('-').encode('latin-1')
        self._buffer = bytearray()
        self._state = self._seek
        self._now_ns = 0
        self._arrival_ns: int | None = None
        self._length: int | None = None
        self._parts: list[Part] = []

    def feed(self, data: bytes, now_ns: int) -> list[Part]:
        """The parts completed by `data`, which arrived at `now_ns`."""
        self._buffer += data
        self._parts = []
        self._now_ns = now_ns
        while self._state():
            pass
        return self._parts

    def _seek(self) -> bool:
        """Drop everything up to the next delimiter."""
        start = self._buffer.find(self._delimiter)
        if start < 0:
            del self._buffer[: -len(self._delimiter)]
            return False
        del self._buffer[: start + len(self._delimiter)]
        self._state = self._header
        return True

    def _header(self) -> bool:
        end = re.search(rb'\r?\n\r?\n', self._buffer[:LONGEST_HEADER])
        if end is None:
            if len(self._buffer) < LONGEST_HEADER:
                return False
            self._state = self._seek
            return True
        length = re.search(rb'(?im)^content-length:[ \t]*(\d{1,9})[ \t]*\r?$', self._buffer[: end.start()])
        self._length = int(length.group(1)) if length is not None else None
        del self._buffer[: end.end()]
        self._arrival_ns = None
        self._state = self._body
        return True

    def _body(self) -> bool:
        if self._arrival_ns is None and self._buffer:  # its delimiter and header may have come with the part before it
            self._arrival_ns = self._now_ns
        if self._length is not None and 0 < self._length <= min(len(self._buffer), LONGEST_BODY):
            end = self._buffer.find(b'\n' + self._delimiter, 0, self._length)
            return self._hand_out(end if end >= 0 else self._length)
        end = self._buffer.find(b'\n' + self._delimiter)
        if end >= 0 and (not self._length or end < self._length):
            return self._hand_out(end)
        if len(self._buffer) > LONGEST_BODY:
            self._state = self._seek
            return True
        return False

    def _hand_out(self, end: int) -> bool:
        self._parts.append(Part(bytes(self._buffer[:end]), self._arrival_ns or self._now_ns))
        del self._buffer[:end]
        self._state = self._seek
        return True
