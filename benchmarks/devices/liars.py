"""Falsifies samples between a sensor and its driver: on the network, and on a serial line."""

from __future__ import annotations

import contextlib
import select
import socket
import struct
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType

from tactile_nodes.emulators.force_torque.serial_ft import Talker
from tactile_nodes.emulators.force_torque.serial_ft_bota import FRAME_HEADER, crc16_x25

LOOK_S = 0.001
RECORD = struct.Struct('>3I6i')
FRAME = struct.Struct('<H6fIf')
FRAME_BYTES = 37
Values = tuple[float, ...]


class Lie:
    """Replaces the six values of each sample from the time when `when` is true, using the last true values."""

    def __init__(self, when: Callable[[], bool], distort: Callable[[Values], Values]) -> None:
        self._when = when
        self._distort = distort
        self._begun = False
        self._last: Values = (0.0,) * 6

    @property
    def begun(self) -> bool:
        """Whether values are replaced now."""
        self._begun = self._begun or self._when()
        return self._begun

    def of(self, values: Values) -> Values:
        if self.begun:
            return self._distort(self._last)
        self._last = values
        return values


@dataclass
class Changed:
    """Changes the six values of each sample with `of`."""

    of: Callable[[Values], Values]


def frozen(last: Values) -> Values:
    """The last true values, repeated."""
    return last


def zeros(last: Values) -> Values:
    """Only zeros."""
    return tuple(0 * value for value in last)


class UdpProxy:
    """A proxy for a Net F/T box: requests pass unchanged, records are changed.

    Args:
        port: port of the box.
        lie: changes the counts; None: they stay the same.
        status: status bits to add, called for each record.
        delay_s: delay of a record, called for each; now_s: the time for these delays.
        every: one of this number of records is passed on, called for each.
    """

    def __init__(
        self,
        port: int,
        lie: Lie | Changed | None = None,
        status: Callable[[], int] = lambda: 0,
        delay_s: Callable[[], float] = lambda: 0.0,
        every: Callable[[], int] = lambda: 1,
        now_s: Callable[[], float] = lambda: 0.0,
    ) -> None:
        self._box = ('127.0.0.1', port)
        self._lie, self._status, self._delay_s, self._every, self._now_s = lie, status, delay_s, every, now_s
        self._front, self._back = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        self._front.bind(('127.0.0.1', 0))
        self._back.bind(('127.0.0.1', 0))
        self._client: tuple[str, int] | None = None
        self._waiting: deque[tuple[float, bytes]] = deque()
        self._count = 0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    @property
    def port(self) -> int:
        return int(self._front.getsockname()[1])

    def __enter__(self) -> UdpProxy:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._thread.join()
        self._front.close()
        self._back.close()

    def _run(self) -> None:
        while not self._over.is_set():
            readable, _, _ = select.select([self._front, self._back], [], [], LOOK_S)
            if self._front in readable:
                request, self._client = self._front.recvfrom(64)
                self._back.sendto(request, self._box)
            if self._back in readable:
                self._take(self._back.recv(2048))
            self._pass_on()

    def _take(self, record: bytes) -> None:
        self._count += 1
        if self._count % self._every() == 0:
            self._waiting.append((self._now_s() + self._delay_s(), self._distorted(record)))

    def _distorted(self, record: bytes) -> bytes:
        number, internal, status, *counts = RECORD.unpack(record)
        values_sent = self._lie.of(tuple(counts)) if self._lie else tuple(counts)
        return RECORD.pack(number, internal, status | self._status(), *map(round, values_sent))

    def _pass_on(self) -> None:
        while self._waiting and self._waiting[0][0] <= self._now_s():
            record = self._waiting.popleft()[1]
            if self._client is not None:
                with contextlib.suppress(OSError):
                    self._front.sendto(record, self._client)


@dataclass
class TalkerLiar:
    """A talker whose output is changed."""

    talker: Talker
    lie: Lie

    def power_on(self, now_ns: int) -> None:
        self.talker.power_on(now_ns)

    def receive(self, data: bytes, now_ns: int) -> None:
        self.talker.receive(data, now_ns)

    def next_ns(self) -> int | None:
        return self.talker.next_ns()


class BotaLiar(TalkerLiar):
    """A talker with changed frames and correct check sums."""

    def due(self, now_ns: int) -> bytes:
        sent = self.talker.due(now_ns)
        if not sent.startswith(bytes([FRAME_HEADER])) or len(sent) % FRAME_BYTES:
            return sent
        return b''.join(self._distorted(sent[at : at + FRAME_BYTES]) for at in range(0, len(sent), FRAME_BYTES))

    def _distorted(self, frame: bytes) -> bytes:
        status, *values, time_us, temperature = FRAME.unpack(frame[1:-2])
        body = FRAME.pack(status, *self.lie.of(tuple(values)), time_us, temperature)
        return frame[:1] + body + struct.pack('<H', crc16_x25(body))


class TextLiar(TalkerLiar):
    """A talker with changed lines."""

    def due(self, now_ns: int) -> bytes:
        lines = self.talker.due(now_ns).splitlines(keepends=True)
        return b''.join(line if line.startswith(b'#') else self._distorted(line) for line in lines)

    def _distorted(self, line: bytes) -> bytes:
        time_us, *values = line.decode().strip().split(',')
        values_sent = self.lie.of(tuple(map(float, values)))
        return ','.join([time_us, *(f'{value:g}' for value in values_sent)]).encode() + b'\r\n'
