"""What a server makes of those who send no request, an endless one, or too many."""

from __future__ import annotations

import logging
import socket
from collections.abc import Callable, Iterator

import pytest
from aiohttp import web

from tactile_nodes.web import door, port
from tactile_nodes.web.complaints import SAY_EVERY_S, Complaints
from tactile_nodes.web.door import Door
from tactile_nodes.web.serving import Serving

PATIENCE_S = 10.0
GOOD = b'GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n'
LAST = GOOD.replace(b'\r\n\r\n', b'\r\nConnection: close\r\n\r\n')
MALFORMED = [
    b'GET / HTTP/9.9\r\n\r\n',
    b'GET / HTTP/1.1\r\nHost: a\r\nNo colon here\r\n\r\n',
    b'GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: minus\r\n\r\n',
    b'GET /' + b'a' * 20_000 + b' HTTP/1.1\r\n\r\n',
    b'GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: ' + b'a' * 20_000 + b'\r\n\r\n',
    b'\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03' + bytes(64) + b'\r\n\r\n',
    b'\xff\xfe\xfd \x80 \x81\r\n\r\n',
]
Serve = Callable[..., Serving]


class Clock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def complained() -> list[str]:
    return []


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def serve(complained: list[str], clock: Clock) -> Iterator[Serve]:
    """Start a server that answers `/` with a word and has a bug at `/bug`."""
    running: list[Serving] = []

    async def answer(_: web.Request) -> web.StreamResponse:
        return web.Response(text='well')

    async def bug(_: web.Request) -> web.StreamResponse:
        raise ZeroDivisionError('of the test')

    def routes(application: web.Application) -> None:
        application.router.add_get('/', answer)
        application.router.add_get('/bug', bug)

    def start(owners: frozenset[int] | None = None, **options: float) -> Serving:
        complaints = Complaints(complained.append, clock)
        made = Serving(port.listen('127.0.0.1', 0), Door(guests=False, owners=owners), complaints, routes, **options)
        made.start()
        running.append(made)
        return made

    yield start
    for each in running:
        each.close()


def connect(serving: Serving) -> socket.socket:
    return socket.create_connection(('127.0.0.1', int(serving.url.rstrip('/').rpartition(':')[2])), timeout=PATIENCE_S)


def until_closed(made: socket.socket) -> bytes:
    found = b''
    try:
        while more := made.recv(65536):
            found += more
    except ConnectionResetError:
        return found
    return found


def answer_to(serving: Serving, sent: bytes) -> bytes:
    with connect(serving) as made:
        made.sendall(sent)
        return until_closed(made)


@pytest.mark.parametrize('sent', MALFORMED, ids=lambda sent: ascii(sent[:24]))
def test_what_is_no_request_is_refused_counted_and_reported_in_one_line(
    serve: Serve, complained: list[str], capfd: pytest.CaptureFixture[str], sent: bytes
) -> None:
    serving = serve()
    assert answer_to(serving, sent).startswith(b'HTTP/1.0 400')
    assert serving.complaints.refused == 1
    (line,) = complained
    assert '\n' not in line
    assert len(line) < 250
    assert answer_to(serving, LAST).endswith(b'well')
    assert capfd.readouterr().err == ''


def test_of_many_malformed_requests_a_line_a_minute_tells_how_many(
    serve: Serve, complained: list[str], clock: Clock
) -> None:
    serving = serve()
    for _ in range(20):
        answer_to(serving, MALFORMED[1])
    assert len(complained) == 1
    assert complained[0].startswith("requests refused: 1, 1 in total; last: malformed, 'Invalid header")
    clock.now_s += SAY_EVERY_S
    answer_to(serving, MALFORMED[1])
    assert len(complained) == 2
    assert complained[1].startswith('requests refused: 20, 21 in total')


def test_a_bug_is_reported_once_with_its_traceback(
    serve: Serve, complained: list[str], capfd: pytest.CaptureFixture[str]
) -> None:
    serving = serve()
    for _ in range(3):
        assert answer_to(serving, GOOD.replace(b'/ ', b'/bug ')).startswith(b'HTTP/1.1 500')
    assert len(complained) == 1
    assert 'ZeroDivisionError: of the test' in complained[0]
    assert capfd.readouterr().err == ''


@pytest.mark.parametrize('begun', [b'', b'GET / HTTP/1.1\r\nHost: 127.', GOOD + b'GET / HT'])
def test_a_header_that_does_not_come_to_its_end_is_not_waited_for(serve: Serve, begun: bytes) -> None:
    serving = serve(header_within_s=0.05)
    with connect(serving) as made:
        made.sendall(begun)
        until_closed(made)  # or the test would end by its timeout


def test_more_connections_than_there_is_room_for_are_cut_off(serve: Serve, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(door, 'MOST_CONNECTIONS', 2)
    serving = serve()
    with connect(serving) as one, connect(serving) as two:
        for made in (one, two):
            made.sendall(GOOD)
            answer = b''
            while not answer.endswith(b'well'):  # it may come in parts
                answer += (more := made.recv(65536))
                assert more
        assert answer_to(serving, LAST) == b''
        assert serving.door.refused == 1


def test_who_may_not_come_in_gets_no_place(serve: Serve, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(door, 'MOST_TURNED_AWAY', 2)
    serving = serve(owners=frozenset())
    with connect(serving), connect(serving), connect(serving) as third:
        assert until_closed(third) == b''
    assert serving.door.refused == 3


def test_who_may_not_come_in_and_says_nothing_is_cut_off(serve: Serve, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(door, 'TURNED_AWAY_WITHIN_S', 0.05)
    with connect(serve(owners=frozenset())) as made:
        assert until_closed(made) == b''


def test_complaints_of_aiohttp_do_not_reach_the_loggers_of_others(complained: list[str], clock: Clock) -> None:
    complaints = Complaints(complained.append, clock)
    assert complaints.logger.parent is None
    assert complaints.logger not in logging.Logger.manager.loggerDict.values()
