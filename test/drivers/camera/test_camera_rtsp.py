"""RTSP through FFmpeg, against a small server on this machine: RFC 2326 over TCP, pictures by RFC 2435."""

from __future__ import annotations

import contextlib
import itertools
import re
import socketserver
import struct
import threading
from collections.abc import Callable, Iterator

import pytest

from tactile_nodes.clock import SystemClock
from tactile_nodes.drivers.camera.contract import Camera, CameraSettings
from tactile_nodes.drivers.camera.opening import open_camera
from tactile_nodes.drivers.health import Level
from tactile_nodes.errors import DeviceError, DeviceNotFoundError, DeviceTimeoutError, ImageError

SDP = (
    'v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=gel\r\nc=IN IP4 127.0.0.1\r\nt=0 0\r\n'
    'm=video 0 RTP/AVP 26\r\na=control:track1\r\n'
)
JPEG_TYPE_420, TABLES_IN_BAND, RTP_JPEG = 1, 255, 26


def rtp(jpeg: bytes, number: int, width: int = 64, height: int = 48) -> bytes:
    """One picture as one interleaved RTP packet: the tables in the payload header, the scan after it."""
    tables = b''.join(table for table in re.findall(rb'\xff\xdb\x00\x43[\x00\x01](.{64})', jpeg, re.DOTALL))
    scan = jpeg[jpeg.index(b'\xff\xda') + 14 : -2]
    head = struct.pack('>BBHBBBB', 0, 0, 0, JPEG_TYPE_420, TABLES_IN_BAND, width // 8, height // 8)
    payload = head + struct.pack('>BBH', 0, 0, len(tables)) + tables + scan
    packet = struct.pack('>BBHII', 0x80, 0x80 | RTP_JPEG, number & 0xFFFF, number * 900, 7) + payload
    return b'$\0' + struct.pack('>H', len(packet)) + packet


class _Session(socketserver.StreamRequestHandler):
    def handle(self) -> None:
        with contextlib.suppress(ConnectionError, ValueError):
            method = ''
            while method != 'PLAY' and (line := self.rfile.readline()).strip():
                method = line.split()[0].decode()
                self._answer(method)

    def _answer(self, method: str) -> None:
        fields = dict(line.split(': ', 1) for line in iter(lambda: self.rfile.readline().decode().strip(), ''))
        more = {
            'OPTIONS': 'Public: OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN\r\n',
            'DESCRIBE': f'Content-Type: application/sdp\r\nContent-Length: {len(SDP)}\r\n',
            'SETUP': 'Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\nSession: 1\r\n',
        }.get(method, 'Session: 1\r\n')
        body = SDP if method == 'DESCRIBE' else ''
        status = '404 Not Found' if self.server.refuse and method == 'DESCRIBE' else '200 OK'
        self.wfile.write(f'RTSP/1.0 {status}\r\nCSeq: {fields["CSeq"]}\r\n{more}\r\n{body}'.encode())
        if method == 'PLAY':
            self._play()

    def _play(self) -> None:
        for number in range(self.server.count):
            self.wfile.write(rtp(self.server.jpeg_of(number), number))
            if self.server.over.wait(0.01):
                return
        if self.server.stall:
            self.server.over.wait(20)


class _Server(socketserver.ThreadingTCPServer):
    daemon_threads = True
    block_on_close = False
    allow_reuse_address = True


@pytest.fixture
def rtsp(jpeg_of: Callable[..., bytes]) -> Iterator[Callable[..., str]]:
    """Starts a server that sends so many pictures, and then hangs up or stalls; gives its address."""
    servers = []

    def start(count: int = 10_000, stall: bool = False, refuse: bool = False) -> str:
        server = _Server(('127.0.0.1', 0), _Session)
        server.count, server.stall, server.refuse = count, stall, refuse
        server.jpeg_of, server.over = jpeg_of, threading.Event()
        servers.append(server)
        threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
        return f'rtsp://127.0.0.1:{server.server_address[1]}/gel'

    yield start
    for server in servers:
        server.over.set()
        server.shutdown()
        server.server_close()


def opened(url: str, clock: SystemClock, **settings: object) -> Camera:
    return open_camera(CameraSettings(url, **settings), clock)


def until_lost(camera: Camera) -> str:
    """Why it was lost."""
    while (health := camera.health).level != Level.ERROR:
        with contextlib.suppress(DeviceTimeoutError):
            camera.read(0.05)
    camera.close()
    return health.message


def test_pictures_arrive_stamped_in_order_and_counted(rtsp: Callable[..., str], clock: SystemClock) -> None:
    camera = opened(rtsp(), clock)
    frames = [camera.read(20.0) for _ in range(5)]
    assert {frame.image.shape for frame in frames} == {(48, 64, 3)}
    for earlier, later in itertools.pairwise(frames):
        assert later.stamp_ns > earlier.stamp_ns
        assert later.sequence - earlier.sequence - 1 == later.dropped - earlier.dropped >= 0
    assert frames[-1].stamp_ns <= clock.now_ns()
    numbers = [(float(frame.image.mean()) - 22) / 10 for frame in frames]  # drawn into the pictures
    assert all(abs(number - round(number)) < 0.3 for number in numbers)
    assert camera.description['size'] == '64x48'
    camera.close()
    camera.close()
    with pytest.raises(DeviceError, match='closed'):
        camera.read(0.1)


def test_another_size_than_asked_for_is_refused(rtsp: Callable[..., str], clock: SystemClock) -> None:
    with pytest.raises(ImageError, match='64x48, but 640x480 was requested'):
        opened(rtsp(), clock, width=640, height=480)


def test_a_server_that_hangs_up_is_lost(rtsp: Callable[..., str], clock: SystemClock) -> None:
    """At once. On a busy machine half a second may pass before its end is read, which must not count as silence."""
    assert 'has ended its stream' in until_lost(opened(rtsp(count=60), clock, stall_s=3.0))


def test_a_server_that_stalls_is_first_late_and_then_lost(rtsp: Callable[..., str], clock: SystemClock) -> None:
    camera = opened(rtsp(count=60, stall=True), clock, stall_s=0.5)
    last = camera.read(20.0)
    with pytest.raises(DeviceTimeoutError):
        while True:
            last = camera.read(0.1)
    assert camera.health.level == Level.OK or clock.now_ns() - last.stamp_ns >= 0.5e9
    assert 'lost for' in until_lost(camera)


def test_a_path_that_the_server_does_not_know_is_reported(rtsp: Callable[..., str], clock: SystemClock) -> None:
    with pytest.raises(DeviceNotFoundError, match='responds, but sends no video; check the path, user and password'):
        opened(rtsp(refuse=True), clock)


def test_the_password_is_not_shown(clock: SystemClock) -> None:
    with pytest.raises(DeviceNotFoundError) as raised:
        opened('rtsp://me:secret@127.0.0.1:9/gel', clock)
    assert 'secret' not in str(raised.value)
