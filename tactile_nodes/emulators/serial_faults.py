"""Faults on a serial line: bytes changed or dropped on their way between a host and a device, emulated or real.

`FaultyPort` puts them around a port in the same program. `Relay` is a device that passes everything on to a port, so
that `PtyPort` makes of it a port that any program can open, with the faults in between::

    faults = LineFaults()
    with PtyPort(Relay(open_port('/dev/ttyUSB0', 115200, 'default', clock), faults), clock, Path('/tmp/ttyFAULTY')):
        faults.change('>', b'Z-30.250', b'Z-31.250')  # one digit, once, on the way to the device
        faults.mute = True  # what the device says is lost from now on
"""

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


class Relay:
    """A device for `PtyPort` that is another port, with faults on the line."""

    def __init__(self, port: Port, faults: LineFaults) -> None:
        self._port = FaultyPort(port, faults)
        self._said = b''

    def receive(self, data: bytes) -> None:
        """As `Pluggable.receive`."""
        self._port.write(data)

    def run(self) -> None:
        """As `Pluggable.run`."""
        self._said += self._port.read(0.0)

    def take_output(self) -> bytes:
        """As `Pluggable.take_output`."""
        said, self._said = self._said, b''
        return said

    def next_event_ns(self) -> int | None:
        """As `Pluggable.next_event_ns`: nobody knows."""
        return None

    def power_cycle(self) -> None:
        """The relay has no power of its own."""
