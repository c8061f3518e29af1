"""Bota Systems serial sensors (SensONE, MiniONE) at 460800 baud: configuration, frames, own clock.

The configuration commands have no line ends: ``C`` stops the frames, ``c,<temperature>,<calibration>,<format>,<baud>``
and ``f,<sinc>,<chop>,<fast>,<fir off>`` configure, ``R`` runs; the response to each is ``r,0,<letter>,0``. A frame has
37 bytes: 0xAA, then little-endian u16 status, six f32 (N, N·m), u32 time in µs, f32 temperature (°C), and the
CRC-16/X-25 of these 34.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import NamedTuple

from tactile_nodes import clock as clocks
from tactile_nodes.clock import Clock
from tactile_nodes.drivers.force_torque.clock import TickClock
from tactile_nodes.drivers.force_torque.contract import AXES, Flag, ForceTorqueSettings, Wrench
from tactile_nodes.drivers.force_torque.queue import SampleQueue
from tactile_nodes.drivers.force_torque.serial_line import WAIT_S, Gaps, require_no_restart
from tactile_nodes.drivers.force_torque.stream import Connection, StreamedForceTorque
from tactile_nodes.drivers.serial_port import Port, open_port
from tactile_nodes.errors import ConfigurationError, DeviceError, DeviceLostError, DeviceTimeoutError

BAUD = 460_800
BAUD_CODE = {9600: 0, 57600: 1, 115200: 2, 230400: 3, 460800: 4}
HEADER = 0xAA
BODY = struct.Struct('<H6fIf')
FRAME_BYTES = 1 + BODY.size + 2
SINC_RATE_HZ = 51_200
SINC_SHORTEST, SINC_LONGEST = 51, 512
US_PER_S = 1e6
OVERRUN, OVERRANGE, INVALID, RAW = 1, 2, 4, 8
BOOT_S = 1.5  # for ``App Init`` of a sensor that is powered by the port
ANSWER_S = 1.0
STOP_TRIES = 4  # the manufacturer's own example waits for the text for ten seconds, and half a second after it
GARBAGE_S = 1.0
MEANS = {
    OVERRUN: Flag.WARNING,
    OVERRANGE: Flag.SATURATED,
    INVALID: Flag.FAULT,
    RAW: Flag.FAULT,  # raw values are not newtons
}


class Frame(NamedTuple):
    """One frame."""

    status: int
    wrench: Wrench
    time_us: int
    temperature_c: float


class FrameParser:
    """Finds frames in a stream of bytes; the marker may occur in the data, so the checksum decides.

    Attributes:
        bad: how often a marker was not followed by a frame.
    """

    def __init__(self) -> None:
        self.bad = 0
        self._bytes = bytearray()

    def feed(self, data: bytes) -> list[Frame]:
        """The frames that are complete with these bytes."""
        self._bytes += data
        frames: list[Frame] = []
        while (start := self._bytes.find(HEADER)) >= 0 and len(self._bytes) - start >= FRAME_BYTES:
            frame = parse(bytes(self._bytes[start : start + FRAME_BYTES]))
            if frame is not None:
                frames.append(frame)
            self.bad += frame is None
            del self._bytes[: start + (FRAME_BYTES if frame is not None else 1)]
        if start < 0:
            self._bytes.clear()
        return frames


def parse(data: bytes) -> Frame | None:
    """A frame of 37 bytes; None if its checksum is wrong."""
    body = data[1 : 1 + BODY.size]
    if crc16_x25(body) != int.from_bytes(data[-2:], 'little'):
        return None
    status, fx, fy, fz, tx, ty, tz, time_us, temperature_c = BODY.unpack(body)
    return Frame(status, (fx, fy, fz, tx, ty, tz), time_us, temperature_c)


def _crc_table() -> tuple[int, ...]:
    table = []
    for value in range(256):
        for _ in range(8):
            value = value >> 1 ^ 0x8408 * (value & 1)  # noqa: PLW2901
        table.append(value)
    return tuple(table)


_TABLE = _crc_table()


def crc16_x25(data: bytes) -> int:
    """CRC-16/X-25; of ``123456789`` it is 0x906E."""
    crc = 0xFFFF
    for byte in data:
        crc = crc >> 8 ^ _TABLE[(crc ^ byte) & 0xFF]
    return crc ^ 0xFFFF


def sinc_for(rate_hz: float) -> int:
    """Length of the sinc filter for a rate, which is 51200 / length: 100 Hz needs 512, 1000 Hz needs 51."""
    return max(SINC_SHORTEST, min(SINC_LONGEST, round(SINC_RATE_HZ / rate_hz)))


def flags_of(status: int) -> int:
    """The sensor's status word as `Flag`; unknown bits are a fault."""
    flags = 0
    for bit in (1 << shift for shift in range(16)):
        if status & bit:
            flags |= MEANS.get(bit, Flag.FAULT)
    return int(flags)


class BotaConnection(Connection):
    """A sensor that is configured and runs.

    Raises:
        DeviceNotFoundError, DeviceError: as `open_port`.
        DeviceTimeoutError: no response.
    """

    def __init__(self, port: Port, settings: ForceTorqueSettings, clock: Clock) -> None:
        self._port = port
        self._clock = clock
        self._sinc = sinc_for(settings.rate_hz or SINC_RATE_HZ / SINC_LONGEST)
        self._ticks = TickClock(US_PER_S, delay_ns=round(settings.delay_ms * 1e6))
        self._parser = FrameParser()
        self._gaps = Gaps(US_PER_S / self.rate_hz)
        self._last_us = -1
        self._temperature_c = math.nan
        set_up(port, self._sinc, settings.baud or BAUD)
        self._good_s = clocks.monotonic_s()

    @property
    def rate_hz(self) -> float:
        return SINC_RATE_HZ / self._sinc

    @property
    def announced_hz(self) -> float:
        return self.rate_hz

    @property
    def description(self) -> Mapping[str, str]:
        return {
            'kind': 'Bota serial',
            'device': self._port.name,
            'sinc filter': str(self._sinc),
            'temperature': f'{self._temperature_c:.1f} °C',
            'clock drift': self._ticks.drift_text,
            'damaged frames': str(self._parser.bad),
        }

    @property
    def complaint(self) -> str:
        return self._ticks.complaint

    def fetch(self, queue: SampleQueue) -> None:
        data = self._port.read(WAIT_S)
        arrival_ns, read_s = self._clock.now_ns(), clocks.monotonic_s()
        for frame in self._parser.feed(data):
            self._put(frame, arrival_ns, queue)
        if data and read_s - self._good_s > GARBAGE_S:
            raise DeviceLostError(
                f'{self._port.name} sends data, but no complete Bota frames; check the baud rate and the kind of sensor'
            )

    def close(self) -> None:
        self._port.close()

    def _put(self, frame: Frame, arrival_ns: int, queue: SampleQueue) -> None:
        self._good_s = clocks.monotonic_s()
        self._temperature_c = frame.temperature_c
        ticks = self._ticks.unwrapped(frame.time_us)
        require_no_restart(ticks, self._last_us, self._ticks.lead_ns(ticks, arrival_ns), self._port.name)
        flags = flags_of(frame.status)
        if ticks == self._last_us:
            flags |= Flag.STALLED
        self._last_us = ticks
        missing = self._gaps.missing(ticks)
        stamp_ns = self._ticks.stamp(ticks, arrival_ns)
        flags |= self._ticks.flags
        if self._ticks.settled:
            queue.put(frame.wrench, frame.wrench, stamp_ns, arrival_ns, ticks, flags, frame.status, missing)


def set_up(port: Port, sinc: int, baud: int) -> None:
    """Configure a sensor, after power-up or while it runs, and start its frames."""
    _wait_for(port, b'App Init', BOOT_S)  # a sensor that was on before sends frames or nothing: both are fine
    _ask(port, b'C', STOP_TRIES)
    _ask(port, b'c,0,1,0,%d' % BAUD_CODE[baud])
    _ask(port, b'f,%d,0,0,1' % sinc)
    _ask(port, b'R')


def _ask(port: Port, command: bytes, tries: int = 1) -> None:
    letter, answer = command[:1], None
    while answer is None and (tries := tries - 1) >= 0:
        port.write(command)
        answer = _wait_for(port, b'r,0,' + letter + b',', ANSWER_S, after=1)
    if answer is None:
        raise DeviceTimeoutError(
            f'{port.name} does not respond to {command.decode()!r} like a Bota sensor; check the kind of sensor, its '
            'power and the baud rate'
        )
    if answer != b'0':
        raise DeviceError(f'the Bota sensor at {port.name} refuses {command.decode()!r} (response: {answer!r})')


def _wait_for(port: Port, text: bytes, timeout_s: float, after: int = 0) -> bytes | None:
    """The `after` bytes that follow a text, once they have arrived; None if they do not arrive."""
    received, is_over, deadline_s = b'', False, clocks.monotonic_s() + timeout_s
    while not is_over:
        is_over = clocks.monotonic_s() >= deadline_s  # what came while this computer paused is read all the same
        received += port.read(WAIT_S)
        found = received.find(text)
        if found >= 0 and len(received) >= found + len(text) + after:
            return received[found + len(text) : found + len(text) + after]
        if not after and received.count(HEADER) > 3 and FrameParser().feed(received):
            return None  # it is running already, so there will be no text
    return None


def bota_sensor(settings: ForceTorqueSettings, clock: Clock, device: str) -> StreamedForceTorque:
    """The Bota sensor at a serial port, not open yet. Raises ConfigurationError: the sensor has no such baud rate."""
    baud = settings.baud or BAUD
    if baud not in BAUD_CODE:
        known = ', '.join(str(each) for each in BAUD_CODE)
        raise ConfigurationError(f'a Bota sensor has no {baud} baud; set force_torque.baud to one of {known}')

    def connect() -> BotaConnection:
        port = open_port(device, baud, settings.dtr, clock)
        try:
            return BotaConnection(port, settings, clock)
        except BaseException:
            port.close()
            raise

    return StreamedForceTorque(f'the Bota sensor at {device}', connect, settings, clock, AXES)
