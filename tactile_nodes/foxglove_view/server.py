"""A server for Foxglove and Lichtblick: channels with ROS 2 definitions, fed with the serialized messages.

Foxglove's own server does not check the origin of connections, and its open port would bypass our access control. So
this server implements their protocol itself. Clients can watch, but change nothing. Each viewer has a queue for each
topic, which drops the oldest message when it is full, and the topics take turns.
"""

from __future__ import annotations

import asyncio
import itertools
import secrets
import socket
from collections import Counter, deque
from collections.abc import Callable, Collection

from aiohttp import WSMsgType, web

from tactile_nodes.bus.topics import default_qos
from tactile_nodes.clock import monotonic_s
from tactile_nodes.errors import MessageError
from tactile_nodes.foxglove_view import protocol
from tactile_nodes.foxglove_view.protocol import Channel, Order
from tactile_nodes.paths import PACKAGE
from tactile_nodes.web.complaints import Complaints
from tactile_nodes.web.door import Door
from tactile_nodes.web.serving import Serving

FEWEST, QUEUE = 4, 32  # messages of a topic that wait for one viewer: as many as in the table, within these
MOST_VIEWERS = 16
HEARTBEAT_S = 10.0
LONGEST_ORDER = 1 << 20


class FoxgloveServer:
    """Serves on `listening`. Calls `on_interest`, in its own thread, with a topic that gains or loses a viewer.

    Args:
        origins: origins from which pages in a browser may connect.
        names: host names of this server, besides its addresses.
    """

    def __init__(
        self,
        listening: socket.socket,
        on_interest: Callable[[str], None],
        complain: Callable[[str], None],
        origins: Collection[str],
        names: Collection[str] = (),
        *,
        guests: bool = False,
    ) -> None:
        self.door = Door(guests=guests)
        self.complaints = Complaints(complain, monotonic_s)
        self.port = int(listening.getsockname()[1])
        self._serving = Serving(listening, self.door, self.complaints, self._add_routes, names)
        self._on_interest = on_interest
        self._origins = frozenset(origins)
        self._session = secrets.token_hex(8)
        self._numbers = itertools.count(1)
        self._channels: dict[str, Channel] = {}
        self._viewers: set[_Viewer] = set()
        self._watched: Counter[str] = Counter()
        self._serving.start()

    # --- from other threads -------------------------------------------------------------------------------------

    @property
    def address(self) -> str:
        return self._serving.url.replace('http', 'ws', 1).rstrip('/')

    def offer(self, topic: str, type_name: str) -> None:
        """Offer a topic to the viewers.

        Raises:
            MessageError: no such type.
        """
        self._serving.post(self._add, Channel.of(next(self._numbers), topic, type_name))

    def withdraw(self, topic: str) -> None:
        self._serving.post(self._remove, topic)

    def is_watched(self, topic: str) -> bool:
        return self._watched[topic] > 0

    def show(self, topic: str, data: bytes | memoryview, at_ns: int) -> None:
        """Send one message to all viewers of the topic; does not block."""
        self._serving.post(self._deliver, topic, data, at_ns)

    def close(self) -> None:
        self._serving.close()

    # --- in the server's thread ---------------------------------------------------------------------------------

    def _add_routes(self, application: web.Application) -> None:
        application.router.add_get('/', self._welcome)

    def _add(self, channel: Channel) -> None:
        self._channels[channel.topic] = channel
        self._tell(protocol.advertisement([channel]))

    def _remove(self, topic: str) -> None:
        channel = self._channels.pop(topic)
        self._watched.pop(topic, None)
        for viewer in self._viewers:
            viewer.subscriptions.pop(channel, None)
        self._tell(protocol.withdrawal(channel))

    def _tell(self, text: str) -> None:
        for viewer in self._viewers:
            viewer.tell(text)

    def _deliver(self, topic: str, data: bytes | memoryview, at_ns: int) -> None:
        channel = self._channels.get(topic)
        for viewer in self._viewers:
            if channel is not None and (subscription := viewer.subscriptions.get(channel)) is not None:
                viewer.show(topic, protocol.message(subscription, at_ns, data))

    async def _welcome(self, request: web.Request) -> web.StreamResponse:
        self._check(request)
        channel = web.WebSocketResponse(
            protocols=protocol.SUBPROTOCOLS, heartbeat=HEARTBEAT_S, compress=False, max_msg_size=LONGEST_ORDER
        )
        viewer = _Viewer()
        self._viewers.add(viewer)  # before the first await, so that the limit holds
        try:
            await self._serving.open_channel(request, channel)
            viewer.tell(protocol.greeting(PACKAGE, self._session))
            viewer.tell(protocol.advertisement(self._channels.values()))
            await self._attend(channel, viewer)
        finally:
            self._serving.forget_channel(channel)
            self._viewers.remove(viewer)
            self._forget(viewer, list(viewer.subscriptions))
        return channel

    def _check(self, request: web.Request) -> None:
        """Raises the HTTP error to answer with if the request is not allowed or has the wrong protocol."""
        origin = request.headers.get('Origin')
        if origin is not None and origin not in self._origins:  # only browsers send it
            self.complaints.count(f'a page of {origin!a}, which is not in the parameter "origins"')
            raise web.HTTPForbidden(text='Pages from this origin may not connect; see the parameter "origins".')
        offered = {each.strip() for each in request.headers.get('Sec-WebSocket-Protocol', '').split(',')}
        if not offered & set(protocol.SUBPROTOCOLS):
            subprotocols = ' or '.join(protocol.SUBPROTOCOLS)
            raise web.HTTPBadRequest(text=f'This is for Foxglove and Lichtblick, by WebSocket: {subprotocols}.')
        if len(self._viewers) >= MOST_VIEWERS:
            raise web.HTTPServiceUnavailable(text='Too many viewers are connected already; close one.')

    async def _attend(self, channel: web.WebSocketResponse, viewer: _Viewer) -> None:
        sending = asyncio.create_task(viewer.send_through(channel))
        try:
            async for message in channel:
                if message.type is WSMsgType.TEXT:
                    self._obey(viewer, message.data)
        finally:
            sending.cancel()

    def _obey(self, viewer: _Viewer, text: str) -> None:
        try:
            for order in protocol.orders(text):
                self._follow(viewer, order)
        except MessageError as error:
            self.complaints.count(str(error))
            viewer.complain(str(error))

    def _follow(self, viewer: _Viewer, order: Order) -> None:
        """Subscribe or unsubscribe a viewer; ignores channels that it has already or that were withdrawn."""
        if order.channel is None:
            self._forget(viewer, [each for each, given in viewer.subscriptions.items() if given == order.subscription])
        for channel in [each for each in self._channels.values() if each.number == order.channel]:
            if channel not in viewer.subscriptions:
                viewer.subscriptions[channel] = order.subscription
                self._change(channel, 1)

    def _forget(self, viewer: _Viewer, channels: Collection[Channel]) -> None:
        for channel in channels:
            del viewer.subscriptions[channel]
            self._change(channel, -1)

    def _change(self, channel: Channel, viewers: int) -> None:
        self._watched[channel.topic] += viewers
        self._on_interest(channel.topic)


class _Viewer:
    """The queues of one viewer: all texts, in order, and the newest messages of each topic."""

    def __init__(self) -> None:
        self.subscriptions: dict[Channel, int] = {}
        self._words: deque[str] = deque()
        self._messages: dict[str, deque[bytes]] = {}
        self._news = asyncio.Event()

    def tell(self, text: str) -> None:
        self._words.append(text)
        self._news.set()

    def complain(self, text: str) -> None:
        """Send it, unless the viewer does not read what it gets."""
        if len(self._words) < QUEUE:
            self.tell(protocol.complaint(text))

    def show(self, topic: str, data: bytes) -> None:
        """Send a message; if too many of its topic wait, in the place of the oldest of them."""
        most = max(FEWEST, min(QUEUE, default_qos(topic).depth))
        self._messages.setdefault(topic, deque(maxlen=most)).append(data)
        self._news.set()

    def _take(self) -> bytes:
        """The oldest message of the topic that has waited longest for its turn."""
        topic = next(iter(self._messages))
        waiting = self._messages.pop(topic)
        if len(waiting) > 1:
            self._messages[topic] = waiting  # behind all others
        return waiting.popleft()

    async def send_through(self, channel: web.WebSocketResponse) -> None:
        try:
            while True:
                await self._news.wait()
                self._news.clear()
                while self._words or self._messages:
                    if self._words:
                        await channel.send_str(self._words.popleft())
                    else:
                        await channel.send_bytes(self._take())
        except ConnectionError:  # it has gone; the receiving loop ends the connection
            return
