"""The server on a real socket: what it gives to whom. The client speaks the page's own protocol."""

from __future__ import annotations

import asyncio
import gc
import json
import os
import socket
import threading
from collections.abc import AsyncIterator, Coroutine, Iterator
from contextlib import asynccontextmanager
from typing import Any, TypeVar
from urllib.parse import urlsplit

import aiohttp
import pytest

from tactile_nodes.web import accounts
from tactile_nodes.web.controls import Outcome
from tactile_nodes.web.guard import Guests
from tactile_nodes.web.packet import Packet
from tactile_nodes.web.port import listen
from tactile_nodes.web.server import PageServer
from tactile_nodes.web.viewers import IN_FLIGHT

Found = TypeVar('Found')
PATIENCE_S = 10.0


class Served:
    """A running server, and what it was asked to do."""

    def __init__(self, guests: Guests = Guests.NONE) -> None:
        self.asked: list[tuple[str, bool]] = []
        self.complaints: list[str] = []
        self.slowly = threading.Semaphore(0)
        self.came_or_went = threading.Semaphore(0)
        self.server = PageServer(
            listen('127.0.0.1', 0), self._act, self.came_or_went.release, self.complaints.append, guests, viewers=2
        )
        self.url = self.server.url.rstrip('/')
        self.socket_url = self.url.replace('http', 'ws') + '/live'

    def _act(self, action: str, insist: bool, sensor: str) -> Outcome:
        self.asked.append((action, insist))
        if action == 'slow':
            self.slowly.acquire()
        return Outcome(action == 'good', f'{action}.', insistable=action != 'good')


@pytest.fixture
def served(request: pytest.FixtureRequest) -> Iterator[Served]:
    """With the guests of the test's parameter; else there are none."""
    made = Served(getattr(request, 'param', Guests.NONE))
    yield made
    made.server.close()
    assert not any('bug' in line for line in made.complaints)


@pytest.fixture
def of_another_account(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever connects is taken for a program of somebody else."""
    monkeypatch.setattr(accounts, 'owners', lambda: frozenset({os.getuid() + 1}))


def run(talk: Coroutine[Any, Any, Found]) -> Found:
    async def in_time() -> Found:
        return await asyncio.wait_for(talk, PATIENCE_S)

    return asyncio.run(in_time())


async def status_of(method: str, url: str, **headers: str) -> int:
    async with aiohttp.ClientSession() as session, session.request(method, url, headers=headers) as response:
        return response.status


async def page_of(served: Served, status: int = 200) -> str:
    async with aiohttp.ClientSession() as session, session.get(served.url + '/') as response:
        assert response.status == status
        return await response.text()


@asynccontextmanager
async def watching(served: Served) -> AsyncIterator[aiohttp.ClientWebSocketResponse]:
    async with aiohttp.ClientSession() as session, session.ws_connect(served.socket_url, origin=served.url) as channel:
        yield channel


async def may_act(served: Served) -> bool:
    async with watching(served) as channel:
        return bool(json.loads(await channel.receive_str())['may_act'])


def talk_raw(served: Served, *sent: bytes) -> bytes:
    """What the server answers to bytes until it closes the connection."""
    place = urlsplit(served.url)
    with socket.create_connection((place.hostname, place.port), timeout=PATIENCE_S) as made:
        for each in sent:
            made.sendall(each)
        return b''.join(iter(lambda: made.recv(65536), b''))


def test_the_page_and_all_that_it_names_are_served(served: Served) -> None:
    async def talk() -> None:
        async with aiohttp.ClientSession() as session:
            async with session.get(served.url + '/') as response:
                text = await response.text()
                assert response.status == 200
                assert "default-src 'none'" in response.headers['Content-Security-Policy']
            names = [part.split('"')[0] for part in text.split('="/')[1:]]
            assert len(names) >= 4
            for name in names:
                async with session.get(f'{served.url}/{name}') as response:
                    assert response.status == 200, name

    run(talk())


def test_nothing_of_the_page_comes_from_the_internet(served: Served) -> None:
    assert '//' not in run(page_of(served)).replace('http://www.w3.org', '')


def test_a_name_that_was_pointed_here_is_refused(served: Served) -> None:
    assert run(status_of('GET', served.url + '/', Host='evil.example')) == 421


def test_files_beside_the_page_are_out_of_reach(served: Served) -> None:
    assert run(status_of('GET', served.url + '/static/%2e%2e/server.py')) in {403, 404}
    assert run(status_of('GET', served.url + '/static/')) == 404


@pytest.mark.parametrize('origin', [None, 'http://evil.example', 'null'])
def test_another_page_cannot_watch(served: Served, origin: str | None) -> None:
    async def talk() -> int:
        async with aiohttp.ClientSession() as session:
            with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
                await session.ws_connect(served.socket_url, origin=origin)
            return refused.value.status

    assert run(talk()) == 403


def test_a_viewer_gets_what_is_shown_and_no_more_than_it_draws(served: Served) -> None:
    async def talk() -> list[bytes]:
        async with watching(served) as channel:
            await channel.receive_str()
            got = []
            for number in range(IN_FLIGHT):
                served.server.show(Packet(b'%d' % number))
                got.append(await channel.receive_bytes())
            assert not served.server.has_room_for()
            for number in range(IN_FLIGHT, 20):
                served.server.show(Packet(b'%d' % number))
            await channel.send_str('drawn')
            got.append(await channel.receive_bytes())
            return got

    assert run(talk()) == [*(b'%d' % number for number in range(IN_FLIGHT)), b'19']


def test_coming_and_going_is_reported(served: Served) -> None:
    async def talk() -> None:
        async with watching(served):
            assert await asyncio.to_thread(served.came_or_went.acquire, timeout=PATIENCE_S)
            assert served.server.watching == 1

    run(talk())
    assert served.came_or_went.acquire(timeout=PATIENCE_S)
    assert served.server.watching == 0


def test_one_page_too_many_is_told_so(served: Served) -> None:
    async def talk() -> tuple[aiohttp.WSMsgType, int, str]:
        async with watching(served) as one, watching(served) as two, watching(served) as three:
            await one.receive_str()
            await two.receive_str()
            told = await three.receive()
            return told.type, told.data, told.extra

    sentence = 'Too many pages are open already. Close one.'
    assert run(talk()) == (aiohttp.WSMsgType.CLOSE, aiohttp.WSCloseCode.TRY_AGAIN_LATER, sentence)


def test_an_action_must_come_from_a_page_of_ours(served: Served) -> None:
    url = served.url + '/control/good'
    assert run(status_of('POST', url)) == 403
    assert run(status_of('POST', url, Origin='http://evil.example')) == 403
    assert run(status_of('GET', url, Origin=served.url)) == 405
    assert served.asked == []
    assert run(status_of('POST', url, Origin=served.url)) == 200
    assert served.asked == [('good', False)]
    assert run(may_act(served))


def test_a_refusal_is_reported_with_its_sentence(served: Served) -> None:
    async def talk() -> tuple[int, Any]:
        async with (
            aiohttp.ClientSession(headers={'Origin': served.url}) as session,
            session.post(served.url + '/control/bad?insist=yes') as response,
        ):
            return response.status, await response.json()

    assert run(talk()) == (409, {'done': False, 'text': 'bad.', 'insistable': True})
    assert served.asked == [('bad', True)]


@pytest.mark.usefixtures('of_another_account')
class TestAnotherAccount:
    @pytest.mark.parametrize('served', [Guests.NONE], indirect=True)
    def test_neither_sees_nor_does_anything_and_is_reported_why(self, served: Served) -> None:
        assert f'for the user who started it (uid {os.getuid()})' in run(page_of(served, 403))
        for path in ('/static/page.css', '/live', '/control/good'):
            assert run(status_of('POST', served.url + path, Origin=served.url)) == 403
        assert served.asked == []
        assert served.server.door.refused == 4

    @pytest.mark.parametrize('served', [Guests.WATCH], indirect=True)
    def test_watches_where_guests_may_and_acts_not(self, served: Served) -> None:
        assert run(may_act(served)) is False
        assert run(status_of('POST', served.url + '/control/good', Origin=served.url)) == 403
        assert served.asked == []

    @pytest.mark.parametrize('served', [Guests.ACT], indirect=True)
    def test_acts_where_guests_may(self, served: Served) -> None:
        assert run(may_act(served)) is True
        assert run(status_of('POST', served.url + '/control/good', Origin=served.url)) == 200
        assert served.asked == [('good', False)]


def test_odd_bytes_in_headers_are_refused_as_other_words_are(served: Served) -> None:
    sent = (
        b'POST /control/good HTTP/1.1\r\nHost: [::1]\r\nX-Token: \xff\xfe\r\nOrigin: \xff\r\nConnection: close\r\n\r\n'
    )
    assert talk_raw(served, sent).startswith(b'HTTP/1.1 403')
    assert served.asked == []


def test_a_file_with_an_endless_name_is_not_there(served: Served) -> None:
    """Any page in the operator's browser can ask for it: of each a traceback would be logged."""
    host = urlsplit(served.url).netloc.encode()
    sent = b'GET /static/%s HTTP/1.1\r\nHost: %s\r\nConnection: close\r\n\r\n' % (300 * b'a', host)
    assert talk_raw(served, sent).startswith(b'HTTP/1.1 404')


def test_closing_ends_what_is_open(served: Served) -> None:
    async def talk() -> int | None:
        async with watching(served) as channel:
            await channel.receive_str()
            closing = asyncio.create_task(asyncio.to_thread(served.server.close))
            message = await channel.receive()
            await closing
            assert message.type in {aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSING, aiohttp.WSMsgType.CLOSED}
            return channel.close_code

    assert run(talk()) == 1001


def test_closing_cuts_off_who_does_not_read(served: Served) -> None:
    """More than the kernel takes is on its way to him; a connection that was left would be complained of here."""
    place = urlsplit(served.url)
    words = [
        'GET /live HTTP/1.1', f'Host: {place.netloc}', f'Origin: {served.url}', 'Connection: Upgrade',
        'Upgrade: websocket', 'Sec-WebSocket-Version: 13', 'Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==', '', '',
    ]  # fmt: skip
    with socket.create_connection((place.hostname, place.port), timeout=PATIENCE_S) as made:
        made.sendall('\r\n'.join(words).encode())
        assert made.recv(12) == b'HTTP/1.1 101'
        assert served.came_or_went.acquire(timeout=PATIENCE_S)
        served.server.show(Packet(bytes(64 << 20)))
        served.server.close()
    gc.collect()


def test_closing_does_not_wait_for_a_node_that_does_not_answer(served: Served) -> None:
    headers = {'Origin': served.url}

    async def talk() -> None:
        async with aiohttp.ClientSession(headers=headers) as session:
            asking = asyncio.create_task(session.post(served.url + '/control/slow').__aenter__())
            while not served.asked:
                await asyncio.sleep(0)
            await asyncio.to_thread(served.server.close)
            with pytest.raises(aiohttp.ClientError):
                await asking

    try:
        run(talk())
    finally:
        served.slowly.release()
