"""The inside of an emulated ATI Net F/T box: requests in, datagrams out, as a function of time; no socket, no thread.

`drivers.force_torque.net_ft_rdt` has the protocol. The box serves the client with the last request.
"""

from __future__ import annotations

import random
import struct
from dataclasses import dataclass

from tactile_nodes.emulators.clocks import DeviceClock
from tactile_nodes.emulators.force_torque.net_ft_config import INTERNAL_RATE_HZ, RANGES, NetFtConfig
from tactile_nodes.emulators.world import Wrench, WrenchSource

Client = tuple[str, int]
Counts = tuple[int, ...]

HEADER = 0x1234
STOP, START_REALTIME = 0x0000, 0x0002
SUMMARY, SATURATION = 0x8000_0000, 0x0002_0000
INT32_MAX = 2**31 - 1
MOST_AT_ONCE = 20_000  # records in one call, after the host's time has jumped


@dataclass
class NetFtFaults:
    """Faults of the box and its network; the numbers count down as they take effect."""

    silent: bool = False
    stalled: bool = False
    saturated: bool = False
    status: int = 0
    lose: int = 0
    duplicate: int = 0
    swap: int = 0
    malformed: int = 0
    loss_rate: float = 0.0


@dataclass
class _Stream:
    client: Client
    left: int | None
    next_count: int
    sequence: int = 0


class NetFtBox:
    """The state of a box.

    Args:
        world: the load on it, in its own axes.
        config: its settings.
        clock: its sample counter; 7000 Hz nominally, with offset and drift.
        noise: standard deviation of its readings in N (forces) and N·m (torques).
    """

    def __init__(
        self,
        world: WrenchSource,
        config: NetFtConfig | None = None,
        clock: DeviceClock | None = None,
        noise: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self.world = world
        self.config = config or NetFtConfig()
        self.clock = clock or DeviceClock(INTERNAL_RATE_HZ)
        self.faults = NetFtFaults()
        self.requests: list[tuple[int, int]] = []
        self._noise = noise
        self._random = random.Random(1)  # noqa: S311  (noise, not secrets)
        self._stream: _Stream | None = None
        self._stalled_at: int | None = None
        self._held: bytes | None = None

    @property
    def client(self) -> Client | None:
        """The client that it streams to now."""
        return self._stream.client if self._stream else None

    def request(self, data: bytes, client: Client, now_ns: int) -> None:
        """Execute the request in a datagram; other data and unknown commands are ignored."""
        if len(data) != 8:
            return
        header, command, count = struct.unpack('>HHI', data)
        if header != HEADER:
            return
        self.requests.append((command, count))
        if command == START_REALTIME and self.config.rdt_enabled:
            self._stream = _Stream(client, count or None, self.clock.count(now_ns) + 1)
        elif command == STOP:
            self._stream = None

    def due(self, now_ns: int) -> list[tuple[bytes, Client]]:
        """The datagrams that are due, in the order in which the network delivers them."""
        sent: list[tuple[bytes, Client]] = []
        for _ in range(MOST_AT_ONCE):
            stream = self._stream
            if stream is None or self.clock.time_ns(stream.next_count) > now_ns:
                break
            sent += [(datagram, stream.client) for datagram in self._step(stream)]
        return sent

    def next_ns(self) -> int | None:
        """When the next record is due; None: there is no stream."""
        return self.clock.time_ns(self._stream.next_count) if self._stream else None

    def status_at(self, counts: Counts) -> int:
        status = self.faults.status
        if self.faults.saturated or self._beyond(counts):
            status |= SATURATION
        return status | SUMMARY if status else 0

    def counts_at(self, count: int) -> Counts:
        wrench = self._noisy(self.world.wrench_at(self.clock.time_ns(count)))
        return tuple(
            _int32(round(value * scale)) for value, scale in zip(wrench, self.config.counts_per_si, strict=True)
        )

    def _step(self, stream: _Stream) -> list[bytes]:
        record = self._record(stream)
        stream.next_count += self.config.divider
        if stream.left is not None:
            stream.left -= 1
            if stream.left == 0:
                self._stream = None
        return self._through_network(record)

    def _record(self, stream: _Stream) -> bytes:
        count = self._sampled(stream.next_count)
        stream.sequence = (stream.sequence + 1) % (1 << 32)
        counts = self.counts_at(count)
        return struct.pack('>3I6i', stream.sequence, self.clock.reading(count), self.status_at(counts), *counts)

    def _sampled(self, count: int) -> int:
        """The internal sample that a record shows; while it is stalled, the last one before the stall."""
        if not self.faults.stalled:
            self._stalled_at = None
            return count
        if self._stalled_at is None:
            self._stalled_at = count - self.config.divider
        return self._stalled_at

    def _through_network(self, datagram: bytes) -> list[bytes]:
        faults = self.faults
        if faults.silent:
            return []
        if faults.lose > 0 or (faults.loss_rate > 0 and self._random.random() < faults.loss_rate):
            faults.lose = max(0, faults.lose - 1)
            return []
        if faults.malformed > 0:
            faults.malformed -= 1
            return [datagram[:-5]]
        if faults.duplicate > 0:
            faults.duplicate -= 1
            return [datagram, datagram]
        return self._in_order(datagram)

    def _in_order(self, datagram: bytes) -> list[bytes]:
        if self._held is not None:
            held, self._held = self._held, None
            return [datagram, held]
        if self.faults.swap > 0:
            self.faults.swap -= 1
            self._held = datagram
            return []
        return [datagram]

    def _noisy(self, wrench: Wrench) -> tuple[float, ...]:
        force, torque = self._noise
        if force == torque == 0.0:
            return wrench
        gauss = self._random.gauss
        return tuple(value + gauss(0.0, force if axis < 3 else torque) for axis, value in enumerate(wrench))

    def _beyond(self, counts: Counts) -> bool:
        limits = zip(counts, RANGES, self.config.counts_per_si, strict=True)
        return any(abs(value) >= limit * scale for value, limit, scale in limits)


def _int32(value: int) -> int:
    return max(-INT32_MAX - 1, min(INT32_MAX, value))
