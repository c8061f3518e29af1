"""The status word of an ATI Net F/T box, in words and as flags."""

from __future__ import annotations

from tactile_nodes.drivers.force_torque.contract import Flag

SUMMARY = 1 << 31
SATURATION = 1 << 17
LATCH = 1 << 16

BITS = {
    31: 'summary of the others',
    30: 'CPU or RAM error',
    29: 'digital board error',
    28: 'analog board error',
    27: 'serial link error',
    26: 'program memory error',
    25: 'halted by its configuration',
    24: 'settings error',
    23: 'configuration does not fit the calibration',
    22: 'network error',
    21: 'CAN error',
    20: 'RDT error',
    19: 'EtherNet/IP error',
    18: 'DeviceNet error',
    17: 'saturated, or A/D converter error',
    16: 'threshold passed (latched)',
    14: 'watchdog timeout',
    13: 'stack error',
    12: 'EEPROM error',
    11: 'flash memory error',
    10: 'watchdog of the analog board',
    9: 'excitation of the strain gauges too high',
    8: 'excitation of the strain gauges too low',
    7: 'analog ground out of range',
    6: 'supply voltage too high',
    5: 'supply voltage too low',
    4: 'no data on the serial link',
    3: 'reference voltage or power error',
    2: 'temperature error',
    1: 'HTTP error',
}


def named(status: int) -> str:
    """The bits in words: 0x80010000 is "threshold passed (latched)", 0 is "well"."""
    bits = [bit for bit in range(31, -1, -1) if status >> bit & 1 and (bit != 31 or status == SUMMARY)]
    return ', '.join(BITS.get(bit, f'unknown bit {bit}') for bit in bits) or 'well'


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
