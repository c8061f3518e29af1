"""HTTP in a thread of its own, so that no viewer can block a node, with limits on everything that clients send."""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import Awaitable, Callable, Collection
from typing import Any

from aiohttp import web

from tactile_nodes.web import guard, port
from tactile_nodes.web.complaints import Complaints
from tactile_nodes.web.door import Door

HEADER_WITHIN_S = 10.0  # after connecting or the last response, against clients that send a header byte by byte
LONGEST_WORD = 4096  # bytes of a request body
CLOSE_WITHIN_S = 0.5

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class Serving:
    """Serves on `listening` to clients that `door` admits; closes it at the end.

    Args:
        routes: adds the routes to the application.
        names: accepted host names besides addresses.
    """

    def __init__(
        self,
        listening: socket.socket,
        door: Door,
        complaints: Complaints,
        routes: Callable[[web.Application], None],
        names: Collection[str] = (),
        header_within_s: float = HEADER_WITHIN_S,
    ) -> None:
        self.url = port.url(listening)
        self.door = door
        self.complaints = complaints
        self._listening = listening
        self._routes = routes
        self._names = frozenset(names)
        self._header_within_s = header_within_s
        self._channels: set[web.WebSocketResponse] = set()
        self._loop = asyncio.new_event_loop()
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._run, name='http', daemon=True)

    # --- from other threads -------------------------------------------------------------------------------------

    def start(self) -> None:
        """Start serving; returns when connections are accepted."""
        self._thread.start()
        self._ready.wait()

    def post(self, work: Callable[..., object], *arguments: Any) -> None:
        """Run `work` in the server's thread soon; no effect after the server has ended."""
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(work, *arguments)

    def close(self) -> None:
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join()
        self._listening.close()

    # --- the thread ---------------------------------------------------------------------------------------------

    async def open_channel(self, request: web.Request, channel: web.WebSocketResponse) -> None:
        """Register a WebSocket, which is closed properly when the server ends."""
        await channel.prepare(request)
        self._channels.add(channel)

    def forget_channel(self, channel: web.WebSocketResponse) -> None:
        self._channels.discard(channel)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.set_exception_handler(self.complaints.take)
        try:
            runner, listener = self._loop.run_until_complete(self._begin())
        finally:
            self._ready.set()
        self._loop.run_forever()
        self._loop.run_until_complete(self._end(runner, listener))
        self._loop.close()

    async def _begin(self) -> tuple[web.AppRunner, asyncio.Server]:
        application = web.Application(middlewares=[self._check_host], client_max_size=LONGEST_WORD)
        self._routes(application)
        runner = web.AppRunner(
            application, access_log=None, logger=self.complaints.logger, keepalive_timeout=self._header_within_s,
            lingering_time=1.0, handle_signals=False, shutdown_timeout=0.1,
        )  # fmt: skip
        await runner.setup()
        assert runner.server is not None
        return runner, await self._loop.create_server(self.door.opening_to(runner.server), sock=self._listening)

    async def _end(self, runner: web.AppRunner, listener: asyncio.Server) -> None:
        listener.close()
        closing = [asyncio.create_task(each.close(code=1001, message=b'the node ends')) for each in self._channels]
        if closing:
            await asyncio.wait(closing, timeout=CLOSE_WITHIN_S)
        await runner.cleanup()
        self.door.close()
        await asyncio.sleep(0)  # lets closed connections be removed

    @web.middleware
    async def _check_host(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        if not guard.is_known_host(request.headers.get('Host', ''), self._names):
            raise web.HTTPMisdirectedRequest(text='This server does not have that name.')
        return await handler(request)
