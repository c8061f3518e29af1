"""What Foxglove sees of this bus, and who else: a client that speaks its protocol (foxglove.sdk.v1)."""

from __future__ import annotations

import asyncio
import json
import os
import socket
import struct
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager
from typing import Any

import aiohttp
import numpy as np
import psutil
import pytest

from tactile_nodes import messages
from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.arguments import parse_arguments
from tactile_nodes.bus.node.node import Node
from tactile_nodes.errors import AddressInUseError, BusError
from tactile_nodes.foxglove_view.server import _Viewer
from tactile_nodes.messages import types
from tactile_nodes.nodes.foxglove_bridge import ORIGINS, FoxgloveBridgeNode
from tactile_nodes.web import accounts

Start = Callable[..., FoxgloveBridgeNode]
WAIT_S = 20.0


@pytest.fixture
def bus() -> Iterator[InProcessBus]:
    made = InProcessBus()
    yield made
    made.close()


@pytest.fixture
def bridge(bus: InProcessBus, spinning: Callable[[Node], Node]) -> Start:
    """Start a bridge in a thread."""

    def start(*parameters: str) -> FoxgloveBridgeNode:
        words = [word for each in ('port:=0', *parameters) for word in ('-p', each)]
        node = FoxgloveBridgeNode(bus, parse_arguments(['--ros-args', *words]))
        spinning(node)
        return node

    return start


class Viewer:
    """A client: what the server said, and messages of the channels that it watches."""

    def __init__(self, connection: aiohttp.ClientWebSocketResponse) -> None:
        self._connection = connection
        self.server: dict[str, Any] = {}
        self.statuses: list[dict[str, Any]] = []
        self.channels: dict[str, dict[str, Any]] = {}

    async def hear(self) -> tuple[int, int, bytes] | None:
        """One message of the server: (subscription, stamp, data) of a channel, or None."""
        came = await asyncio.wait_for(self._connection.receive(), WAIT_S)
        if came.type == aiohttp.WSMsgType.BINARY:
            kind, subscription, stamp_ns = struct.unpack_from('<BIQ', came.data)
            assert kind == 1
            return subscription, stamp_ns, came.data[13:]
        message = json.loads(came.data)
        if message['op'] == 'serverInfo':
            self.server = message
        elif message['op'] == 'status':
            self.statuses.append(message)
        elif message['op'] == 'advertise':
            self.channels |= {channel['topic']: channel for channel in message['channels']}
        return None

    async def say(self, text: str) -> None:
        await self._connection.send_str(text)

    async def status(self) -> dict[str, Any]:
        while not self.statuses:
            await self.hear()
        return self.statuses[0]

    async def see(self, *wanted: str) -> None:
        while not set(wanted) <= self.channels.keys():
            await self.hear()

    async def watch(self, topic: str) -> None:
        await self.see(topic)
        order = {'id': 7, 'channelId': self.channels[topic]['id']}
        await self._connection.send_json({'op': 'subscribe', 'subscriptions': [order]})

    async def message(self) -> tuple[int, bytes]:
        while (came := await self.hear()) is None:
            pass
        return came[1:]


@asynccontextmanager
async def viewer(
    node: FoxgloveBridgeNode, origin: str | None = None, protocol: str = 'foxglove.sdk.v1', **headers: str
) -> AsyncIterator[Viewer]:
    async with aiohttp.ClientSession(headers=headers) as session:
        address = f'http://127.0.0.1:{node.server.port}'
        async with session.ws_connect(address, protocols=[protocol], max_msg_size=0, origin=origin) as connection:
            yield Viewer(connection)


def status_for(node: FoxgloveBridgeNode, **asking: Any) -> int:
    """What the server says to somebody who would like to look; 101 where they may."""

    async def look() -> int:
        try:
            async with viewer(node, **asking) as found:
                await found.hear()
                return 101
        except aiohttp.WSServerHandshakeError as refused:
            return refused.status

    return asyncio.run(look())


def wrench(z: float) -> types.WrenchStamped:
    return types.WrenchStamped(wrench=types.Wrench(force=types.Vector3(z=z)))


def image(value: int) -> types.Image:
    return types.Image(height=440, width=440, encoding='mono8', step=440, data=np.full(193600, value, np.uint8))


def offer(bus: InProcessBus, topic: topics.Topic) -> Any:
    return bus.advertise('/skin/' + topic.name, topic.type_name, topic.qos, '/skin/someone')


async def first_of(pictures: Any, viewer: Viewer) -> None:
    """Publish until one arrives: nobody learns when a server has taken an order."""
    arriving = asyncio.ensure_future(viewer.message())
    while not arriving.done():
        pictures.publish(image(255))
        await asyncio.sleep(0.02)
    await arriving


async def until(holds: Callable[[], object]) -> None:
    for _ in range(1000):
        if holds():
            return
        await asyncio.sleep(0.02)
    raise AssertionError('it never came to that')


def test_each_topic_is_a_channel_with_the_definition_of_its_message(bridge: Start, bus: InProcessBus) -> None:
    offer(bus, topics.FORCE_DISTRIBUTION)
    node = bridge()

    async def look() -> Viewer:
        async with viewer(node) as found:
            await found.see('/skin/force_distribution', '/diagnostics', '/rosout')
            return found

    found = asyncio.run(look())
    channel = found.channels['/skin/force_distribution']
    assert (channel['encoding'], channel['schemaEncoding']) == ('cdr', 'ros2msg')
    assert channel['schemaName'] == 'tactile_nodes/msg/ForceDistribution'
    assert channel['schema'] == messages.definition('tactile_nodes/msg/ForceDistribution')
    assert found.server['capabilities'] == []  # nothing can be changed from there


def test_who_watches_gets_the_bytes_that_travelled_and_when_they_were_published(
    bridge: Start, bus: InProcessBus
) -> None:
    force = offer(bus, topics.WRENCH)
    subscription = bus.subscribe('/skin/wrench', topics.WRENCH.type_name, topics.WRENCH.qos)
    node = bridge()

    async def look() -> tuple[int, bytes]:
        async with viewer(node) as found:
            await found.watch('/skin/wrench')
            await until(lambda: force.listeners == 2)
            force.publish(wrench(-0.5))
            return await found.message()

    stamp_ns, data = asyncio.run(look())
    received = subscription.take()
    assert received is not None
    assert (stamp_ns, data) == (received.source_ns, received.data)
    assert messages.decode(data, topics.WRENCH.type_name).wrench.force.z == -0.5


def test_what_nobody_watches_is_not_received(bridge: Start, bus: InProcessBus) -> None:
    force, pictures = offer(bus, topics.WRENCH), offer(bus, topics.IMAGE)
    node = bridge()

    async def look() -> None:
        async with viewer(node) as found:
            await found.watch('/skin/wrench')
            await until(lambda: force.listeners)
            assert pictures.listeners == 0
        await until(lambda: not force.listeners)

    asyncio.run(look())


def test_what_is_latched_is_shown_to_the_second_viewer_too(bridge: Start, bus: InProcessBus) -> None:
    rest = offer(bus, topics.REFERENCE_IMAGE)
    rest.publish(image(3))
    node = bridge()

    async def look() -> list[bytes]:
        async with viewer(node) as first, viewer(node) as second:
            await first.watch('/skin/reference_image')
            one = await first.message()
            await second.watch('/skin/reference_image')
            return [one[1], (await second.message())[1]]

    assert asyncio.run(look()) == [messages.encode(image(3))] * 2


def test_a_topic_whose_publishers_have_gone_is_offered_no_more(bridge: Start, bus: InProcessBus) -> None:
    force = offer(bus, topics.WRENCH)
    node = bridge()

    async def look() -> dict[str, Any]:
        async with viewer(node) as found:
            await found.see('/skin/wrench')
        force.close()
        await until(lambda: node._showing.offered == 2)  # /rosout and /diagnostics of the bridge itself
        async with viewer(node) as found:
            await found.see('/rosout', '/diagnostics')
            return found.channels

    assert '/skin/wrench' not in asyncio.run(look())


def test_a_viewer_that_reads_nothing_keeps_nobody_waiting(bridge: Start, bus: InProcessBus) -> None:
    pictures = offer(bus, topics.IMAGE)
    node = bridge()

    async def look() -> bytes:
        async with viewer(node) as stuck, viewer(node) as quick:
            await stuck.watch('/skin/image_raw')
            await until(lambda: pictures.listeners)  # from now on `stuck` reads nothing
            await quick.watch('/skin/image_raw')
            await first_of(pictures, quick)
            for value in range(200):  # 39 MB, more than sockets and queues hold
                pictures.publish(image(value))
                await asyncio.sleep(0)
            data = b''
            while not data or data[-1] != 199:
                data = (await quick.message())[1]
            return data

    assert asyncio.run(look()) == messages.encode(image(199))


def test_pictures_take_no_place_of_another_topic_at_a_viewer_that_falls_behind(
    bridge: Start, bus: InProcessBus
) -> None:
    """What is latched is said once: a rest image, or where the gel is."""
    pictures, rest = offer(bus, topics.IMAGE), offer(bus, topics.REFERENCE_IMAGE)
    node = bridge()

    async def hear(viewer: Viewer, wanted: int) -> set[int]:
        seen: set[int] = set()
        while wanted not in seen:
            seen.add((await viewer.message())[1][-1])
        return seen

    async def show(quick: Viewer, last: int) -> None:
        for value in (*range(200), last):  # 39 MB, more than sockets and queues hold
            pictures.publish(image(value))
            await asyncio.sleep(0)
        await hear(quick, last)

    async def look() -> set[int]:
        async with viewer(node) as behind, viewer(node) as quick:
            await behind.watch('/skin/image_raw')
            await behind.watch('/skin/reference_image')
            await until(lambda: pictures.listeners and rest.listeners)  # from now on `behind` reads nothing
            await quick.watch('/skin/image_raw')
            await quick.watch('/skin/reference_image')
            await first_of(pictures, quick)
            await show(quick, 201)
            rest.publish(image(250))
            await hear(quick, 250)
            await show(quick, 202)
            return await hear(behind, 202)

    assert 250 in asyncio.run(look())


def test_a_slow_viewer_gets_some_of_every_topic() -> None:
    """Twenty topics, as of a sensor with its views, three frames between two messages that it takes."""
    slow, taken = _Viewer(), Counter[str]()
    for frame in range(180):
        for topic in range(20):
            slow.show(f'/topic_{topic}', f'/topic_{topic}'.encode())
        if frame % 30 == 0:
            slow.show('/diagnostics', b'/diagnostics')
        if frame % 3 == 0:
            taken[slow._take().decode()] += 1
    assert set(taken) == {f'/topic_{topic}' for topic in range(20)} | {'/diagnostics'}


def test_a_taken_port_gives_way_to_the_next(bridge: Start) -> None:
    with socket.create_server(('127.0.0.1', 0)) as taken:
        port = taken.getsockname()[1]
        assert port < bridge(f'port:={port}').server.port < port + 20


def test_an_address_of_another_machine_is_refused(bridge: Start) -> None:
    with pytest.raises(BusError, match=r'cannot serve Foxglove on 192\.0\.2\.77') as refused:
        bridge('address:=192.0.2.77')
    assert not isinstance(refused.value, AddressInUseError)


@pytest.mark.parametrize('origin', [None, *ORIGINS])
def test_programs_and_pages_of_foxglove_and_lichtblick_may_look(bridge: Start, origin: str | None) -> None:
    assert status_for(bridge(), origin=origin) == 101


@pytest.mark.parametrize(
    'origin',
    [
        'null',  # of any page that puts itself into a sandbox
        'https://evil.example',
        'http://app.foxglove.dev',
        'https://app.foxglove.dev.evil.example',
        'http://localhost:8081',
        'http://localhost',
        'file',
        '',
        'http://ev\x80il',
    ],
)
def test_another_page_in_the_browser_may_not_look(
    bridge: Start, capfd: pytest.CaptureFixture[str], origin: str
) -> None:
    node = bridge()
    assert status_for(node, origin=origin) == 403
    assert f'requests refused: 1, 1 in total; last: a page of {origin!a}' in capfd.readouterr().err


def test_origins_are_those_that_the_parameter_names(bridge: Start) -> None:
    node = bridge('origins:=["https://lab.example"]')
    assert status_for(node, origin='https://lab.example') == 101
    assert status_for(node, origin='https://app.foxglove.dev') == 403


def test_a_name_that_was_pointed_here_is_refused(bridge: Start) -> None:
    assert status_for(bridge(), Host='evil.example') == 421


@pytest.mark.parametrize(('guests', 'status'), [('none', 403), ('watch', 101)])
def test_another_account_may_look_only_as_a_guest(
    bridge: Start, monkeypatch: pytest.MonkeyPatch, guests: str, status: int
) -> None:
    monkeypatch.setattr(accounts, 'owners', lambda: frozenset({os.getuid() + 1}))
    assert status_for(bridge(f'guests:={guests}')) == status


def test_there_is_no_port_but_the_one_with_the_door(bridge: Start) -> None:
    before = listening_ports()
    port = bridge().server.port
    assert listening_ports() - before == {port}


def listening_ports() -> set[int]:
    return {each.laddr.port for each in psutil.Process().net_connections('tcp') if each.status == psutil.CONN_LISTEN}


def test_the_older_protocol_of_lichtblick_and_the_studio_is_spoken_too(bridge: Start, bus: InProcessBus) -> None:
    offer(bus, topics.WRENCH).publish(wrench(-0.5))
    assert status_for(bridge(), protocol='foxglove.websocket.v1') == 101


def test_another_protocol_is_refused(bridge: Start) -> None:
    assert status_for(bridge(), protocol='rosbridge_v2') == 400


@pytest.mark.parametrize(
    'order',
    [
        'no JSON',
        '[' * 100_000,
        '[]',
        '{"op": "advertise", "channels": []}',
        '{"op": "subscribe"}',
        '{"op": "subscribe", "subscriptions": [{"id": -1, "channelId": 1}]}',
        '{"op": "subscribe", "subscriptions": [{"id": 4294967296, "channelId": 1}]}',
        '{"op": "subscribe", "subscriptions": [{"id": 1, "channelId": "1"}]}',
        '{"op": "unsubscribe", "subscriptionIds": [true]}',
        '{"op": "setParameters", "parameters": []}',
    ],
    ids=lambda order: order[:60],
)
def test_what_is_no_order_is_answered_with_a_sentence_and_ends_nothing(
    bridge: Start, bus: InProcessBus, order: str
) -> None:
    force = offer(bus, topics.WRENCH)
    node = bridge()

    async def look() -> tuple[dict[str, Any], bytes]:
        async with viewer(node) as found:
            await found.see('/skin/wrench')
            await found.say(order)
            answer = await found.status()
            await found.watch('/skin/wrench')
            await until(lambda: force.listeners)
            force.publish(wrench(-0.5))
            return answer, (await found.message())[1]

    answer, data = asyncio.run(look())
    assert answer['level'] == 2  # an error
    assert data == messages.encode(wrench(-0.5))


def test_an_order_twice_and_one_of_a_channel_that_is_not_there_are_passed_over(
    bridge: Start, bus: InProcessBus
) -> None:
    force = offer(bus, topics.WRENCH)
    node = bridge()

    async def look() -> None:
        async with viewer(node) as found:
            await found.say('{"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 4000000000}]}')
            await found.watch('/skin/wrench')
            await found.watch('/skin/wrench')
            await until(lambda: force.listeners)
            await found.say('{"op": "unsubscribe", "subscriptionIds": [7, 7, 99]}')
            await until(lambda: not force.listeners)

    asyncio.run(look())
