"""The line to a firmware: its simulator as a program, or a port; faults on the line; and the tip's reported place.

`ReportedPlace` reads the firmware's output before any fault changes it. So it knows the true depth even if the driver
gets wrong reports or none.
"""

from __future__ import annotations

import contextlib
import os
import pty
import shlex
import signal
import subprocess
import tty
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import serial

from benchmarks.devices.serial_faults import LineFaults
from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.drivers.cnc.contract import Place
from tactile_nodes.drivers.cnc.grbl_words import parse_report
from tactile_nodes.drivers.cnc.marlin import marlin_place
from tactile_nodes.drivers.serial_port import SerialPort, open_port
from tactile_nodes.errors import ConfigurationError, DeviceNotFoundError

QUESTIONS = {'grbl': b'?', 'marlin': b'M114 R\n'}
OWN_QUESTION_S = 0.1
AHEAD_S = 0.15  # without a report for longer than this, the tip is assumed at rest
SEEN_MM = 0.003


class Wire(Protocol):
    """Bytes to and from a firmware."""

    def write(self, data: bytes) -> None:
        """Send bytes."""
        ...

    def read(self) -> bytes:
        """The received bytes, without waiting."""
        ...

    def restart(self) -> None:
        """Cut its power for a moment. Raises ConfigurationError if this is impossible."""
        ...

    def halt(self) -> None:
        """Stop its processor, as if the firmware hangs. Raises as `restart`."""
        ...

    def close(self) -> None:
        """Close the connection."""
        ...


class Program:
    """A simulator that uses its standard streams, on a pseudo terminal.

    Args:
        command: the command that starts it, in shell syntax.

    Raises:
        DeviceNotFoundError: there is no such program.
    """

    def __init__(self, command: str) -> None:
        self._words = shlex.split(command)
        self._start()

    def write(self, data: bytes) -> None:
        """As `Wire.write`; bytes are lost if the line is full."""
        with contextlib.suppress(OSError):
            os.write(self._master, data)

    def read(self) -> bytes:
        """As `Wire.read`."""
        try:
            return os.read(self._master, 4096)
        except OSError:  # no data, or it has ended
            return b''

    def restart(self) -> None:
        """As `Wire.restart`: end the program, and start it again."""
        self.close()
        self._start()

    def halt(self) -> None:
        """As `Wire.halt`."""
        os.killpg(self._process.pid, signal.SIGSTOP)

    def close(self) -> None:
        """As `Wire.close`: end the program and its child processes."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        os.close(self._master)

    def _start(self) -> None:
        self._master, slave = pty.openpty()
        tty.setraw(slave)
        os.set_blocking(self._master, False)
        try:
            self._process = subprocess.Popen(
                self._words, stdin=slave, stdout=slave, stderr=subprocess.DEVNULL, start_new_session=True
            )
        except OSError as error:
            os.close(self._master)
            raise DeviceNotFoundError(f'cannot start {shlex.join(self._words)}: {error.strerror}') from error
        finally:
            os.close(slave)


class PortWire:
    """A board at a serial port, or a simulator at a network socket (``socket://HOST:PORT``)."""

    def __init__(self, port: SerialPort) -> None:
        self._port = port

    def write(self, data: bytes) -> None:
        """As `Wire.write`."""
        self._port.write(data)

    def read(self) -> bytes:
        """As `Wire.read`."""
        return self._port.read(0.0)

    def restart(self) -> None:
        """Raises ConfigurationError: its power cannot be cut."""
        raise ConfigurationError(f'the power of {self._port.name} cannot be cut from here')

    def halt(self) -> None:
        """Raises ConfigurationError: it cannot be halted."""
        raise ConfigurationError(f'{self._port.name} cannot be halted from here')

    def close(self) -> None:
        """As `Wire.close`."""
        self._port.close()


def open_wire(source: str, baud: int, clock: Clock) -> Wire:
    """Open a port (``/dev/…``), a socket, or else a command.

    Raises:
        DeviceError: it cannot be opened or started.
    """
    if source.startswith('socket://'):
        try:
            return PortWire(SerialPort(serial.serial_for_url(source, timeout=0), source))
        except serial.SerialException as error:
            raise DeviceNotFoundError(f'nobody answers at {source} ({error}); start the simulator first') from error
    if source.startswith('/dev/') and Path(source).is_char_device():
        return PortWire(open_port(source, baud, 'default', clock))
    return Program(source)


class ReportedPlace:
    """The place of the tip, from the firmware's reports.

    Args:
        surface_mm: height of the gel.
        on_report: called with the time at each report.

    Attributes:
        deepest_mm: largest reported depth below the surface since `begin`.
        moved_ns: time of the last report with a changed place.
    """

    def __init__(self, surface_mm: float, on_report: Callable[[int], None]) -> None:
        self._surface_mm = surface_mm
        self._on_report = on_report
        self._shift_mm = (0.0, 0.0, 0.0)
        self._restarted = False
        self._before: tuple[Place, int] | None = None
        self._last: tuple[Place, int] | None = None
        self.deepest_mm = -1e9
        self.moved_ns = 0

    @property
    def place(self) -> Place | None:
        """The last reported place, in machine coordinates after homing."""
        return self._last[0] if self._last else None

    @property
    def depth_mm(self) -> float:
        """Depth of the last reported place; negative above the gel."""
        return self._surface_mm - self._last[0][2] if self._last else -1e9

    def depth_at(self, time_ns: int) -> float:
        """The depth at a time, extrapolated from the last two reports; for sensor values between reports."""
        last, before = self._last, self._before
        if last is None:
            return -1e9
        if before is None or time_ns > last[1] + AHEAD_S * NS_PER_S or before[1] >= last[1]:
            return self._surface_mm - last[0][2]
        share = (time_ns - last[1]) / (last[1] - before[1])
        return self._surface_mm - (last[0][2] + min(share, 1.5) * (last[0][2] - before[0][2]))

    def begin(self) -> None:
        """Begin the press: forget earlier depths."""
        self.deepest_mm, self.moved_ns = self.depth_mm, 0

    def restarted(self) -> None:
        """The firmware has lost its place; its next reported place is the present place of the tip."""
        self._restarted = True

    def take(self, line: str, now_ns: int) -> None:
        """Read a line from the firmware."""
        report = parse_report(line) if line.startswith('<') else None
        place = report.machine if report is not None else marlin_place(line.removeprefix('ok '))
        if place is None:
            return
        if self._restarted and self._last is not None:
            self._shift_mm = _minus(self._last[0], place)
            self._restarted = False
        place = _minus(place, _minus((0.0, 0.0, 0.0), self._shift_mm))
        if self._last is not None and max(map(abs, _minus(place, self._last[0]))) > SEEN_MM:
            self.moved_ns = now_ns
        self._before, self._last = self._last, (place, now_ns)
        self.deepest_mm = max(self.deepest_mm, self.depth_mm)
        self._on_report(now_ns)


class Line:
    """A device for `PtyPort`: the firmware, with faults on its line, and `place` before the faults.

    Args:
        wire: connection to the firmware.
        kind: grbl or marlin.
        place: gets every line from the firmware.
        clock: the host's clock.

    Attributes:
        faults: faults of the line.
        cut: the host is disconnected; only this object sends questions and reads the answers.
        asking: this object also asks for the place, because the commanding process may have ended.
        received: bytes from the host while `asking`, with their times.
        kill_host: kills the process that commands the machine.
    """

    def __init__(self, wire: Wire, kind: str, place: ReportedPlace, clock: Clock) -> None:
        self.wire = wire
        self.kind = kind
        self._place = place
        self._clock = clock
        self._partial = b''
        self._output = b''
        self._question_ns = 0
        self.faults = LineFaults()
        self.cut = self.asking = False
        self.received: list[tuple[int, bytes]] = []
        self.kill_host: Callable[[], None] = _no_host

    def receive(self, data: bytes) -> None:
        """As `Pluggable.receive`."""
        if self.asking:
            self.received.append((self._clock.now_ns(), data))
        if not self.cut and (passed := self.faults.passed('>', data)):
            self.wire.write(passed)

    def run(self) -> None:
        """As `Pluggable.run`. The output passes line by line, because faults apply to lines."""
        *lines, self._partial = (self._partial + self.wire.read()).split(b'\n')
        for line in lines:
            self._place.take(line.decode('ascii', 'replace').strip(), self._clock.now_ns())
            if not self.cut:
                self._output += self.faults.passed('<', line + b'\n')
        if (self.cut or self.asking) and self._clock.now_ns() - self._question_ns > OWN_QUESTION_S * NS_PER_S:
            self._question_ns = self._clock.now_ns()
            self.wire.write(QUESTIONS[self.kind])

    def say(self, line: bytes) -> None:
        """Send a line to the host, as if it came from the firmware."""
        self._output += line

    def restart(self) -> None:
        """Cut the firmware's power for a moment."""
        self._place.restarted()
        self._partial = b''
        self.wire.restart()

    def take_output(self) -> bytes:
        """As `Pluggable.take_output`."""
        output, self._output = self._output, b''
        return output

    def next_event_ns(self) -> int | None:
        """As `Pluggable.next_event_ns`: unknown."""
        return None

    def power_cycle(self) -> None:
        """As `Pluggable.power_cycle`; the line has no power supply."""


def _no_host() -> None:
    raise ConfigurationError('this process commands the machine itself, so it is not the one to be killed')


def _minus(a: Place, b: Place) -> Place:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])
