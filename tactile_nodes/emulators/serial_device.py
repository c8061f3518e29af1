"""A device on a serial line, driven by the clock: bytes arrive at the baud rate, and events happen at their times.

`SerialDevice` has neither thread nor port. `PtyPort` connects it to a pseudo terminal that any program can open as a
serial port. A program that passes its bytes to a driver in the same thread, with a stepped clock, simulates hours of a
rig in seconds, and repeatably (`benchmarks/devices/direct_port.py`).
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Generator
from dataclasses import dataclass

from tactile_nodes.clock import NS_PER_S, Clock

Wait = Callable[[], bool]
Program = Generator[Wait, None, None]
BITS_PER_BYTE = 10


@dataclass
class SerialFaults:
    """The faults of a device; each can be switched while it runs."""

    hung: bool = False  # does nothing and sends nothing
    swallow_ok: bool = False  # works and reports, but acknowledges nothing
    delay_s: float = 0.0  # delay of everything that it sends


class SerialDevice(ABC):
    """The inside of a device. `run` processes all due events, each at its own time, however late it is called."""

    def __init__(self, clock: Clock, baud: int) -> None:
        self._clock = clock
        self._lock = threading.RLock()
        self._byte_ns = BITS_PER_BYTE * NS_PER_S // baud
        self._arriving: deque[tuple[int, int]] = deque()
        self._saying: deque[tuple[int, bytes]] = deque()
        self._program: Program | None = None
        self._condition: Wait = _always
        self.faults = SerialFaults()
        self.now_ns = clock.now_ns()

    def receive(self, data: bytes) -> None:
        """Put bytes on the line to the device; they take their time to arrive."""
        with self._lock:
            at_ns = max(self._clock.now_ns(), self._arriving[-1][0] if self._arriving else 0)
            for byte in data:
                at_ns += self._byte_ns
                self._arriving.append((at_ns, byte))

    def run(self) -> None:
        """Process all events that are due."""
        with self._lock:
            until_ns = self._clock.now_ns()
            while (due_ns := self._due_ns()) is not None and due_ns <= until_ns:
                self.now_ns = max(self.now_ns, due_ns)
                self._step()
            self.now_ns = max(self.now_ns, until_ns)
            self._step()

    def take_output(self) -> bytes:
        """What it has sent since the last call."""
        with self._lock:
            data = bytearray()
            while self._saying and self._saying[0][0] <= self.now_ns:
                data += self._saying.popleft()[1]
            return bytes(data)

    def next_event_ns(self) -> int | None:
        """The time of the next event without new input."""
        with self._lock:
            times = [self._due_ns(), self._saying[0][0] if self._saying else None]
            return min((time for time in times if time is not None), default=None)

    def say(self, data: bytes) -> None:
        if not self.faults.hung:
            due_ns = self.now_ns + round(self.faults.delay_s * NS_PER_S)
            self._saying.append((max(due_ns, self._saying[-1][0] if self._saying else 0), data))

    @abstractmethod
    def power_cycle(self) -> None:
        """Restart after a loss of power or a pulse on the reset line."""

    @abstractmethod
    def _byte(self, byte: int) -> None:
        """Process an arrived byte."""

    @abstractmethod
    def _progress(self) -> None:
        """Update everything except the program to `now_ns`."""

    @abstractmethod
    def _own_events_ns(self) -> list[int]:
        """Times at which `_progress` or the program's condition must be checked; past ones are ignored."""

    def _due_ns(self) -> int | None:
        times = [self._arriving[0][0]] if self._arriving else []
        if not self.faults.hung:
            times += [time for time in self._own_events_ns() if time > self.now_ns]
        return min(times, default=None)

    def _start_program(self, program: Program) -> None:
        self._program, self._condition = program, _always

    def _step(self) -> None:
        while self._arriving and self._arriving[0][0] <= self.now_ns:
            byte = self._arriving.popleft()[1]
            if not self.faults.hung:
                self._byte(byte)
        if self.faults.hung:
            return
        self._progress()
        while self._program is not None and self._condition():
            program = self._program
            condition = next(program)
            if program is self._program:  # it may have restarted itself
                self._condition = condition
            self._progress()


def _always() -> bool:
    return True
