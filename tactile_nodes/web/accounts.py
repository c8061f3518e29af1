"""Which user of this machine a TCP connection comes from, according to the kernel's table of sockets (proc(5)).

A user name, a password or an address can be forged; only the kernel knows who owns a socket.
"""

from __future__ import annotations

import ipaddress
import os
import struct
from collections.abc import Sequence
from pathlib import Path

TABLES = (Path('/proc/net/tcp'), Path('/proc/net/tcp6'))
_LOOKS = 3  # the table is not a snapshot: a read may miss a row while others change
_NO_INODE = '0'  # means that the program has closed the socket; it is then listed as root's
_ROW = 10  # columns that are read from a row

End = tuple[str, int]
"""Address and port of one end of a connection."""


def owners() -> frozenset[int]:
    """The users who own a program: the one who started it, and root."""
    return frozenset({os.getuid(), 0})


def account_of(peer: End, here: End, tables: Sequence[Path] = TABLES) -> int | None:
    """The uid of the program at `peer`, connected to `here`; None if it is not on this machine, or has ended."""
    wanted = {tuple(_written(end, wide) for end in (peer, here)) for wide in (False, True)} - {(None, None)}
    for _ in range(_LOOKS):
        for table in tables:
            if (found := _uid_in(table, wanted)) is not None:
                return found
    return None


def _uid_in(table: Path, wanted: set[tuple[str | None, ...]]) -> int | None:
    try:
        rows = table.read_text('ascii').splitlines()[1:]
    except FileNotFoundError:  # no IPv6, or not Linux: then no user is known
        return None
    for row in rows:
        columns = row.split(maxsplit=_ROW)
        if (columns[1], columns[2]) in wanted and columns[9] != _NO_INODE:
            return int(columns[7])
    return None


def _written(end: End, wide: bool) -> str | None:
    """An end in the format of the table (`wide`: that of IPv6); None if it has no such form.

    >>> _written(('127.0.0.1', 7470), wide=False)  # on a little-endian machine
    '0100007F:1D2E'
    """
    address = ipaddress.ip_address(end[0].partition('%')[0])
    if isinstance(address, ipaddress.IPv6Address):
        address = address.ipv4_mapped or address
    packed = address.packed
    if wide and len(packed) == 4:
        packed = ipaddress.IPv6Address(f'::ffff:{address}').packed
    if not wide and len(packed) == 16:
        return None
    words = struct.unpack(f'={len(packed) // 4}I', packed)
    return f'{"".join(f"{word:08X}" for word in words)}:{end[1]:04X}'
