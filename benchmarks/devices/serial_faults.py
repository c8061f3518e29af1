"""Faults on a serial line, by a wrapper around a port in the same program (`FaultyPort`)."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol


class Port(Protocol):
    """Bytes to and from a device; the interface for drivers."""

    name: str

    def write(self, data: bytes) -> None:
        """Send bytes."""
        ...

    def read(self, timeout_s: float) -> bytes:
        """The received bytes; empty after the timeout."""
        ...

    def close(self) -> None:
        """Close the port."""
        ...


@dataclass
class _Change:
    way: str
    old: bytes
    new: bytes
    times: int


class LineFaults:
    """Faults of transferred bytes; '>' is to the device, '<' from it. May be changed from any thread.

    Attributes:
        mute: no bytes from the device arrive.
        deaf: no bytes to the device arrive.
        done: number of changes so far.
        lie: changes the bytes after all other changes; called with direction and bytes.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._changes: list[_Change] = []
        self.mute = self.deaf = False
        self.done = 0
        self.lie: Callable[[str, bytes], bytes] = lambda _, data: data

    def change(self, way: str, old: bytes, new: bytes, times: int = 1) -> None:
        """Replace the next `old` within one write or read by `new`; an empty `new` drops it."""
        with self._lock:
            self._changes.append(_Change(way, old, new, times))

    def passed(self, way: str, data: bytes) -> bytes:
        """The bytes that arrive."""
        if self.mute if way == '<' else self.deaf:
            return b''
        with self._lock:
            for change in [each for each in self._changes if each.way == way and each.old in data]:
                data = data.replace(change.old, change.new, 1)
                self.done += 1
                change.times -= 1
                if not change.times:
                    self._changes.remove(change)
        return self.lie(way, data)


class FaultyPort:
    """A port of a driver, with faults on its line."""

    def __init__(self, port: Port, faults: LineFaults) -> None:
        self._port = port
        self._faults = faults
        self.name = port.name

    def write(self, data: bytes) -> None:
        """As `Port.write`."""
        if passed := self._faults.passed('>', data):
            self._port.write(passed)

    def read(self, timeout_s: float) -> bytes:
        """As `Port.read`."""
        return self._faults.passed('<', self._port.read(timeout_s))

    def close(self) -> None:
        """As `Port.close`."""
        self._port.close()
