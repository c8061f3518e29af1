"""The page's server: HTTP and WebSockets in a thread of its own, so that no viewer can make a node wait.

``/`` and ``/static/…`` are the page, ``/live`` the WebSocket that it watches through, ``/control/<action>`` what its
buttons post to. See `guard` for who may, `packet` for what travels, `viewers` for what happens to slow ones.
"""

from __future__ import annotations

import asyncio
import json
import secrets
import socket
import threading
from collections.abc import Awaitable, Callable, Collection
from dataclasses import asdict
from pathlib import Path

from aiohttp import WSMsgType, web

from tactile_nodes.clock import monotonic_s
from tactile_nodes.web import guard, port
from tactile_nodes.web.controls import Outcome
from tactile_nodes.web.packet import Packet
from tactile_nodes.web.viewers import Audience, Viewer

STATIC = Path(__file__).parent / 'static'
HEARTBEAT_S = 10.0
LONGEST_WORD = 4096  # bytes of what a viewer may say at once
CLOSE_WITHIN_S = 0.5
TOKEN = 'X-Tactile-Token'  # noqa: S105 - the header's name
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; "
    "connect-src 'self' ws://{host}; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)  # some browsers do not take a WebSocket to the same host for 'self'
_HEADERS = {
    'X-Content-Type-Options': 'nosniff',
    'Referrer-Policy': 'no-referrer',
    'Cross-Origin-Resource-Policy': 'same-origin',
    'Cross-Origin-Opener-Policy': 'same-origin',
    'Cache-Control': 'no-cache',
}

Act = Callable[[str, bool], Outcome]
"""Does an action by name, insisting or not; called in a thread that may wait."""

Changed = Callable[[], None]
"""Told, in the server's thread, that somebody has come or gone."""

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class PageServer:
    """Serves on `listening`, which it closes in the end; `names` are hosts to be known by besides addresses."""

    def __init__(
        self, listening: socket.socket, act: Act, changed: Changed, names: Collection[str] = (), viewers: int = 16
    ) -> None:
        self.url = port.url(listening)
        self._listening = listening
        self._act = act
        self._changed = changed
        self._names = frozenset(names)
        self._audience = Audience(viewers)
        self._news: dict[Viewer, asyncio.Event] = {}
        self._sockets: set[web.WebSocketResponse] = set()
        self._token = secrets.token_urlsafe(16)
        self._loop = asyncio.new_event_loop()
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._run, name='page', daemon=True)

    # --- from other threads -------------------------------------------------------------------------------------

    def start(self) -> None:
        """Serve; returns when the page can be opened."""
        self._thread.start()
        self._ready.wait()

    @property
    def watching(self) -> int:
        """How many pages take what they are sent."""
        return self._audience.watching(monotonic_s())

    @property
    def has_room(self) -> bool:
        """Whether anybody could be sent a packet now."""
        return self._audience.has_room

    def show(self, packet: Packet) -> None:
        """Show it to all who watch; returns at once."""
        self._loop.call_soon_threadsafe(self._offer, packet)

    def close(self) -> None:
        """Serve no more."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join()
        self._listening.close()

    # --- the thread ---------------------------------------------------------------------------------------------

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            runner = self._loop.run_until_complete(self._begin())
        finally:
            self._ready.set()
        self._loop.run_forever()
        self._loop.run_until_complete(self._end(runner))
        self._loop.close()

    async def _begin(self) -> web.AppRunner:
        runner = web.AppRunner(self.application(), access_log=None, handle_signals=False, shutdown_timeout=0.1)
        await runner.setup()
        await web.SockSite(runner, self._listening).start()
        return runner

    async def _end(self, runner: web.AppRunner) -> None:
        closing = [asyncio.create_task(each.close(code=1001, message=b'the node ends')) for each in self._sockets]
        if closing:
            await asyncio.wait(closing, timeout=CLOSE_WITHIN_S)
        await runner.cleanup()

    def application(self) -> web.Application:
        """The routes; for tests, too."""
        made = web.Application(middlewares=[self._check_host], client_max_size=LONGEST_WORD)
        made.on_response_prepare.append(_add_headers)
        made.router.add_get('/', _index)
        made.router.add_static('/static', STATIC)
        made.router.add_get('/live', self._live)
        made.router.add_post('/control/{action}', self._control)
        return made

    @web.middleware
    async def _check_host(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        if not guard.is_known_host(request.host, self._names):
            raise web.HTTPMisdirectedRequest(text='This page is not served under that name.')
        return await handler(request)

    # --- watching -----------------------------------------------------------------------------------------------

    def _offer(self, packet: Packet) -> None:
        self._audience.offer(packet)
        for event in self._news.values():
            event.set()

    async def _live(self, request: web.Request) -> web.StreamResponse:
        if not guard.is_own_page(request.headers.get('Origin'), request.host):
            raise web.HTTPForbidden(text='Only the page itself may watch here.')
        if self._audience.is_full:
            raise web.HTTPServiceUnavailable(text='Too many pages watch already; close one.')
        channel = web.WebSocketResponse(heartbeat=HEARTBEAT_S, compress=False, max_msg_size=LONGEST_WORD)
        await channel.prepare(request)
        viewer = self._audience.join(monotonic_s())
        self._news[viewer] = asyncio.Event()
        self._sockets.add(channel)
        self._changed()
        sending = asyncio.create_task(self._send(channel, viewer))
        try:
            await self._hear(channel, viewer)
        finally:
            sending.cancel()
            self._audience.leave(viewer)
            del self._news[viewer]
            self._sockets.discard(channel)
            self._changed()
        return channel

    async def _send(self, channel: web.WebSocketResponse, viewer: Viewer) -> None:
        try:
            await channel.send_str(json.dumps({'token': self._token}))
            while True:
                await self._news[viewer].wait()
                self._news[viewer].clear()
                while (message := viewer.take()) is not None:
                    await channel.send_bytes(message)
        except ConnectionError:  # it has gone; whoever hears it ends this
            return

    async def _hear(self, channel: web.WebSocketResponse, viewer: Viewer) -> None:
        """Whatever a page says means that it has drawn a packet."""
        async for said in channel:
            if said.type in {WSMsgType.TEXT, WSMsgType.BINARY}:
                viewer.acknowledge(monotonic_s())
                self._news[viewer].set()

    # --- acting -------------------------------------------------------------------------------------------------

    async def _control(self, request: web.Request) -> web.StreamResponse:
        own = guard.is_own_page(request.headers.get('Origin'), request.host)
        if not (own and guard.is_right_token(request.headers.get(TOKEN), self._token)):
            raise web.HTTPForbidden(text='Only the page itself may act here.')
        insist = request.query.get('insist') == 'yes'
        outcome = await asyncio.to_thread(self._act, request.match_info['action'], insist)
        return web.json_response(asdict(outcome), status=200 if outcome.done else 409)


async def _index(_: web.Request) -> web.StreamResponse:
    return web.FileResponse(STATIC / 'index.html')


async def _add_headers(request: web.Request, response: web.StreamResponse) -> None:
    response.headers.update(_HEADERS)
    if response.status != web.HTTPMisdirectedRequest.status_code:  # else the host is none that we know
        response.headers['Content-Security-Policy'] = _POLICY.format(host=request.host)
