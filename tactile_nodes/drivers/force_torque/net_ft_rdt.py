"""RDT, the streaming protocol of ATI Net F/T boxes: requests, records, and detection of missing records.

A request has eight bytes, a record 36, all numbers big-endian; the box does not acknowledge requests. `rdt_sequence`
counts the records of a stream from 1, `ft_sequence` the internal samples (7000 per second) since power-up.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import NamedTuple

from tactile_nodes.drivers.force_torque.contract import Flag

STOP, START_REALTIME = 0x0000, 0x0002
HEADER = 0x1234
REQUEST = struct.Struct('>HHI')
RECORD = struct.Struct('>3I6i')
SUMMARY, SATURATION, LATCH = 1 << 31, 1 << 17, 1 << 16  # bits of a record's status
U32 = 1 << 32
HALF = 1 << 31
YOUNG = 64  # a new stream has no higher numbers than this, losses included


class Record(NamedTuple):
    """One record as received."""

    rdt_sequence: int
    ft_sequence: int
    status: int
    counts: tuple[int, ...]


def flags_of(status: int) -> int:
    """A status word as `Flag`: the threshold latch alone is not a fault; saturation and every other bit are.

    0x80010000 gives THRESHOLD, 0x80020000 SATURATED | FAULT.
    """
    flags = Flag.THRESHOLD if status & LATCH else Flag(0)
    if status & SATURATION:
        flags |= Flag.SATURATED
    if status & ~(LATCH | SUMMARY) or status == SUMMARY:
        flags |= Flag.FAULT
    return int(flags)


def request(command: int, count: int = 0) -> bytes:
    """The bytes of a request; START_REALTIME with count 0, which is endless, is 12 34 00 02 00 00 00 00."""
    return REQUEST.pack(HEADER, command, count)


def record_in(datagram: bytes) -> Record | None:
    """The record in a datagram; None if it has another size."""
    if len(datagram) != RECORD.size:
        return None
    rdt, ft, status, *counts = RECORD.unpack(datagram)
    return Record(rdt, ft, status, tuple(counts))


@dataclass
class Counters:
    """Statistics of the records so far."""

    lost: int = 0
    duplicates: int = 0
    out_of_order: int = 0
    malformed: int = 0


class Accepted(NamedTuple):
    """A new record.

    Attributes:
        missing: records before it that have not arrived; if they still come, they are dropped.
        stalled: the internal counter stands still.
        rebooted: the internal counter has restarted.
    """

    missing: int
    stalled: bool = False
    rebooted: bool = False


class StreamTracker:
    """Tracks the sequence numbers through losses, duplicates, late records, renewals and restarts of the box."""

    def __init__(self) -> None:
        self.counters = Counters()
        self.step = 0
        self._step_seen = 0
        self._last: Record | None = None
        self._expecting = False

    @property
    def renewed(self) -> bool:
        """Whether the stream that was requested last has started."""
        return not self._expecting

    def requested(self) -> None:
        """Note that a start was requested: the numbers will start again at 1."""
        self._expecting = True

    def accept(self, record: Record) -> Accepted | None:
        """Properties of a record; None: it must be dropped, because it is a duplicate or too late."""
        last = self._last
        if last is None:
            return self._begin(record, Accepted(0))
        if _began_again(record, last) or (self._expecting and _begins(record, last)):
            return self._begin(record, self._after_renewal(record, last))
        ahead = (record.rdt_sequence - last.rdt_sequence) % U32
        if ahead == 0:
            self.counters.duplicates += 1
            return None
        if ahead >= HALF:
            self.counters.out_of_order += 1
            return None
        return self._follow(record, last, ahead)

    def _begin(self, record: Record, accepted: Accepted) -> Accepted:
        self._expecting = False
        return self._keep(record, accepted)

    def _follow(self, record: Record, last: Record, ahead: int) -> Accepted:
        ticks = (record.ft_sequence - last.ft_sequence) % U32
        if ahead == 1 and 0 < ticks < HALF:
            if self.step == 0 or ticks == self._step_seen:
                self.step = ticks
            self._step_seen = ticks
        rebooted = ticks >= HALF
        return self._keep(record, Accepted(ahead - 1, stalled=ticks == 0, rebooted=rebooted))

    def _keep(self, record: Record, accepted: Accepted) -> Accepted:
        self._last = record
        self.counters.lost += accepted.missing
        return accepted

    def _after_renewal(self, record: Record, last: Record) -> Accepted:
        """Across streams, only the internal counter shows what is missing."""
        ticks = (record.ft_sequence - last.ft_sequence) % U32
        if ticks >= HALF:
            return Accepted(record.rdt_sequence - 1, rebooted=True)
        missing = max(0, round(ticks / self.step) - 1) if self.step else record.rdt_sequence - 1
        return Accepted(missing, stalled=ticks == 0)


def _began_again(record: Record, last: Record) -> bool:
    """Whether a record has a smaller number but was measured later.

    This also happens with an unexpected stream: a delayed host sends a second request before it has read the response
    to the first, and the box starts again.
    """
    ahead = (record.rdt_sequence - last.rdt_sequence) % U32
    return ahead >= HALF and 0 < (record.ft_sequence - last.ft_sequence) % U32 < HALF


def _begins(record: Record, last: Record) -> bool:
    """Whether a record is of a new stream: numbered from 1 again, but not measured earlier than the last one.

    After a restart of the box it was measured earlier; then its number must be small, and the last one must not be.
    """
    if (record.rdt_sequence - last.rdt_sequence) % U32 < HALF and record.rdt_sequence != last.rdt_sequence:
        return record.rdt_sequence <= YOUNG and (record.ft_sequence - last.ft_sequence) % U32 >= HALF
    ticks = (record.ft_sequence - last.ft_sequence) % U32
    if ticks == 0:
        return record.rdt_sequence <= YOUNG < last.rdt_sequence
    return ticks < HALF or record.rdt_sequence <= YOUNG < last.rdt_sequence - YOUNG
