"""Sources of pictures for the camera tests: real files, real servers on this machine, and an emulated V4L2 device."""

from __future__ import annotations

import contextlib
import functools
import http.server
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

BOUNDARY = 'frame'
HELD = 30  # frames that a driver keeps for a reader that is late; V4L2 allows 32


def picture(number: int, width: int = 64, height: int = 48) -> np.ndarray:
    """A grey ramp whose mean level tells the frame's number, 10 levels a number."""
    image = np.full((height, width, 3), 20 + 10 * number, np.uint8)
    image[:, ::2] += 4
    return image


def jpeg(number: int, width: int = 64, height: int = 48) -> bytes:
    return _encoded(number % 20, width, height)


@functools.cache
def _encoded(number: int, width: int, height: int) -> bytes:
    return cv2.imencode('.jpg', picture(number, width, height))[1].tobytes()


@pytest.fixture
def image_of() -> Callable[..., np.ndarray]:
    return picture


@pytest.fixture
def jpeg_of() -> Callable[..., bytes]:
    return jpeg


@pytest.fixture
def video(tmp_path: Path) -> Path:
    """Eight frames of 64x48 at 50 frames a second."""
    path = tmp_path / 'video.avi'
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*'MJPG'), 50.0, (64, 48))
    for number in range(8):
        writer.write(picture(number))
    writer.release()
    return path


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Images 0.png … 11.png of 64x48, so that the order of the alphabet is not the order of the numbers."""
    path = tmp_path / 'images'
    path.mkdir()
    for number in range(12):
        cv2.imwrite(str(path / f'{number}.png'), picture(number))
    (path / 'notes.txt').write_text('not an image', encoding='ascii')
    return path


class Peer:
    """One client of the test server, as the script that answers it sees it."""

    def __init__(self, handler: http.server.BaseHTTPRequestHandler, over: threading.Event) -> None:
        self.path = handler.path
        self.headers = handler.headers
        self._handler = handler
        self.over = over

    def head(self, kind: str = f'multipart/x-mixed-replace; boundary={BOUNDARY}', status: int = 200) -> None:
        self._handler.send_response(status)
        self._handler.send_header('Content-Type', kind)
        self._handler.end_headers()

    def raw(self, data: bytes) -> None:
        self._handler.wfile.write(data)

    def part(self, body: bytes) -> None:
        head = f'--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(body)}\r\n\r\n'
        self.raw(head.encode() + body + b'\r\n')

    def stream(self, count: int = 10_000) -> None:
        for number in range(count):
            self.part(jpeg(number))
            if self.over.wait(0.01):
                return

    def wait_until_left(self) -> None:
        """Say nothing until the client has closed the line."""
        self._handler.connection.settimeout(20)
        with contextlib.suppress(OSError):
            while self._handler.connection.recv(1):
                pass

    def stall(self) -> None:
        """Keep the line open and say nothing."""
        self.over.wait(20)


@pytest.fixture
def serve() -> Iterator[Callable[[Callable[[Peer], None]], str]]:
    """Start an HTTP server whose answers a script writes; gives its address."""
    servers: list[tuple[http.server.ThreadingHTTPServer, threading.Event]] = []

    def start(script: Callable[[Peer], None]) -> str:
        over = threading.Event()

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                with contextlib.suppress(ConnectionError):
                    script(Peer(self, over))

            def log_message(self, *args: object) -> None:
                """Quiet."""

        server = http.server.ThreadingHTTPServer(('127.0.0.1', 0), Handler)
        servers.append((server, over))
        threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
        return f'http://127.0.0.1:{server.server_address[1]}/stream.mjpg'

    yield start
    for server, over in servers:
        over.set()
        server.shutdown()
        server.server_close()


@dataclass
class EmulatedDevice:
    """A V4L2 device as OpenCV shows it, with the behaviour that was seen on real ones.

    ``set`` returns True whatever it does; an unknown format becomes BGR3; the rate and the size snap to what there
    is; after an unplug ``grab`` fails at once while ``isOpened`` stays true; a stalled grab blocks. Frames are taken at
    the instants of the rate, and some are held for a reader that is late.

    Attributes:
        stamps_ms: the kernel's stamp of each frame.
        handed_ns: when each frame was handed over, on CLOCK_MONOTONIC.
        asked_ns: when its picture was asked for.
        blocked: whether a grab is blocked now.
    """

    node: Path
    sizes: tuple[tuple[int, int], ...] = ((640, 480), (320, 240))
    formats: tuple[str, ...] = ('YUYV', 'MJPG')
    rates: tuple[float, ...] = (100.0,)
    controls: dict[str, int] = field(default_factory=lambda: {'auto_exposure': 3, 'autogain': 1, 'gain': 29})
    stamp_offset_ms: float = -1.3
    slower: float = 1.0
    unreadable: bool = False  # OpenCV knows no way to make a picture of its format
    stalled: threading.Event = field(default_factory=threading.Event)
    blocked: bool = False
    spoil: Callable[[int, bytes], bytes] = lambda number, data: data
    grabbed: int = 0
    opened: int = 0
    released: int = 0
    calls: list[tuple[str, float]] = field(default_factory=list)
    stamps_ms: list[float] = field(default_factory=list)
    handed_ns: list[int] = field(default_factory=list)
    asked_ns: list[int] = field(default_factory=list)

    def plug(self) -> None:
        self.node.touch()

    def unplug(self) -> None:
        self.node.unlink()

    def wait_until_released(self) -> None:
        """As often as it was opened: whoever closes it does not wait long for a thread that is at work in it."""
        deadline_s = time.monotonic() + 30.0
        while self.released != self.opened:
            assert time.monotonic() < deadline_s
            time.sleep(0.01)

    def capture(self, path: str) -> EmulatedCapture:
        self.opened += 1
        return EmulatedCapture(self)

    def access(self, path: str) -> EmulatedControls:
        return EmulatedControls(self)


class EmulatedControls:
    def __init__(self, device: EmulatedDevice) -> None:
        self._device = device

    def get(self, name: str) -> int | None:
        return self._device.controls.get(name)

    def set(self, name: str, value: int) -> None:
        self._device.calls.append((name, value))
        if name in self._device.controls and not (name == 'gain' and self._device.controls.get('autogain')):
            self._device.controls[name] = value

    def close(self) -> None:
        """Nothing to close."""


class EmulatedCapture:
    def __init__(self, device: EmulatedDevice) -> None:
        self._device = device
        self._size = device.sizes[0]
        self._wish = list(self._size)
        self._format = device.formats[0]
        self._rate = device.rates[0]
        self._convert = 1.0
        self._number = -1
        self._stamp_ms = 0.0
        self._due_s = time.monotonic()

    def isOpened(self) -> bool:
        return True

    def set(self, prop: int, value: float, /) -> bool:
        device = self._device
        if prop == cv2.CAP_PROP_FOURCC:
            wanted = int(value).to_bytes(4, 'little').decode()
            self._format = wanted if wanted in device.formats else 'BGR3'
            self._size = device.sizes[0]
        elif prop in {cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT}:
            self._wish[prop == cv2.CAP_PROP_FRAME_HEIGHT] = int(value)
            self._size = tuple(self._wish) if tuple(self._wish) in device.sizes else self._size
        elif prop == cv2.CAP_PROP_FPS:
            self._rate = value if value in device.rates else device.rates[0]
        elif prop == cv2.CAP_PROP_CONVERT_RGB:
            self._convert = value
        device.calls.append((str(prop), value))
        return True

    def get(self, prop: int, /) -> float:
        return {
            cv2.CAP_PROP_FOURCC: float(int.from_bytes(self._format.encode(), 'little')),
            cv2.CAP_PROP_FPS: self._rate,
            cv2.CAP_PROP_CONVERT_RGB: self._convert,
            cv2.CAP_PROP_POS_MSEC: self._stamp_ms,
        }[prop]

    def grab(self) -> bool:
        device = self._device
        if not device.node.exists() or self._blocks():
            return False
        period_s, now_s = device.slower / self._rate, time.monotonic()
        self._due_s = max(self._due_s + period_s, now_s - HELD * period_s)
        time.sleep(max(0.0, self._due_s - now_s))
        self._number += 1
        device.grabbed += 1
        self._stamp_ms = self._due_s * 1000 + device.stamp_offset_ms
        device.stamps_ms.append(self._stamp_ms)
        device.handed_ns.append(time.monotonic_ns())
        return True

    def _blocks(self) -> bool:
        """Whether it stalled for the ten seconds after which OpenCV gives up."""
        device, deadline_s = self._device, time.monotonic() + 10.0
        while device.stalled.is_set() and time.monotonic() < deadline_s:
            device.blocked = True
            time.sleep(0.01)
        device.blocked = False
        return device.stalled.is_set()

    def retrieve(self) -> tuple[bool, Any]:
        self._device.asked_ns.append(time.monotonic_ns())
        width, height = self._size
        if self._device.unreadable:
            raise cv2.error('no conversion')
        if self._convert:
            return True, picture(self._number % 20, width, height)
        data = self._device.spoil(self._number, jpeg(self._number, width, height))
        return True, np.frombuffer(data, np.uint8)[np.newaxis]

    def release(self) -> None:
        self._device.released += 1


@pytest.fixture
def device(tmp_path: Path) -> EmulatedDevice:
    emulated = EmulatedDevice(tmp_path / 'video7')
    emulated.plug()
    return emulated
