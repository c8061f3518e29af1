"""A sensor that sends continuously: a thread that receives, and reopens the sensor after it was lost."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.drivers.force_torque.check import NS_PER_MS, SampleCheck, permitted_ms, too_old
from tactile_nodes.drivers.force_torque.contract import (
    UNUSABLE,
    Flag,
    ForceTorqueSensor,
    ForceTorqueSettings,
    Listener,
    Sample,
)
from tactile_nodes.drivers.force_torque.queue import SampleQueue, closed
from tactile_nodes.drivers.health import Health, Level
from tactile_nodes.drivers.reopening import Reopening
from tactile_nodes.errors import DeviceLostError, DeviceTimeoutError, TactileError

FIRST_SAMPLE_S = 5.0  # a board that restarts when its port is opened needs two, and a slow converter another one
JOIN_S = 3.0


class Connection(Protocol):
    """An open connection to a sensor; make a new one after it is lost."""

    @property
    def rate_hz(self) -> float:
        """Samples per second, as announced or observed."""
        ...

    @property
    def announced_hz(self) -> float:
        """Samples per second as set or as the sensor reports; 0: unknown."""
        ...

    @property
    def description(self) -> Mapping[str, str]:
        """What it is and its settings."""
        ...

    @property
    def complaint(self) -> str:
        """A message for a person about a problem, although it works; empty: none."""
        ...

    def fetch(self, queue: SampleQueue) -> None:
        """Wait, at most 0.1 s, for data, and put it into the queue.

        Raises:
            DeviceLostError: no more data will come.
        """
        ...

    def close(self) -> None:
        """Stop the sensor, and close it."""
        ...


class StreamedForceTorque(ForceTorqueSensor):
    """The sensor behind the connections made by `connect`, one after another.

    The first `open` fails if the connection fails. After that, a lost sensor is reopened (`Reopening`). Meanwhile
    `read` raises `DeviceLostError`, because a program that moves something has to know. The first sample afterwards
    carries `Flag.RESTARTED`.

    Args:
        name: for errors.
        connect: opens the sensor.
        settings: `lost_s`, `silence_ms`, `same_values` and `queue` are used.
        clock: stamps the arrivals.
        axes: the measured components of the wrench.
    """

    def __init__(
        self,
        name: str,
        connect: Callable[[], Connection],
        settings: ForceTorqueSettings,
        clock: Clock,
        axes: tuple[str, ...],
    ) -> None:
        self.name = name
        self._connect = connect
        self._settings = settings
        self._clock = clock
        self._axes = axes
        self._queue = self._new_queue()
        self._listeners: list[Listener] = []
        self._source = Reopening(f'force/torque {name}', self._connected, self._receive, self._lost)
        self._connected_ns = 0
        self._expected_hz = 0.0

    @property
    def description(self) -> Mapping[str, str]:
        """As of the connection, with the number of losses."""
        connection, losses = self._source.connection, self._source.losses
        own = {'source': self._settings.source, 'axes': ' '.join(self._axes), 'times lost': str(losses)}
        return {**(connection.description if connection else {}), **own}

    @property
    def health(self) -> Health:
        """ERROR while it is lost, silent, or reports a fault."""
        connection, newest = self._source.connection, self._queue.newest
        if not self._source.is_open:
            return Health(Level.STALE, f'{self.name} is not open')
        if (failure := self._queue.failure) is not None:
            return Health(Level.ERROR, f'{failure}; reopening it')
        if connection is None or newest is None:
            return Health(Level.ERROR, f'{self.name} has not sent a sample yet')
        return self._health(connection, newest)

    @property
    def axes(self) -> tuple[str, ...]:
        return self._axes

    @property
    def rate_hz(self) -> float:
        connection = self._source.connection
        return connection.rate_hz if connection and not self._source.is_lost else 0.0

    @property
    def expected_hz(self) -> float:
        """As announced, else as observed at the first sample."""
        return self._expected_hz

    def open(self) -> None:
        """Connect, and wait for the first sample with a known time."""
        self._queue = self._new_queue()
        for listener in self._listeners:
            self._queue.listen(listener)
        self._source.open()
        if not self._queue.wait(FIRST_SAMPLE_S):
            failure = self._queue.failure
            self.close()
            raise DeviceTimeoutError(str(failure) if failure else self._silent(FIRST_SAMPLE_S))
        connection = self._source.connection
        self._expected_hz = (connection.announced_hz or connection.rate_hz) if connection else 0.0

    def read(self, timeout_s: float) -> Sequence[Sample]:
        if not self._source.is_open:
            raise closed(self.name)
        return self._queue.take(timeout_s)

    def newest(self) -> Sample | None:
        return self._queue.newest

    def listen(self, listener: Listener) -> None:
        self._listeners.append(listener)
        self._queue.listen(listener)

    def close(self) -> None:
        if self._source.is_open:
            self._queue.close()
            self._source.close(JOIN_S)

    def _health(self, connection: Connection, newest: Sample) -> Health:
        now_ns, limit_ms = self._clock.now_ns(), permitted_ms(self._settings.silence_ms, self._expected_hz)
        if newest.flags & UNUSABLE and now_ns - newest.arrival_ns <= limit_ms * NS_PER_MS:
            return Health(Level.ERROR, f'{self.name}: {describe_flags(newest.flags)} (status {newest.status:#x})')
        if wrong := too_old(newest, 0, now_ns, limit_ms):
            return Health(Level.ERROR, f'{self.name} {wrong}')
        counted = f'{connection.rate_hz:.0f} samples/s, {self._queue.dropped} lost'
        if newest.flags & (Flag.THRESHOLD | Flag.WARNING | Flag.UNTIMED) or connection.complaint:
            words = connection.complaint or f'{describe_flags(newest.flags)} (status {newest.status:#x})'
            return Health(Level.WARN, f'{counted}; {words}')
        return Health(Level.OK, counted)

    def _new_queue(self) -> SampleQueue:
        return SampleQueue(self.name, self._settings.queue, SampleCheck(self._axes, self._settings.same_values))

    def _connected(self) -> Connection:
        connection = self._connect()
        self._connected_ns = self._clock.now_ns()
        return connection

    def _receive(self, connection: Connection) -> bool:
        before, looked_ns = self._queue.newest, self._clock.now_ns()
        self._queue.rate_hz = connection.rate_hz or self._expected_hz
        connection.fetch(self._queue)
        self._watch(looked_ns)
        return self._queue.newest is not before

    def _lost(self, error: TactileError) -> None:
        self._queue.fail(DeviceLostError(f'{self.name} is lost: {error}') if self._source.is_lost else error)

    def _watch(self, now_ns: int) -> None:
        """Raise if there was silence for too long until `now_ns`; all that had come by then was read."""
        newest, rate_hz = self._queue.newest, self._expected_hz
        alive_ns = max(self._connected_ns, newest.arrival_ns if newest else 0)
        runs = rate_hz > 0 and alive_ns > self._connected_ns
        patience_s = max(self._settings.lost_s, 5 / rate_hz if runs else FIRST_SAMPLE_S)
        if (now_ns - alive_ns) / NS_PER_S > patience_s:
            raise DeviceLostError(self._silent((now_ns - alive_ns) / NS_PER_S))

    def _silent(self, silent_s: float) -> str:
        return (
            f'{self.name} has sent no sample for {silent_s:.1f} s; check its power and its cable, and that no other '
            'program uses it'
        )


def describe_flags(flags: int) -> str:
    """Flags as words: `Flag.SATURATED | Flag.NOT_A_NUMBER` is "saturated, not a number"."""
    return ', '.join(flag.name.lower().replace('_', ' ') for flag in Flag if flag & flags and flag.name) or 'well'
