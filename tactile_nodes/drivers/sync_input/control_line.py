"""The digital line of the machine, as this host sees it on a control line of a serial port.

The machine's output, converted to the adapter's level (24 V needs an optocoupler), goes to CTS, DSR, RI or CD of a
USB-serial adapter. If its driver can wait for a change (TIOCMIWAIT, on Linux with most adapters), the thread uses that;
otherwise it polls every millisecond. Every edge carries the uncertainty of its time. A thread that waits cannot know
how late it has woken up, so on a loaded computer polls (`wait: false`) state their uncertainty more truly.

A light in the camera's view is the alternative: `sync.light` finds its edges.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import termios
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import serial

from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.drivers.health import Health, Level
from tactile_nodes.errors import DeviceError, DeviceLostError, DeviceNotFoundError, DeviceTimeoutError, TactileError
from tactile_nodes.params import parameter

MASKS = {'cts': termios.TIOCM_CTS, 'dsr': termios.TIOCM_DSR, 'ri': termios.TIOCM_RI, 'cd': termios.TIOCM_CD}
JOIN_S = 0.5


@dataclass(frozen=True)
class SyncInputSettings:
    """Settings of the watched line."""

    device: str = parameter('', 'serial port, preferably from /dev/serial/by-id; empty: none')
    line: str = parameter('cts', 'its control line', choices=tuple(MASKS))
    invert: bool = parameter(
        False, 'a high level clears the control line (true for a divider at a TTL adapter, not for an optocoupler)'
    )
    poll_ms: float = parameter(1.0, 'polling interval, if the driver cannot wait', minimum=0.1)
    wait: bool = parameter(True, 'let the driver wait for changes, if it can')
    delay_ms: float = parameter(
        0.0, 'constant time from the edge to this program, subtracted from the stamps', minimum=0.0
    )


class Edge(NamedTuple):
    """A change of the line.

    Attributes:
        stamp_ns: its time, on the host's time base.
        level: the level after it.
        number: of the edge since the input was opened, from 1.
        uncertainty_s: half the width of the interval in which it happened.
    """

    stamp_ns: int
    level: bool
    number: int
    uncertainty_s: float


class ControlLine(Protocol):
    """A digital input."""

    def level(self) -> bool:
        """The level now.

        Raises:
            OSError: it is gone.
        """
        ...

    def wait(self) -> bool:
        """Return True after the next change; False at once if it cannot wait for one.

        Raises:
            OSError: it is gone.
        """
        ...

    def close(self) -> None:
        """Close it."""
        ...


class SerialControlLine:
    """A control line of an open serial port."""

    def __init__(self, port: serial.SerialBase, line: str) -> None:
        self._port = port
        self._line = line

    def level(self) -> bool:
        """As the adapter reports it."""
        return bool(getattr(self._port, self._line))

    def wait(self) -> bool:
        """Wait in the kernel, if the adapter's driver supports it."""
        try:
            fcntl.ioctl(self._port.fileno(), termios.TIOCMIWAIT, MASKS[self._line])
        except OSError as error:
            if error.errno in {errno.ENOTTY, errno.EINVAL, errno.EOPNOTSUPP, errno.ENOSYS}:
                return False
            raise
        return True

    def close(self) -> None:
        """Close the port."""
        self._port.close()


class WatchedLine:
    """A thread that watches a control line.

    Args:
        name: of the line, for errors.
        line: to be watched.
        settings: `poll_ms`, `wait`, `invert` and `delay_ms` are used.
        clock: stamps the edges.
    """

    def __init__(self, name: str, line: ControlLine, settings: SyncInputSettings, clock: Clock) -> None:
        self._name = name
        self._line = line
        self._settings = settings
        self._clock = clock
        self._edges: deque[Edge] = deque()
        self._changed = threading.Condition()
        self._stopping = threading.Event()
        self._failure: TactileError | None = None
        self._waits = settings.wait
        self._count = 0
        self._thread: threading.Thread | None = None

    @property
    def description(self) -> Mapping[str, str]:
        """The watched line, and the method."""
        return {'line': self._name, 'watched by': 'waiting' if self._waits else f'{self._settings.poll_ms:g} ms polls'}

    @property
    def health(self) -> Health:
        """ERROR if the line is gone."""
        if self._thread is None:
            return Health(Level.STALE, f'{self._name} is not open')
        if self._failure is not None:
            return Health(Level.ERROR, str(self._failure))
        return Health(Level.OK, f'edges: {self._count}')

    def open(self) -> None:
        """Start watching."""
        try:
            looked_ns, level = self._clock.now_ns(), self._line.level()
        except OSError as error:
            raise DeviceError(f'{self._name} cannot be read ({error}); use an adapter with control lines') from error
        self._thread = threading.Thread(
            target=self._run, args=(level, looked_ns), name=f'sync input {self._name}', daemon=True
        )
        self._thread.start()

    def read(self, timeout_s: float) -> Sequence[Edge]:
        """Every edge since the last call; `close` in another thread ends the wait."""
        with self._changed:
            over = self._changed.wait_for(lambda: self._edges or self._failure or self._thread is None, timeout_s)
            if self._thread is None:
                raise DeviceError(f'{self._name} is closed; open it before reading')
            if not over:
                raise DeviceTimeoutError(f'{self._name} has not changed within {timeout_s:g} s')
            if not self._edges:
                raise DeviceLostError(str(self._failure)) from self._failure
            edges = list(self._edges)
            self._edges.clear()
            return edges

    def close(self) -> None:
        """Stop watching; a thread that waits in the driver ends with the next edge."""
        with self._changed:
            thread, self._thread = self._thread, None
            self._changed.notify_all()
        if thread is None:
            return
        self._stopping.set()
        thread.join(JOIN_S)
        with contextlib.suppress(OSError):
            self._line.close()

    def _run(self, level: bool, looked_ns: int) -> None:
        try:
            while not self._stopping.is_set():
                waited = self._pause()
                before_ns, looked_ns = looked_ns, self._clock.now_ns()
                before, level = level, self._line.level()
                if level != before and not self._stopping.is_set():
                    earliest_ns, latest_ns = (looked_ns, looked_ns) if waited else (before_ns, self._clock.now_ns())
                    self._put(level, earliest_ns, latest_ns)
        except (OSError, TypeError) as error:  # TypeError: pyserial, closed by another thread
            lost = DeviceLostError(f'{self._name} is gone ({error}); check its cable and reopen it')
            with self._changed:
                self._failure = lost
                self._changed.notify_all()

    def _pause(self) -> bool:
        """Wait for a change, if the driver can; else for the polling interval."""
        if self._waits:
            self._waits = self._line.wait()
        if not self._waits:
            self._stopping.wait(self._settings.poll_ms / 1000)
        return self._waits

    def _put(self, level: bool, old_ns: int, new_ns: int) -> None:
        """Store an edge: it happened after the last poll with the old level began, and before the next had ended."""
        self._count += 1
        half_s = max((new_ns - old_ns) / 2 / NS_PER_S, 1e-4)
        stamp_ns = (old_ns + new_ns) // 2 - round(self._settings.delay_ms * 1e6)
        with self._changed:
            self._edges.append(Edge(stamp_ns, level != self._settings.invert, self._count, half_s))
            self._changed.notify_all()


def open_sync_input(settings: SyncInputSettings, clock: Clock) -> WatchedLine:
    """The line of the settings, being watched.

    Raises:
        DeviceNotFoundError: no such port, or no permission to open it.
        DeviceError: it has no control lines.
    """
    name = f'{settings.line.upper()} of {settings.device}'
    try:
        # Exclusive: opening sets the baud rate, also of a port over which another program commands a machine.
        port = serial.serial_for_url(settings.device, timeout=0, exclusive=True)
    except (serial.SerialException, OSError, ValueError) as error:
        raise DeviceNotFoundError(
            f'cannot open {settings.device or "a port without a name"} to watch its {settings.line.upper()} line '
            f'({error}); use a port that exists and that no other program uses'
        ) from error
    with contextlib.suppress(AttributeError, OSError, ValueError, NotImplementedError):
        port.set_low_latency_mode(True)  # otherwise FTDI adapters report a change up to 16 ms late
    watched = WatchedLine(name, SerialControlLine(port, settings.line), settings, clock)
    try:
        watched.open()
    except BaseException:
        port.close()
        raise
    return watched
