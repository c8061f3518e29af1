"""Whatever comes in: frames and files that are none of ours are counted and dropped, and nobody ends."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import zmq
from agents import IMAGE, NUMBER, connected, got, image, number_of, until
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tactile_nodes import messages
from tactile_nodes.bus import topics
from tactile_nodes.bus.node.node import Node
from tactile_nodes.bus.protocol import Endpoint, Participant, Qos, Received
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.zeromq import wire
from tactile_nodes.bus.zeromq.discovery import Meeting
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.bus.zeromq.records import Outlet, Record
from tactile_nodes.errors import MessageError
from tactile_nodes.messages import services, types

QUEUE = Qos('queue', 1000)
PATIENCE_MS = 30_000
RELAXED = settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
FRAMES = st.lists(st.binary(max_size=80), min_size=1, max_size=6)
Send = Callable[[list[bytes]], None]


class Forger:
    """A raw PUB socket that a forged record announces as a publisher, so that subscribers connect to it."""

    uid = 'f0f0f0f0'
    gid = 'f0f0f0f0.1'

    def __init__(self, folder: Path, topic: str, type_name: str) -> None:
        self.meeting = Meeting(self.uid, 7, folder)
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.XPUB)
        self._socket.set(zmq.LINGER, 0)
        address = self.meeting.socket_address(1)
        self._socket.bind(address)
        ends = (Endpoint(topic, type_name, '/forger'),)
        outlet = Outlet(self.gid, topic, type_name, address)
        participant = Participant(self.uid, 1, 'here', ('/forger',), ends)
        self.meeting.announce(Record(participant, (outlet,), self.meeting.socket_address(0)))
        self._key = wire.type_key(type_name)
        self._number = 0

    def __enter__(self) -> Forger:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()
        self._context.term()
        self.meeting.leave()

    def wait(self) -> Forger:
        """Until somebody has subscribed."""
        assert self._socket.poll(PATIENCE_MS)
        assert self._socket.recv() == b'\x01'
        return self

    def send(self, frames: list[bytes]) -> None:
        self._socket.send_multipart(frames)

    def send_payload(self, payload: bytes) -> None:
        """A message whose header is in order."""
        self._number += 1
        self.send([wire.pack_header(self.gid.encode(), self._key, self._number, 1), payload])


@pytest.fixture
def subscription(join: Callable[..., ZmqBus]) -> Subscription:
    return join().subscribe('/n', NUMBER, QUEUE)


@pytest.fixture
def forger(folder: Path, subscription: Subscription) -> Iterator[Forger]:
    with Forger(folder, '/n', NUMBER) as made:
        yield made.wait()


def _still_hears(subscription: Subscription, forger: Forger) -> None:
    forger.send_payload(messages.encode(types.Int64(data=42)))
    assert number_of(got(subscription)) == 42


def test_messages_of_another_version_of_their_type_are_told_of_once(
    forger: Forger, subscription: Subscription, capfd: pytest.CaptureFixture[str]
) -> None:
    """A controller in an environment of its own, with an older package, gets no forces."""
    for number in (1, 2):
        forger.send([wire.pack_header(Forger.gid.encode(), wire.type_key(IMAGE), number, 1), b''])
    _still_hears(subscription, forger)
    assert capfd.readouterr().err == '/n has another version of std_msgs/msg/Int64: update the older program\n'


@pytest.mark.parametrize(
    'frames',
    [
        pytest.param([b''], id='one empty frame'),
        pytest.param([b'hello'], id='one frame'),
        pytest.param([b'hello', b'world'], id='no header'),
        pytest.param([b'', b'', b''], id='three frames'),
        pytest.param([wire.pack_header(Forger.gid.encode(), wire.type_key(IMAGE), 1, 1), b''], id='another type'),
        pytest.param([wire.pack_header(b'abcdabcd.1', wire.type_key(NUMBER), 1, 1), b''], id='unknown publisher'),
        pytest.param(
            [wire.pack_header(Forger.gid.encode(), wire.type_key(NUMBER), 1, 1)[:-1], b''], id='a header cut short'
        ),
        pytest.param(
            [wire.pack_header(Forger.gid.encode(), wire.type_key(NUMBER), 1, 1)], id='a header without a message'
        ),
    ],
)
def test_foreign_frame_is_counted_and_dropped(forger: Forger, subscription: Subscription, frames: list[bytes]) -> None:
    forger.send(frames)
    until(lambda: subscription.malformed == 1)
    _still_hears(subscription, forger)
    assert (subscription.received, subscription.malformed) == (1, 1)


@RELAXED
@given(frames=FRAMES)
def test_no_frames_whatever_end_a_subscriber(forger: Forger, subscription: Subscription, frames: list[bytes]) -> None:
    forger.send(frames)
    _still_hears(subscription, forger)
    assert subscription.received == forger._number


@pytest.mark.parametrize('size', [0, 1, 3, 4, 11, 16, 4096])
def test_payload_that_is_no_message_is_a_message_error_for_who_looks_at_it(
    forger: Forger, subscription: Subscription, size: int
) -> None:
    forger.send_payload(b'\x00\x01\x00\x00'[:size] + bytes(max(0, size - 4)))
    received = got(subscription)
    with pytest.raises(MessageError):
        _ = received.message


class Looker(Node):
    NAME = 'looker'

    def __init__(self, bus: ZmqBus) -> None:
        super().__init__(bus)
        self.seen = 0
        self.input = self.create_subscription(topics.IMAGE, self._on_image)

    def _on_image(self, received: Received) -> None:
        self.seen += received.message.height == 440


@pytest.fixture
def looker(join: Callable[..., ZmqBus], spinning: Callable[[Node], Node]) -> Node:
    return spinning(Looker(join()))


@pytest.fixture
def photographer(folder: Path, looker: Looker) -> Iterator[Forger]:
    with Forger(folder, '/image_raw', IMAGE) as made:
        yield made.wait()


def test_truncated_images_are_counted_and_do_not_end_a_node(photographer: Forger, looker: Looker) -> None:
    whole = messages.encode(image(1))
    for size in (0, 2, 17, 1000, len(whole) // 2, len(whole) - 4):
        before = looker.input.malformed
        photographer.send_payload(whole[:size])
        until(lambda: looker.input.malformed == before + 1)  # noqa: B023
    seen = looker.seen
    until(lambda: photographer.send_payload(whole) or looker.seen > seen)


@RELAXED
@given(
    flips=st.lists(st.tuples(st.integers(0, 80), st.integers(1, 255)), min_size=1, max_size=8), cut=st.integers(0, 90)
)
def test_altered_messages_never_end_a_node(
    photographer: Forger, looker: Looker, flips: list[tuple[int, int]], cut: int
) -> None:
    data = bytearray(messages.encode(image(1)))
    for position, change in flips:
        data[position] ^= change
    handled = looker.input.received
    photographer.send_payload(bytes(data[: len(data) - cut]))
    until(lambda: looker.input.received > handled and not looker.input.waiting)
    assert looker.spinning


@pytest.fixture
def caller(join: Callable[..., ZmqBus]) -> Iterator[tuple[ZmqBus, Any]]:
    bus = join()
    bus.serve('/s', services.TRIGGER, lambda request, reply: reply(types.Trigger_Response(message='yes')))
    with zmq.Context() as context, context.socket(zmq.DEALER) as socket:
        socket.set(zmq.LINGER, 0)
        socket.connect(bus.server.address)
        yield bus, socket


def _still_answers(socket: Any) -> bytes:
    socket.send_multipart([wire.PING, b'the last'])
    while True:
        assert socket.poll(PATIENCE_MS)
        answer = socket.recv_multipart()
        if answer[1] == b'the last':
            return bytes(answer[2])


@RELAXED
@given(frames=FRAMES)
def test_no_frames_whatever_end_the_answering_of_calls(caller: tuple[ZmqBus, Any], frames: list[bytes]) -> None:
    _, socket = caller
    socket.send_multipart(frames)
    assert _still_answers(socket) == b'ok'


@RELAXED
@given(
    name=st.sampled_from([b'/s', b'/none', b'\xff']),
    kind=st.sampled_from([services.TRIGGER.encode(), b'a/srv/B', b'\xff', b'']),
    data=st.binary(max_size=40),
)
def test_no_call_whatever_ends_the_answering_of_calls(
    caller: tuple[ZmqBus, Any], name: bytes, kind: bytes, data: bytes
) -> None:
    _, socket = caller
    socket.send_multipart([wire.CALL, b'id', name, kind, data])
    assert _still_answers(socket) == b'ok'


def test_malformed_calls_are_counted(caller: tuple[ZmqBus, Any]) -> None:
    bus, socket = caller
    for frames in ([b'hello'], [wire.CALL, b'id', b'/s', services.TRIGGER.encode(), b'no request']):
        before = bus.malformed
        socket.send_multipart(frames)
        until(lambda: bus.malformed == before + 1)  # noqa: B023


def test_who_sends_no_request_is_answered_so(caller: tuple[ZmqBus, Any]) -> None:
    """As a client of another version does, whose service has other fields."""
    _, socket = caller
    socket.send_multipart([wire.CALL, b'id', b'/s', services.TRIGGER.encode(), b'no request'])
    assert socket.poll(PATIENCE_MS)
    kind, call_id, outcome, text = socket.recv_multipart()
    assert (kind, call_id, outcome) == (wire.ANSWER, b'id', b'error')
    assert text.startswith(b'10 bytes are not a std_srvs/srv/Trigger_Request')


def test_words_from_a_subscriber_do_not_make_a_publisher_believe_that_nobody_listens(
    join: Callable[..., ZmqBus],
) -> None:
    _, publisher, subscription = connected(join)
    with zmq.Context() as context, context.socket(zmq.XSUB) as socket:
        socket.set(zmq.LINGER, 0)
        socket.connect(publisher.address)  # type: ignore[attr-defined]
        for word in (b'\x01', b'hello', b'', b'\x00other', b'\x00'):
            socket.send(word)
        until(lambda: publisher.listeners == 1)
        until(lambda: publisher.publish(types.Int64(data=1)) or subscription.take())


def _valid_record(folder: Path, uid: str) -> str:
    return Record(Participant(uid, 1, 'here'), (), f'ipc://{folder}/d7/{uid}.0.sock').to_json()


@pytest.mark.parametrize(
    'lie',
    [
        '', '{', '[]', 'null', '"text"', '{"format": 99}', '[' * 100_000, '\x00\x01\x02',
        # Of a good one, this is replaced by that.
        ('"pid": 1', '"pid": "one"'),
        ('"nodes": []', '"nodes": [1]'),
        ('"nodes": []', '"nodes": 5'),
        ('"uid": "abcdabcd"', '"uid": "00000000"'),
        ('"publishers": []', '"publishers": [{"name": []}]'),
        ('abcdabcd.0.sock', '../../elsewhere.0.sock'),
        ('ipc://', 'tcp://'),
        ('"outlets": []', '"outlets": [{"gid": "a", "topic": "/n", "type_name": "t", "address": "tcp://1.2.3.4:5"}]'),
        ('"remotes": []', '"remotes": [7]'),
    ],
    ids=repr,
)  # fmt: skip
def test_record_that_is_none_or_lies_is_counted_and_passed_over(
    folder: Path, join: Callable[..., ZmqBus], lie: str | tuple[str, str]
) -> None:
    bus = join()
    liar = Meeting('abcdabcd', 7, folder)
    if isinstance(lie, tuple):
        valid = _valid_record(folder, 'abcdabcd')
        assert lie[0] in valid
        lie = valid.replace(*lie)
    (folder / 'd7' / 'abcdabcd.json').write_text(lie)
    until(lambda: bus.meeting.malformed)
    assert bus.peers() == []
    friend = join()
    until(lambda: [record.participant.uid for record in bus.peers()] == [friend.uid])
    liar.leave()


@RELAXED
@given(text=st.text(max_size=60))
def test_no_text_whatever_is_more_than_a_value_error(text: str) -> None:
    with pytest.raises(ValueError, match=r'.*'):
        Record.from_json(text, 'ipc:///x')


def test_garbage_among_the_files_is_left_alone_and_harms_nobody(folder: Path, join: Callable[..., ZmqBus]) -> None:
    bus = join()
    place = folder / 'd7'
    (place / '*.lock').touch()  # as a pattern, this would be everybody's files
    (place / 'README').write_text('not ours')
    (place / 'not a participant.lock').write_text('')
    (place / '12341234.lock').mkdir()
    os.mkfifo(place / '56785678.lock')  # opening it would wait for a writer for ever
    os.mkfifo(place / '56785678.json')
    friend = join()
    until(lambda: [record.participant.uid for record in bus.peers()] == [friend.uid])
    assert {'*.lock', 'README', 'not a participant.lock'} <= {file.name for file in place.iterdir()}
    assert (place / f'{bus.uid}.lock').exists()
