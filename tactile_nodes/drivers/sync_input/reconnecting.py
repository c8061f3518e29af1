"""A sync input that reconnects by itself after its adapter was unplugged."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.drivers.health import Health, Level
from tactile_nodes.drivers.sync_input.control_line import Edge, SyncInputSettings, WatchedLine, open_sync_input
from tactile_nodes.errors import DeviceError, DeviceLostError, DeviceTimeoutError

FIRST_DELAY_S = 0.25
LONGEST_DELAY_S = 5.0


class ReconnectingSyncInput:
    """A sync input that wraps the lines opened by `connect`, one after another.

    The first `open` fails if the line fails: a line that was never there should be reported at once. After that, a lost
    line is reopened repeatedly, with delays that double from 0.25 s to 5 s. Meanwhile `read` raises
    `DeviceTimeoutError`, never `DeviceLostError`, and keeps its timeout. Edges during that time are missing; the
    numbering continues.

    Args:
        connect: returns a line that is being watched.
        clock: times the delays.
        name: of the line, for errors.
    """

    def __init__(self, connect: Callable[[], WatchedLine], clock: Clock, name: str) -> None:
        self._connect = connect
        self._clock = clock
        self._name = name
        self._line: WatchedLine | None = None
        self._opened = False
        self._reason = ''
        self._lost_ns = 0
        self._delay_s = FIRST_DELAY_S
        self._next_try_ns = 0
        self._losses = 0
        self._count = 0

    @property
    def description(self) -> Mapping[str, str]:
        """The watched line, the method, and the number of losses."""
        line = self._line.description if self._line is not None else {'line': self._name}
        return {**line, 'edges': str(self._count), 'times lost': str(self._losses)}

    @property
    def health(self) -> Health:
        """ERROR while it is lost; else the health of the line."""
        if not self._opened:
            return Health(Level.STALE, f'{self._name} is not open')
        if self._line is None:
            lost_s = (self._clock.now_ns() - self._lost_ns) / NS_PER_S
            return Health(Level.ERROR, f'lost for {lost_s:.1f} s, reconnecting: {self._reason}')
        health = self._line.health
        if health.level != Level.OK:
            return health
        again = f'; reconnected so far: {self._losses}' if self._losses else ''
        return Health(Level.OK, f'edges: {self._count}{again}')

    def open(self) -> None:
        """Start watching; the first failure is raised.

        Raises:
            DeviceNotFoundError: no such port, or no permission to open it.
            DeviceError: it has no control lines.
        """
        self._line = self._connect()
        self._opened = True

    def read(self, timeout_s: float) -> Sequence[Edge]:
        """Every edge since the last call, oldest first; at least one.

        Raises:
            DeviceTimeoutError: none within `timeout_s`: the line has not changed, or the port is lost.
            DeviceError: it is not open.
        """
        if not self._opened:
            raise DeviceError(f'{self._name} is closed; open it before reading')
        deadline_ns = self._clock.now_ns() + round(timeout_s * NS_PER_S)
        line = self._line or self._try_again(deadline_ns)
        try:
            edges = line.read(max(0.0, (deadline_ns - self._clock.now_ns()) / NS_PER_S))
        except DeviceLostError as error:
            self._lose(error)
            raise DeviceTimeoutError(f'{error}; reconnecting') from error
        numbered = [edge._replace(number=self._count + number) for number, edge in enumerate(edges, start=1)]
        self._count += len(edges)
        return numbered

    def close(self) -> None:
        """Close it; a second call does nothing."""
        self._opened = False
        self._drop()

    def _try_again(self, deadline_ns: int) -> WatchedLine:
        """The line, if it is available before the deadline."""
        self._clock.sleep_until(min(self._next_try_ns, deadline_ns))
        if self._next_try_ns > deadline_ns:
            raise DeviceTimeoutError(f'{self._name} is lost ({self._reason}); reconnecting')
        try:
            self._line = self._connect()
        except DeviceError as error:
            self._wait_longer(error)
            raise DeviceTimeoutError(f'{self._name} is still lost ({error}); reconnecting') from error
        self._delay_s = FIRST_DELAY_S
        return self._line

    def _lose(self, error: DeviceError) -> None:
        self._losses += 1
        self._lost_ns = self._clock.now_ns()
        self._wait_longer(error)
        self._drop()

    def _wait_longer(self, error: DeviceError) -> None:
        self._reason = str(error)
        self._next_try_ns = self._clock.now_ns() + round(self._delay_s * NS_PER_S)
        self._delay_s = min(2 * self._delay_s, LONGEST_DELAY_S)

    def _drop(self) -> None:
        line, self._line = self._line, None
        if line is not None:
            line.close()


def reconnecting_sync_input(settings: SyncInputSettings, clock: Clock) -> ReconnectingSyncInput:
    """The line of the settings, not open yet."""
    name = f'{settings.line.upper()} of {settings.device}'
    return ReconnectingSyncInput(lambda: open_sync_input(settings, clock), clock, name)
