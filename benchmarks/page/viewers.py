"""Programs as viewers of the page: they read and acknowledge every packet, or hang."""

from __future__ import annotations

import asyncio
import contextlib
import os
import shutil
import signal
import socket
import subprocess
import tempfile
from contextlib import ExitStack
from multiprocessing.connection import Connection
from multiprocessing.sharedctypes import Synchronized
from urllib.parse import urlsplit

from benchmarks.harness.workers import SPAWN, Worker
from tactile_nodes.errors import ConfigurationError

PATIENCE_S = 20.0
_HANDSHAKE = (
    'GET /live HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n'
    'Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n'
)


class Viewers:
    """A context with viewers of the page at `url`.

    Raises:
        ConfigurationError: they could not connect, or Chromium is not installed.
    """

    def __init__(self, url: str, watching: int, hanging: int = 0, browsers: int = 0) -> None:
        self._url = url
        self._watching, self._hanging, self._browsers = watching, hanging, browsers
        self._stack = ExitStack()
        self._packets: Synchronized[int] = SPAWN.Value('q', 0)

    def __enter__(self) -> Viewers:
        with ExitStack() as stack:
            for _ in range(self._hanging):
                stack.enter_context(_hang(self._url))
            for _ in range(self._browsers):
                _browse(self._url, stack)
            if self._watching:
                self._watch(stack)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def packets(self) -> int:
        """The number of packets that all of them have read so far."""
        return self._packets.value

    def _watch(self, stack: ExitStack) -> None:
        worker = Worker(_serve, self._url, self._watching, self._packets)
        stack.callback(worker.process.join)
        stack.callback(worker.process.terminate)
        worker.answer(PATIENCE_S)


def _serve(pipe: Connection, url: str, count: int, packets: Synchronized[int]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent process ends this one
    asyncio.run(_all(pipe, url, count, packets))


async def _all(pipe: Connection, url: str, count: int, packets: Synchronized[int]) -> None:
    from aiohttp import ClientSession

    origin = url.rstrip('/')
    async with ClientSession() as session, contextlib.AsyncExitStack() as stack:
        address = f'{origin.replace("http", "ws")}/live'
        channels = [await stack.enter_async_context(session.ws_connect(address, origin=origin)) for _ in range(count)]
        pipe.send('connected')
        await asyncio.gather(*(_take(channel, packets) for channel in channels))


async def _take(channel: object, packets: Synchronized[int]) -> None:
    from aiohttp import ClientWebSocketResponse, WSMsgType

    assert isinstance(channel, ClientWebSocketResponse)
    async for message in channel:
        if message.type == WSMsgType.BINARY:
            packets.value += 1
            await channel.send_str('drawn')


def _hang(url: str) -> socket.socket:
    """A viewer that has connected and never reads."""
    host = urlsplit(url).netloc
    name, _, port = host.rpartition(':')
    made = socket.create_connection((name, int(port)), timeout=PATIENCE_S)
    made.sendall(_HANDSHAKE.format(host=host).encode('ascii'))
    return made


def _browse(url: str, stack: ExitStack) -> None:
    """Open the page in a Chromium without a window."""
    program = shutil.which('chromium') or shutil.which('chromium-browser')
    if program is None:
        raise ConfigurationError(
            'there is no Chromium here; leave out --browser, or install it: apt-get install chromium'
        )
    folder = stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True))
    sandbox = [] if os.geteuid() else ['--no-sandbox']  # Chromium has none for root
    size = '--window-size=1280,720'
    command = [program, '--headless=new', *sandbox, size, f'--user-data-dir={folder}', '--remote-debugging-port=0', url]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
    stack.callback(process.wait)
    stack.callback(lambda: os.killpg(process.pid, signal.SIGKILL))
