"""A camera on the network: MJPEG over HTTP on this machine, which can be unplugged and plugged in again."""

from __future__ import annotations

import http.server
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import cv2
import numpy as np

BOUNDARY = 'frame'
PERIOD_S = 0.02


class _Handler(http.server.BaseHTTPRequestHandler):
    server: _Server

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header('Content-Type', f'multipart/x-mixed-replace; boundary={BOUNDARY}')
        self.end_headers()
        head = f'--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(self.server.jpeg)}\r\n\r\n'
        part = head.encode() + self.server.jpeg + b'\r\n'
        try:
            while not self.server.unplugged.wait(PERIOD_S):
                self.wfile.write(part)
        except OSError:  # the reader has gone
            return

    def log_message(self, *_: object) -> None:
        """Nothing: the tests look elsewhere."""


class _Server(http.server.ThreadingHTTPServer):
    daemon_threads = True
    allow_reuse_address = True

    def __init__(self, port: int, image: np.ndarray) -> None:
        super().__init__(('127.0.0.1', port), _Handler)
        self.jpeg = cv2.imencode('.jpg', image)[1].tobytes()
        self.unplugged = threading.Event()


@contextmanager
def plugged_in(image: np.ndarray, port: int = 0) -> Iterator[str]:
    """The address of a stream of this image; at the end of the block it is cut off."""
    server = _Server(port, image)
    thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
    thread.start()
    try:
        yield f'http://127.0.0.1:{server.server_address[1]}/stream'
    finally:
        server.unplugged.set()
        server.shutdown()
        server.server_close()
        thread.join()
