"""The page's server.

``/`` and ``/static/…`` are the page. ``/live`` is the WebSocket through which it watches a sensor. Its buttons post to
``/control/<action>``. If there are several sensors, ``/`` shows all of them, ``?sensor=NAME`` selects one, and
``/sensors`` lists them. See `door` and `guard` for access, `packet` for the format, `viewers` for slow clients.
"""

from __future__ import annotations

import asyncio
import json
import socket
from collections.abc import Callable, Collection, Sequence
from dataclasses import asdict
from pathlib import Path

from aiohttp import WSCloseCode, WSMsgType, web

from tactile_nodes.clock import monotonic_s
from tactile_nodes.web import guard
from tactile_nodes.web.complaints import Complaints
from tactile_nodes.web.controls import Outcome
from tactile_nodes.web.door import Door
from tactile_nodes.web.guard import Guests
from tactile_nodes.web.packet import Packet
from tactile_nodes.web.serving import LONGEST_WORD, Serving
from tactile_nodes.web.viewers import Audience, Viewer

STATIC = Path(__file__).parent / 'static'
STATIC_FILES = {each.relative_to(STATIC).as_posix(): each for each in STATIC.rglob('*') if each.is_file()}
HEARTBEAT_S = 10.0
_FULL = b'Too many pages are open already. Close one.'
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

Act = Callable[[str, bool, str], Outcome]
"""Does an action by name, insisting or not, for a sensor; called in a thread that may wait."""

Changed = Callable[[], None]
"""Called in the server's thread when a viewer has come or gone."""


class PageServer:
    """Serves on `listening`, and closes it at the end; `names` are accepted host names besides addresses.

    Each of the `sensors` has its own audience of at most `viewers`; a single sensor needs no name. `left_out` are
    sentences on sensors that are not shown.
    """

    def __init__(
        self,
        listening: socket.socket,
        act: Act,
        changed: Changed,
        complain: Callable[[str], None],
        guests: Guests = Guests.NONE,
        names: Collection[str] = (),
        viewers: int = 16,
        sensors: Sequence[str] = ('',),
        left_out: Sequence[str] = (),
    ) -> None:
        self.door = Door(guests=guests is not Guests.NONE)
        self.complaints = Complaints(complain, monotonic_s)
        self._serving = Serving(listening, self.door, self.complaints, self._add_routes, names)
        self._act = act
        self._changed = changed
        self._guests_act = guests is Guests.ACT
        self._audiences = {sensor: Audience(viewers) for sensor in sensors}
        self._left_out = left_out
        self._news: dict[Viewer, asyncio.Event] = {}
        self._serving.start()

    # --- from other threads -------------------------------------------------------------------------------------

    @property
    def url(self) -> str:
        return self._serving.url

    @property
    def watching(self) -> int:
        """Number of active viewers; a page with all sensors counts once per sensor."""
        return sum(map(self.watching_of, self._audiences))

    def watching_of(self, sensor: str = '') -> int:
        return self._audiences[sensor].watching(monotonic_s())

    def has_room_for(self, sensor: str = '') -> bool:
        """Whether any viewer can receive a packet of a sensor now."""
        return self._audiences[sensor].has_room

    def show(self, packet: Packet, sensor: str = '') -> None:
        """Show it to all viewers; returns at once."""
        self._serving.post(self._offer, packet, sensor)

    def remember(self, samples: bytes, sensor: str = '') -> None:
        """Keep the samples of the force for new viewers, and for viewers that could not receive a packet."""
        self._serving.post(self._audiences[sensor].remember, samples)

    def close(self) -> None:
        self._serving.close()

    # --- in the server's thread ---------------------------------------------------------------------------------

    def _add_routes(self, application: web.Application) -> None:
        application.on_response_prepare.append(_add_headers)
        application.router.add_get('/', self._index)
        application.router.add_get('/sensors', self._sensors)
        application.router.add_get('/static/{name:.+}', self._static)
        application.router.add_get('/live', self._live)
        application.router.add_post('/control/{action}', self._control)

    def _check_page(self, request: web.Request) -> None:
        origin = request.headers.get('Origin')
        if not guard.is_own_page(origin, request.host):
            self.complaints.count(f'from {"no page" if origin is None else "a page of " + ascii(origin)}')
            raise web.HTTPForbidden(text='Only the page itself may watch or act here.')

    def _may_act(self, request: web.Request) -> bool:
        return self._guests_act or self.door.is_owner(request.transport)

    def _sensor_of(self, request: web.Request) -> str:
        sensor = request.query.get('sensor', next(iter(self._audiences)))
        if sensor not in self._audiences:
            raise web.HTTPNotFound(text='There is no sensor of that name here.')
        return sensor

    async def _static(self, request: web.Request) -> web.StreamResponse:
        file = STATIC_FILES.get(request.match_info['name'])
        if file is None:
            raise web.HTTPNotFound(text='There is no such file here.')
        return web.FileResponse(file)

    async def _index(self, request: web.Request) -> web.StreamResponse:
        self._sensor_of(request)
        shows_all = (len(self._audiences) > 1 or self._left_out) and 'sensor' not in request.query
        return web.FileResponse(STATIC / ('hand.html' if shows_all else 'index.html'))

    async def _sensors(self, _: web.Request) -> web.StreamResponse:
        return web.json_response({'names': list(self._audiences), 'left_out': list(self._left_out)})

    # --- watching -----------------------------------------------------------------------------------------------

    def _offer(self, packet: Packet, sensor: str) -> None:
        self._audiences[sensor].offer(packet)
        for event in self._news.values():
            event.set()

    async def _live(self, request: web.Request) -> web.StreamResponse:
        self._check_page(request)
        audience = self._audiences[self._sensor_of(request)]
        channel = web.WebSocketResponse(heartbeat=HEARTBEAT_S, compress=False, max_msg_size=LONGEST_WORD)
        may_act = self._may_act(request)
        await self._serving.open_channel(request, channel)
        if audience.is_full:  # a browser shows its page why a channel was closed, but not why none was opened
            self._serving.forget_channel(channel)
            await channel.close(code=WSCloseCode.TRY_AGAIN_LATER, message=_FULL)
            return channel
        viewer = audience.join(monotonic_s())
        self._news[viewer] = asyncio.Event()
        self._changed()
        sending = asyncio.create_task(self._send(channel, viewer, may_act))
        try:
            await self._hear(channel, viewer)
        finally:
            sending.cancel()
            audience.leave(viewer)
            del self._news[viewer]
            self._serving.forget_channel(channel)
            self._changed()
        return channel

    async def _send(self, channel: web.WebSocketResponse, viewer: Viewer, may_act: bool) -> None:
        try:
            await channel.send_str(json.dumps({'may_act': may_act}))
            while True:
                await self._news[viewer].wait()
                self._news[viewer].clear()
                while (message := viewer.take()) is not None:
                    await channel.send_bytes(message)
        except ConnectionError:  # the client has gone; `_hear` ends the connection
            return

    async def _hear(self, channel: web.WebSocketResponse, viewer: Viewer) -> None:
        """Any message of a page means that it has drawn a packet."""
        async for message in channel:
            if message.type in {WSMsgType.TEXT, WSMsgType.BINARY}:
                viewer.acknowledge(monotonic_s())
                self._news[viewer].set()

    # --- acting -------------------------------------------------------------------------------------------------

    async def _control(self, request: web.Request) -> web.StreamResponse:
        self._check_page(request)
        if not self._may_act(request):
            raise web.HTTPForbidden(text='You may watch, but only the user who started this may act.')
        insist = request.query.get('insist') == 'yes'
        sensor = self._sensor_of(request)
        outcome = await asyncio.to_thread(self._act, request.match_info['action'], insist, sensor)
        return web.json_response(asdict(outcome), status=200 if outcome.done else 409)


async def _add_headers(request: web.Request, response: web.StreamResponse) -> None:
    response.headers.update(_HEADERS)
    if response.status != web.HTTPMisdirectedRequest.status_code:  # else the host is unknown
        response.headers['Content-Security-Policy'] = _POLICY.format(host=request.host)
