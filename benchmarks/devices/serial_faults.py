"""Faults on a serial line, put around a port of the same program (`FaultyPort`)."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol


class Port(Protocol):
    """Bytes to and from a device, as drivers use them."""

    name: str

    def write(self, data: bytes) -> None:
        """Send."""
        ...

    def read(self, timeout_s: float) -> bytes:
        """What has arrived; empty after the timeout."""
        ...

    def close(self) -> None:
        """Let go of it."""
        ...


@dataclass
class _Change:
    way: str
    old: bytes
    new: bytes
    times: int


class LineFaults:
    """What happens to bytes on their way; '>' is to the device, '<' from it. Switch any of it from any thread.

    Attributes:
        mute: nothing that the device says arrives.
        deaf: nothing that it is told arrives.
        done: how many changes were made.
        lie: what arrives instead of what is left after all other changes; told the way and the bytes.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._changes: list[_Change] = []
        self.mute = self.deaf = False
        self.done = 0
        self.lie: Callable[[str, bytes], bytes] = lambda _, data: data

    def change(self, way: str, old: bytes, new: bytes, times: int = 1) -> None:
        """Where `old` next passes within one write or read, `new` arrives; an empty one drops it."""
        with self._lock:
            self._changes.append(_Change(way, old, new, times))

    def passed(self, way: str, data: bytes) -> bytes:
        """What arrives."""
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
