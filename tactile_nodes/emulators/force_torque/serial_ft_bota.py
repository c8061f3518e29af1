"""The inside of an emulated Bota Systems serial sensor; `drivers.force_torque.bota` has the protocol.

It sends ``App Init`` when it gets power, and then frames.
"""

from __future__ import annotations

import re
import struct

from tactile_nodes.emulators.clocks import DeviceClock
from tactile_nodes.emulators.force_torque.serial_ft_sensor import SampledSensor, microsecond_clock
from tactile_nodes.emulators.world import WrenchSource

FRAME_HEADER = 0xAA
OVERRANGE, RAW = 1 << 1, 1 << 3
SINC_US = 1e6 / 51_200  # duration of a sample per unit of the sinc filter's length: 512 gives 100 Hz
COMMAND = re.compile(rb'C|R|c,(\d),(\d),(\d),(\d)|f,(\d+),(\d),(\d),(\d)')
SINC_LENGTHS = range(51, 513)
RANGE_N = 1000.0


class BotaSensor(SampledSensor):
    """A sensor; `noise` is in N and N·m."""

    def __init__(
        self,
        world: WrenchSource,
        clock: DeviceClock | None = None,
        noise: float = 0.001,
    ) -> None:
        super().__init__(world, clock or microsecond_clock(), noise)
        self.running = True
        self.temperature_c = 25.0
        self.sinc = 512
        self.calibrated = True
        self.commands: list[bytes] = []
        self._received = b''
        self._to_say = b''

    def power_on(self, now_ns: int) -> None:
        """Boot, with the factory settings of the filter."""
        self.running, self.calibrated = True, True
        self._set_filter(512)
        self._received, self._to_say = b'', b'App Init\r\n'
        self.restart(now_ns)

    def receive(self, data: bytes, now_ns: int) -> None:
        """Execute commands, which have no line ends."""
        self._received += data
        while (found := COMMAND.search(self._received)) is not None:
            self._received = self._received[found.end() :]
            self._obey(found, now_ns)

    def due(self, now_ns: int) -> bytes:
        """Responses, and the frames since the last call."""
        response, self._to_say = self._to_say, b''
        if not self.running:
            return response
        frames = (self.spoilt(self._frame(stamp, values)) for stamp, values in self.samples(now_ns))
        return response + b''.join(frames)

    def next_ns(self) -> int | None:
        return self.next_sample_ns() if self.running else None

    def _obey(self, command: re.Match[bytes], now_ns: int) -> None:
        self.commands.append(command.group(0))
        letter = command.group(0)[:1]
        if letter == b'C':
            self.running = False
        elif self.running:
            return  # c, f and R have no effect outside the configuration
        elif letter == b'R':
            self.running = True
            self.restart(now_ns)
        accepted = letter in {b'C', b'R'} or self._configure(command, letter)
        self._to_say += b'r,0,%s,%d\r\n' % (letter, 0 if accepted else 1)

    def _configure(self, command: re.Match[bytes], letter: bytes) -> bool:
        if letter == b'c':
            self.calibrated = command.group(2) == b'1'
            return command.group(3) == b'0'  # frames; the text format is not emulated
        sinc = int(command.group(5))
        if sinc not in SINC_LENGTHS:
            return False
        self._set_filter(sinc)
        return True

    def _set_filter(self, sinc: int) -> None:
        self.sinc = sinc
        self.period_us = sinc * SINC_US

    def _frame(self, stamp: int, values: tuple[float, ...]) -> bytes:
        if self.faults.saturated:
            values = (values[0], values[1], RANGE_N, *values[3:])
        status = OVERRANGE * (max(map(abs, values[:3])) >= RANGE_N) | RAW * (not self.calibrated)
        body = struct.pack('<H6fIf', status, *values, stamp, self.temperature_c)
        return bytes([FRAME_HEADER]) + body + struct.pack('<H', crc16_x25(body))


def crc16_x25(data: bytes) -> int:
    """CRC-16/X-25, bit by bit: reflected, polynomial 0x1021, from 0xFFFF, inverted; of ``123456789`` 0x906E."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ (0x8408 if crc & 1 else 0)
    return crc ^ 0xFFFF
