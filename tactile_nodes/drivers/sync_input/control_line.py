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
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import serial

from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.drivers.health import Health, Level
from tactile_nodes.drivers.reopening import Reopening
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


class SerialControlLine(ControlLine):
    """A control line of an open serial port."""

    def __init__(self, port: serial.SerialBase, line: str) -> None:
        self._port = port
        self._line = line

    def level(self) -> bool:
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
        self._port.close()


class _Watch:
    """A line that is being watched: its level when it was last looked at, and when that was."""

    def __init__(self, line: ControlLine, settings: SyncInputSettings, clock: Clock) -> None:
        self._line = line
        self._poll_s = settings.poll_ms / 1000
        self._clock = clock
        self.waits = settings.wait
        self._looked_ns, self._level = clock.now_ns(), line.level()

    def change(self, stopping: threading.Event) -> tuple[bool, int, int] | None:
        """Wait a moment; if the line has changed: its level, and the earliest and latest time of the change."""
        if self.waits:
            self.waits = self._line.wait()
        if not self.waits:
            stopping.wait(self._poll_s)
        before_ns, self._looked_ns = self._looked_ns, self._clock.now_ns()
        before, self._level = self._level, self._line.level()
        if self._level == before or stopping.is_set():
            return None
        return (
            (self._level, self._looked_ns, self._looked_ns)
            if self.waits
            else (self._level, before_ns, self._clock.now_ns())
        )

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._line.close()


class WatchedLine:
    """A control line that a thread watches. A lost one is reopened (`Reopening`); its edges meanwhile are missing.

    Args:
        name: of the line, for errors.
        connect: opens the line.
        settings: `poll_ms`, `wait`, `invert` and `delay_ms` are used.
        clock: stamps the edges.
    """

    def __init__(
        self, name: str, connect: Callable[[], ControlLine], settings: SyncInputSettings, clock: Clock
    ) -> None:
        self._name = name
        self._connect = connect
        self._settings = settings
        self._clock = clock
        self._edges: deque[Edge] = deque()
        self._changed = threading.Condition()
        self._stopping = threading.Event()
        self._reason: TactileError | None = None
        self._lost_ns = 0
        self._count = 0
        self._source = Reopening(f'sync input {name}', self._connected, self._look, self._lost)

    @property
    def description(self) -> Mapping[str, str]:
        """The watched line, the method, and the number of losses."""
        watch = self._source.connection
        waits = self._settings.wait if watch is None else watch.waits
        return {
            'line': self._name,
            'watched by': 'waiting' if waits else f'{self._settings.poll_ms:g} ms polls',
            'edges': str(self._count),
            'times lost': str(self._source.losses),
        }

    @property
    def health(self) -> Health:
        """ERROR while it is lost."""
        if not self._source.is_open:
            return Health(Level.STALE, f'{self._name} is not open')
        if self._reason is not None:
            lost_s = (self._clock.now_ns() - self._lost_ns) / NS_PER_S
            return Health(Level.ERROR, f'lost for {lost_s:.1f} s, reconnecting: {self._reason}')
        again = f'; reconnected so far: {self._source.losses}' if self._source.losses else ''
        return Health(Level.OK, f'edges: {self._count}{again}')

    def open(self) -> None:
        """Start watching; the first failure is raised.

        Raises:
            DeviceNotFoundError: no such port, or no permission to open it.
            DeviceError: it has no control lines.
        """
        self._stopping.clear()
        self._source.open()

    def read(self, timeout_s: float) -> Sequence[Edge]:
        """Every edge since the last call, oldest first; at least one. `close` in another thread ends the wait.

        Raises:
            DeviceTimeoutError: none within `timeout_s`: the line has not changed, or the port is lost.
            DeviceError: it is not open.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._edges or not self._source.is_open, timeout_s)
            if not self._source.is_open:
                raise DeviceError(f'{self._name} is closed; open it before reading')
            if not self._edges:
                why = f'is lost ({self._reason}); reconnecting' if self._reason else 'has not changed'
                raise DeviceTimeoutError(f'{self._name} {why} (waited {timeout_s:g} s)')
            edges = list(self._edges)
            self._edges.clear()
            return edges

    def close(self) -> None:
        """Stop watching; a thread that waits in the driver ends with the next edge."""
        self._stopping.set()
        self._source.close(JOIN_S)
        with self._changed:
            self._changed.notify_all()

    def _connected(self) -> _Watch:
        line = self._connect()
        try:
            watch = _Watch(line, self._settings, self._clock)
        except OSError as error:
            line.close()
            raise DeviceError(f'{self._name} cannot be read ({error}); use an adapter with control lines') from error
        self._reason = None
        return watch

    def _look(self, watch: _Watch) -> bool:
        try:
            change = watch.change(self._stopping)
        except (OSError, TypeError) as error:  # TypeError: pyserial, closed by another thread
            raise DeviceLostError(f'{self._name} is gone ({error}); check its cable and reopen it') from error
        if change is not None:
            self._put(*change)
        return True

    def _lost(self, error: TactileError) -> None:
        if self._reason is None:
            self._lost_ns = self._clock.now_ns()
        self._reason = error

    def _put(self, level: bool, earliest_ns: int, latest_ns: int) -> None:
        """Store an edge, with the uncertainty of its time."""
        self._count += 1
        half_s = max((latest_ns - earliest_ns) / 2 / NS_PER_S, 1e-4)
        stamp_ns = (earliest_ns + latest_ns) // 2 - round(self._settings.delay_ms * 1e6)
        with self._changed:
            self._edges.append(Edge(stamp_ns, level != self._settings.invert, self._count, half_s))
            self._changed.notify_all()


def serial_line(settings: SyncInputSettings) -> SerialControlLine:
    """The line of the settings.

    Raises:
        DeviceNotFoundError: no such port, or no permission to open it.
    """
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
    return SerialControlLine(port, settings.line)


def sync_input(settings: SyncInputSettings, clock: Clock) -> WatchedLine:
    """The line of the settings, not open yet."""
    name = f'{settings.line.upper()} of {settings.device}'
    return WatchedLine(name, lambda: serial_line(settings), settings, clock)
