"""Restricts the sockets of DDS to this machine.

Cyclone DDS binds its receiving sockets to all addresses, whatever interface is configured, so a network could reach
them. A filter in the kernel lets such a socket receive only packets from the loopback interface. These are the packets
between processes of this machine, whatever address they are sent to. (Binding to the device `lo` does not work: for the
kernel, packets to the machine's own network address arrive by that network.) No privilege is needed.
"""

from __future__ import annotations

import ctypes
import os
import socket
import struct
from pathlib import Path

from tactile_nodes.errors import BusError

SO_ATTACH_FILTER = 26  # asm-generic/socket.h
_LOAD_WORD, _JUMP_IF_EQUAL, _RETURN = 0x20, 0x15, 0x06  # linux/bpf_common.h
_INTERFACE_INDEX = 0xFFFFF000 + 8  # SKF_AD_OFF + SKF_AD_IFINDEX, linux/filter.h: the interface that a packet came by
_WHOLE, _NOTHING = 0xFFFFFFFF, 0


def open_sockets() -> set[str]:
    """The sockets of this process, by their kernel names ('socket:[4711]')."""
    return {target for _, target in _descriptors()}


def confine(before: set[str]) -> int:
    """Restrict each datagram socket opened since `before` to this machine; returns their number.

    Raises:
        BusError: the kernel refuses.
    """
    found = 0
    for descriptor, target in _descriptors():
        if target not in before:
            with socket.socket(fileno=os.dup(descriptor)) as copy:
                if copy.type == socket.SOCK_DGRAM and copy.family in {socket.AF_INET, socket.AF_INET6}:
                    only_from(copy, 'lo')
                    found += 1
    return found


def only_from(end: socket.socket, interface: str) -> None:
    """Let `end` receive only packets that arrive by `interface`.

    Raises:
        BusError: the kernel refuses.
    """
    steps = (
        (_LOAD_WORD, 0, 0, _INTERFACE_INDEX),
        (_JUMP_IF_EQUAL, 0, 1, socket.if_nametoindex(interface)),
        (_RETURN, 0, 0, _WHOLE),
        (_RETURN, 0, 0, _NOTHING),
    )
    program = ctypes.create_string_buffer(b''.join(struct.pack('=HBBI', *step) for step in steps))
    try:
        end.setsockopt(socket.SOL_SOCKET, SO_ATTACH_FILTER, struct.pack('@HP', len(steps), ctypes.addressof(program)))
    except OSError as error:
        raise BusError(
            f'cannot keep DDS to this machine: {error.strerror}. Where a network may listen: discovery_range:=SUBNET'
        ) from error


def _descriptors() -> list[tuple[int, str]]:
    found = []
    for entry in Path('/proc/self/fd').iterdir():
        try:
            target = os.readlink(entry)  # noqa: PTH115 - no path, but a name of the kernel's
        except OSError:  # the file descriptor of this listing itself
            continue
        if target.startswith('socket:'):
            found.append((int(entry.name), target))
    return found
