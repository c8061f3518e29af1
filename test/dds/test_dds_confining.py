"""Nothing but this machine is heard."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tactile_nodes.dds.confining import SO_ATTACH_FILTER, confine, only_from, open_sockets


@contextmanager
def listening() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
        made.bind(('0.0.0.0', 0))
        made.setblocking(False)
        yield made


def steps(end: socket.socket) -> int:
    """Of the filter that a socket has; getsockopt(2) counts them instead of bytes."""
    return len(end.getsockopt(socket.SOL_SOCKET, SO_ATTACH_FILTER, 256))


def say(text: bytes, end: socket.socket) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as speaker:
        speaker.sendto(text, ('127.0.0.1', end.getsockname()[1]))


def test_what_comes_by_the_interface_is_heard_whole() -> None:
    with listening() as end:
        only_from(end, 'lo')
        say(b'from this machine', end)
        end.settimeout(30.0)
        assert end.recv(100) == b'from this machine'


def test_what_comes_by_another_interface_is_not_heard() -> None:
    others = [name for _, name in socket.if_nameindex() if name != 'lo']
    if not others:
        pytest.skip('this machine has one interface')
    with listening() as end:
        only_from(end, others[0])
        with listening() as all_heard:
            say(b'from this machine', end)
            say(b'and later', all_heard)
            all_heard.settimeout(30.0)
            assert all_heard.recv(100) == b'and later'
        with pytest.raises(BlockingIOError):
            end.recv(100)


def test_only_datagram_sockets_opened_since_are_confined() -> None:
    with listening() as older:
        before = open_sockets()
        with listening() as newer, socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM):
            assert confine(before) == 1
            assert (steps(older), steps(newer)) == (0, 4)


def test_every_socket_of_a_bridge_is_confined_unless_a_network_is_asked_for(bridge: Callable[..., object]) -> None:
    before = open_sockets()
    bridge()
    found = []
    for entry in Path('/proc/self/fd').iterdir():
        try:
            target = os.readlink(entry)  # noqa: PTH115
        except OSError:
            continue
        if target.startswith('socket:') and target not in before:
            with socket.socket(fileno=os.dup(int(entry.name))) as copy:
                if copy.family == socket.AF_INET:
                    found.append(steps(copy))
    assert len(found) >= 3  # one to receive discovery, one to receive data, one to send
    assert set(found) == {4}
