"""Sensors that send lines of text, ``t_us,ch0[,ch1..5]``: an HX711 on an Arduino, or any script.

A line is the sensor's own time in microseconds (unsigned, may wrap at 2³² or 2⁶⁴), then one to six numbers, integer or
decimal, separated by commas, ended by LF or CR LF. ``nan`` and ``inf``, as printed by an Arduino, are faults. Lines
that begin with ``#`` are comments. ``docs/force_torque.md`` has a sketch for an Arduino.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import NamedTuple

from tactile_nodes import clock as clocks
from tactile_nodes.clock import Clock
from tactile_nodes.drivers.force_torque.clock import TickClock
from tactile_nodes.drivers.force_torque.contract import AXES, Flag, ForceTorqueSettings, TextLineSettings, Wrench
from tactile_nodes.drivers.force_torque.queue import SampleQueue
from tactile_nodes.drivers.force_torque.serial_line import WAIT_S, Gaps, require_no_restart
from tactile_nodes.drivers.force_torque.stream import Connection, StreamedForceTorque
from tactile_nodes.drivers.serial_port import Port, open_port
from tactile_nodes.errors import DeviceLostError

BAUD = 115_200
US_PER_S = 1e6
MOST_DRIFT = 0.01  # an Arduino Uno counts microseconds with a ceramic resonator
LONGEST_LINE = 200
GARBAGE_S = 2.0
NUMBER = rb'-?(?:\d{1,12}(?:\.\d{0,12})?(?:[eE][+-]?\d{1,2})?|(?i:nan|inf))'
LINE = re.compile(rb'(\d{1,20})((?:\s*,\s*' + NUMBER + rb'){1,6})\s*')


class Line(NamedTuple):
    """One line."""

    time_us: int
    values: tuple[float, ...]


class LineParser:
    """Finds lines in a stream of bytes.

    Attributes:
        bad: lines with another format.
    """

    def __init__(self) -> None:
        self.bad = 0
        self._bytes = b''
        self._first = True

    def feed(self, data: bytes) -> list[Line]:
        """The lines that are complete with these bytes."""
        *lines, self._bytes = (self._bytes + data).split(b'\n')
        if len(self._bytes) > LONGEST_LINE:
            self._bytes = b''
            self.bad += 1
        return [line for line in map(self._parsed, lines) if line is not None]

    def _parsed(self, text: bytes) -> Line | None:
        first, self._first = self._first, False
        line = parse(text)
        if line is None or first:  # the first line may be truncated at its start and still look valid
            self.bad += not first and not text.startswith(b'#') and bool(text.strip())
            return None
        return line


def parse(text: bytes) -> Line | None:
    """``1200,-351`` is (1200, (-351.0,)); None if the line has another format."""
    found = LINE.fullmatch(text)
    if found is None:
        return None
    values = tuple(float(value) for value in found.group(2).split(b',')[1:])
    return Line(int(found.group(1)) % (1 << 32), values)


def wrench_of(values: tuple[float, ...], settings: TextLineSettings) -> Wrench:
    """The values in N and N·m on the axes of their channels, NaN on the others."""
    wrench = dict.fromkeys(AXES, math.nan)
    for axis, value, scale in zip(settings.axes, values, settings.units_per_count, strict=True):
        wrench[axis] = value * scale
    return (wrench['fx'], wrench['fy'], wrench['fz'], wrench['tx'], wrench['ty'], wrench['tz'])


class TextLineConnection(Connection):
    """An open port from which lines are read."""

    def __init__(self, port: Port, settings: ForceTorqueSettings, clock: Clock) -> None:
        self._port = port
        self._settings = settings
        self._clock = clock
        self._ticks = TickClock(US_PER_S, delay_ns=round(settings.delay_ms * 1e6), most_drift=MOST_DRIFT)
        self._parser = LineParser()
        self._gaps = Gaps(US_PER_S / settings.rate_hz if settings.rate_hz else 0.0)
        self._last_us = -1
        self._wrong = 0
        self._good_s = 0.0

    @property
    def rate_hz(self) -> float:
        return US_PER_S / self._gaps.period_ticks if self._gaps.period_ticks > 0 else 0.0

    @property
    def announced_hz(self) -> float:
        return self._settings.rate_hz

    @property
    def description(self) -> Mapping[str, str]:
        text = self._settings.text
        scales = ' '.join(f'{axis}:{scale:g}' for axis, scale in zip(text.axes, text.units_per_count, strict=True))
        return {
            'kind': 'text line',
            'device': self._port.name,
            'units per count': scales,
            'clock drift': self._ticks.drift_text,
            'damaged lines': str(self._parser.bad),
        }

    @property
    def complaint(self) -> str:
        """A message if lines have a wrong number of channels, or if its clock does not keep its rate."""
        if self._wrong:
            return f'{self._wrong} lines did not have {len(self._settings.text.axes)} channels'
        return self._ticks.complaint

    def fetch(self, queue: SampleQueue) -> None:
        data = self._port.read(WAIT_S)
        arrival_ns, read_s = self._clock.now_ns(), clocks.monotonic_s()
        if data and not self._good_s:  # a board that restarts when its port is opened first sends nothing for seconds
            self._good_s = read_s
        for line in self._parser.feed(data):
            self._put(line, arrival_ns, queue)
        if data and read_s - self._good_s > GARBAGE_S:
            raise DeviceLostError(
                f'{self._port.name} sends data, but no lines of t_us and {len(self._settings.text.axes)} channels; '
                'check baud and text.axes'
            )

    def close(self) -> None:
        self._port.close()

    def _put(self, line: Line, arrival_ns: int, queue: SampleQueue) -> None:
        text = self._settings.text
        if len(line.values) != len(text.axes):
            self._wrong += 1
            return
        self._good_s = clocks.monotonic_s()
        ticks = self._ticks.unwrapped(line.time_us)
        require_no_restart(ticks, self._last_us, self._ticks.lead_ns(ticks, arrival_ns), self._port.name)
        flags = self._flags(line, ticks)
        missing = self._gaps.missing(ticks)
        stamp_ns = self._ticks.stamp(ticks, arrival_ns)
        flags |= self._ticks.flags
        if self._ticks.settled and self.rate_hz > 0:
            wrench = wrench_of(line.values, text)
            queue.put(wrench, line.values, stamp_ns, arrival_ns, ticks, flags, 0, missing)

    def _flags(self, line: Line, ticks: int) -> int:
        text, flags = self._settings.text, 0
        if any(value <= text.lowest or value >= text.highest for value in line.values):
            flags |= Flag.SATURATED
        if ticks <= self._last_us:
            flags |= Flag.STALLED
        self._last_us = max(self._last_us, ticks)
        return int(flags)


def text_line_sensor(settings: ForceTorqueSettings, clock: Clock, device: str) -> StreamedForceTorque:
    """The text-line sensor at a serial port, not open yet."""
    axes = tuple(axis for axis in AXES if axis in settings.text.axes)

    def connect() -> TextLineConnection:
        return TextLineConnection(open_port(device, settings.baud or BAUD, settings.dtr, clock), settings, clock)

    return StreamedForceTorque(f'the text-line sensor at {device}', connect, settings, clock, axes)
