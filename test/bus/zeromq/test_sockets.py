"""How much a socket takes in: what it can ever need, and no more."""

from __future__ import annotations

import ast
import contextlib
import socket
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zmq
from agents import IMAGE, NUMBER, connected, got, until

import tactile_nodes
from tactile_nodes.bus import topics
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.bus.zeromq import wire
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.bus.zeromq.sockets import Longest, longest_message
from tactile_nodes.errors import BusError, ServiceError
from tactile_nodes.messages import services, types

PACKAGE = Path(tactile_nodes.__file__).parent
PLACE = PACKAGE / 'bus/zeromq/sockets.py'
QUEUE = Qos('queue', 10)
LOG = topics.ROSOUT.type_name
Join = Callable[..., ZmqBus]


class Stranger:
    """Speaks ZMTP 3.0 by hand: a subscriber or caller of ZeroMQ's own would keep what it sends in a tree, too."""

    GREETING = b'\xff' + bytes(8) + b'\x7f\x03\x00' + b'NULL'.ljust(20, b'\0') + bytes(32)

    def __init__(self, kind: bytes, address: str) -> None:
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.settimeout(10.0)
        self._socket.connect(address.removeprefix('ipc://'))
        ready = b'\x05READY\x0bSocket-Type' + struct.pack('>I', len(kind)) + kind
        self._socket.sendall(self.GREETING + bytes([4, len(ready)]) + ready)

    def send(self, *frames: bytes) -> None:
        for number, frame in enumerate(frames, start=1):
            flags = 2 | (number < len(frames))  # long, and more to come
            with contextlib.suppress(ConnectionError):
                self._socket.sendall(struct.pack('>BQ', flags, len(frame)) + frame)

    def is_cut_off(self) -> bool:
        """Waits for it."""
        try:
            while self._socket.recv(65536):
                pass
        except ConnectionError:
            return True
        return True

    def close(self) -> None:
        self._socket.close()


@pytest.fixture
def stranger() -> Iterator[Callable[[bytes, str], Stranger]]:
    made: list[Stranger] = []

    def connect(kind: bytes, address: str) -> Stranger:
        made.append(Stranger(kind, address))
        return made[-1]

    yield connect
    for each in made:
        each.close()


def sockets_made_in(file: Path) -> Iterator[str]:
    """Where a file makes a socket of ZeroMQ; ``socket.socket`` is the standard library's."""
    text = file.read_text(encoding='utf-8')
    if 'ocket(' not in text:  # a call has it, and few files have calls
        return
    for node in ast.walk(ast.parse(text)):
        if (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Attribute)
            and node.func.attr in {'socket', 'Socket'}
        ):
            owner = node.func.value
            if not (isinstance(owner, ast.Name) and owner.id == 'socket'):
                yield f'{file.relative_to(PACKAGE)}:{node.lineno}'


def test_every_socket_is_made_where_it_gets_its_limit() -> None:
    found = [place for file in sorted(PACKAGE.rglob('*.py')) for place in sockets_made_in(file)]
    assert [place.partition(':')[0] for place in found] == [str(PLACE.relative_to(PACKAGE))]


@pytest.mark.parametrize(
    ('type_name', 'longest'),
    [
        (IMAGE, Longest.PICTURE),
        ('sensor_msgs/msg/CompressedImage', Longest.PICTURE),
        ('sensor_msgs/msg/PointCloud2', Longest.PICTURE),
        ('nav_msgs/msg/OccupancyGrid', Longest.PICTURE),
        (topics.FORCE_DISTRIBUTION.type_name, Longest.NUMBERS),
        (topics.FLOW_FEATURES.type_name, Longest.NUMBERS),
        (topics.DIAGNOSTICS.type_name, Longest.NUMBERS),
        (topics.WRENCH.type_name, Longest.TEXT),
        (topics.RIG_STATE.type_name, Longest.TEXT),
        (LOG, Longest.TEXT),
    ],
)
def test_a_message_may_be_as_long_as_what_it_can_hold(type_name: str, longest: Longest) -> None:
    assert longest_message(type_name) == longest


def test_every_socket_of_a_bus_has_its_limit(join: Join) -> None:
    bus = join()
    publisher = bus.advertise('/n', NUMBER, QUEUE)
    bus.subscribe('/n', NUMBER, QUEUE)
    until(lambda: bus._hub._receivers)
    made = {
        publisher._socket: Longest.WORD,
        bus.server._socket: Longest.CALL,
        bus._hub._receivers['/n', NUMBER].socket: Longest.TEXT,
    }
    assert [end.get(zmq.MAXMSGSIZE) for end in made] == list(made.values())


@pytest.mark.parametrize('length', [64, 20_000_000])
def test_who_subscribes_with_a_long_word_is_cut_off_and_the_others_go_on(
    join: Join, stranger: Callable[[bytes, str], Stranger], length: int
) -> None:
    _, publisher, subscription = connected(join)
    made = stranger(b'SUB', publisher.address)
    made.send(b'\x01' + bytes(length))
    assert made.is_cut_off()
    publisher.publish(types.Int64(data=7))
    assert got(subscription).message.data == 7


def test_who_subscribes_to_a_header_of_ours_is_served(join: Join) -> None:
    publisher = join().advertise('/n', NUMBER, QUEUE)
    prefix = wire.pack_header(publisher.gid.encode(), wire.type_key(NUMBER), 1, 1)[:28]  # all but number and time
    join().subscribe('/n', NUMBER, QUEUE)  # for somebody of ours, or nothing would be sent
    with zmq.Context() as context, context.socket(zmq.SUB) as made:
        made.set(zmq.LINGER, 0)
        made.connect(publisher.address)
        made.subscribe(prefix)
        until(lambda: publisher.publish(types.Int64(data=1)) or made.poll(10))
        assert made.recv().startswith(prefix)


def test_who_calls_with_too_much_is_cut_off(join: Join, stranger: Callable[[bytes, str], Stranger]) -> None:
    bus = join()
    made = stranger(b'DEALER', bus.server.address)
    made.send(wire.CALL, b'id', b'/s', services.TRIGGER.encode(), bytes(Longest.CALL + 1))
    assert made.is_cut_off()
    assert bus.malformed == 0


def test_a_picture_of_4k_in_colour_comes_through(join: Join) -> None:
    _, publisher, subscription = connected(join, '/big', IMAGE)
    width, height = 3840, 2160
    pixels = np.full(3 * width * height, 77, np.uint8)
    publisher.publish(types.Image(width=width, height=height, step=3 * width, encoding='rgb8', data=pixels))
    assert got(subscription).message.data.size == 24_883_200


def test_what_the_others_would_not_take_in_is_refused_with_a_sentence(join: Join) -> None:
    _, publisher, subscription = connected(join, '/say', LOG)
    with pytest.raises(BusError, match=r'/say: a rcl_interfaces/msg/Log of 10\d+ bytes .* limit is 1048576'):
        publisher.publish(types.Log(msg='a' * (1 << 20)))
    publisher.publish(types.Log(msg='short'))
    assert got(subscription).message.msg == 'short'


def test_an_answer_that_is_too_long_is_an_error_that_says_so(join: Join) -> None:
    def answer(_: Any, reply: Callable[[Any], None]) -> None:
        reply(types.Trigger_Response(message='a' * Longest.CALL))

    serving, calling = join(), join()
    serving.serve('/s', services.TRIGGER, answer)
    until(lambda: calling.graph().services())
    with pytest.raises(ServiceError, match='the limit of a call is 4194304'):
        calling.call('/s', services.TRIGGER, types.Trigger_Request())
