"""The status word of an ATI Net F/T box as flags."""

from __future__ import annotations

from tactile_nodes.drivers.force_torque.contract import Flag

SUMMARY = 1 << 31
SATURATION = 1 << 17
LATCH = 1 << 16


def flags_of(status: int) -> int:
    """As `Flag`: the threshold latch alone is no fault; saturation is one, and so is every other bit.

    0x80010000 gives THRESHOLD, 0x80020000 SATURATED | FAULT.
    """
    flags = Flag.THRESHOLD if status & LATCH else Flag(0)
    if status & SATURATION:
        flags |= Flag.SATURATED
    if status & ~(LATCH | SUMMARY) or status == SUMMARY:
        flags |= Flag.FAULT
    return int(flags)
