"""A camera that looks at a world: MJPEG over HTTP on the loopback address, as from cheap network cameras.

An image is rendered when it is due and a client is connected. A client that comes too late for one gets the next.
"""

from __future__ import annotations

import dataclasses
import http.server
import random
import threading
from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.emulators.world import Edge, World
from tactile_nodes.simulation.scene import WorldScene

LOOPBACK = '127.0.0.1'
BOUNDARY = 'picture'
QUALITY = 95
LIGHT = (16, 16, 24, 24)  # x, y, width and height in pixels; outside the central square that the image is cropped to
BRIGHT = 220
EXPOSURE_S = 0.008
RECENT = 32


class CameraStream:
    """The server; ``silent`` holds images back, ``delay_s`` sends old ones.

    The next ``lose`` images are never sent. Of the others, the share ``loss_rate`` is not sent.

    Args:
        world: the world that the camera sees.
        clock: decides when images are due.
        fps: frames per second; a slow computer renders fewer.
        port: the TCP port; 0: any.
    """

    def __init__(self, world: World, clock: Clock, fps: float = 30.0, port: int = 0) -> None:
        self.silent = False
        self.delay_s = 0.0
        self.lose = 0
        self.loss_rate = 0.0
        self._chance = random.Random(1)  # noqa: S311  (loss, not secrets)
        self._clock = clock
        self._fps = fps
        self._quality = world.gel.jpeg_quality or QUALITY
        self._world = world
        self._scene = WorldScene(_Uncompressed(world))
        self._stop = threading.Event()
        self._server = _server(self, port)
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.05,), name='camera', daemon=True)

    @property
    def port(self) -> int:
        return int(self._server.server_address[1])

    def __enter__(self) -> CameraStream:
        self._thread.start()
        return self

    def __exit__(self, *args: object) -> None:
        self._stop.set()
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()

    def parts(self) -> Iterator[bytes]:
        """The parts of the stream for one client."""
        last_ns = 0
        while (found := self.next_picture(last_ns)) is not None:
            last_ns, data = found
            head = f'--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n'
            yield head.encode('ascii') + data + b'\r\n'

    def picture(self, time_ns: int) -> bytes:
        """The JPEG image at a time."""
        import cv2

        image = self._with_light(np.asarray(self._scene.render(time_ns)), time_ns)
        _, data = cv2.imencode('.jpg', image, [cv2.IMWRITE_JPEG_QUALITY, self._quality])
        return bytes(data)

    def _with_light(self, image: npt.NDArray[np.uint8], time_ns: int) -> npt.NDArray[np.uint8]:
        """The image with the light in its corner, which follows the world's line; it is invisible when off."""
        recent = self._world.line_edges()[-RECENT:]
        lit = light_brightness(recent, time_ns - round(EXPOSURE_S / 2 * NS_PER_S), EXPOSURE_S, dark=0.0, bright=1.0)
        if lit == 0:
            return image
        x, y, width, height = LIGHT
        shown = np.array(image, np.uint8)
        part = shown[y : y + height, x : x + width]
        part[...] = np.rint(part + lit * (BRIGHT - part.astype(np.float64))).astype(np.uint8)
        return shown

    def _is_lost(self) -> bool:
        if self.lose > 0:
            self.lose -= 1
            return True
        return self._chance.random() < self.loss_rate

    def next_picture(self, after_ns: int) -> tuple[int, bytes] | None:
        """Wait for the next image due after a time; None when the server stops."""
        period_ns = round(NS_PER_S / self._fps)
        due_ns = max(after_ns + period_ns, self._clock.now_ns())
        while not self._stop.is_set():
            left_s = (due_ns - self._clock.now_ns()) / NS_PER_S
            if left_s <= 0 and not self.silent:
                now_ns = self._clock.now_ns()
                if self._is_lost():
                    due_ns = now_ns + period_ns
                    continue
                return now_ns, self.picture(now_ns - round(self.delay_s * NS_PER_S))
            self._stop.wait(min(max(left_s, 0.001), 0.02))
        return None


class _Uncompressed:
    """The world with a gel whose images are not compressed, because the stream compresses them."""

    def __init__(self, world: World) -> None:
        self.gel, self.tables = dataclasses.replace(world.gel, jpeg_quality=0), world.tables
        self.press_at, self.presses_at, self.force_at = world.press_at, world.presses_at, world.force_at


def light_brightness(
    edges: Sequence[Edge], start_ns: int, exposure_s: float, dark: float = 20.0, bright: float = 220.0
) -> float:
    """Grey level of a light that follows the line, in a frame whose exposure starts at `start_ns`."""
    end_ns = start_ns + round(exposure_s * NS_PER_S)
    lit_ns, on, since_ns = 0, False, start_ns
    for edge in edges:
        if edge.stamp_ns >= end_ns:
            break
        if edge.stamp_ns > start_ns:
            lit_ns += on * (edge.stamp_ns - since_ns)
            since_ns = edge.stamp_ns
        on = edge.level
    lit_ns += on * (end_ns - since_ns)
    return dark + (bright - dark) * lit_ns / (end_ns - start_ns)


def _server(owner: CameraStream, port: int) -> http.server.ThreadingHTTPServer:
    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header('Content-Type', f'multipart/x-mixed-replace; boundary={BOUNDARY}')
            self.end_headers()
            try:
                for part in owner.parts():
                    self.wfile.write(part)
            except OSError:  # the client has disconnected
                self.close_connection = True

        def log_message(self, format: str, *args: object) -> None:
            """Log nothing."""

    return http.server.ThreadingHTTPServer((LOOPBACK, port), Handler)
