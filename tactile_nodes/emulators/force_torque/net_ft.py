"""An ATI Net F/T box on this machine: RDT over UDP and its web pages over HTTP, while it is open.

    with NetFtServer(NetFtBox(world), clock) as server:
        ... # netft://127.0.0.1, with server.rdt_port and server.http_port

It listens only on the loopback address. Requests that change settings are refused and listed in `refused`, so that a
test can check that a driver does not change settings without permission.
"""

from __future__ import annotations

import contextlib
import http.server
import socket
import threading

from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.emulators.force_torque.net_ft_box import Client, NetFtBox
from tactile_nodes.emulators.force_torque.net_ft_config import xml

LOOPBACK = '127.0.0.1'
LONGEST_WAIT_S = 0.05  # between checks of the clock, which may be stepped
SHORTEST_WAIT_S = 0.0005


class NetFtServer:
    """A box with its two sockets; port 0: any free port."""

    def __init__(self, box: NetFtBox, clock: Clock, *, rdt_port: int = 0, http_port: int = 0) -> None:
        self.box = box
        self.refused: list[str] = []
        self._clock = clock
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._udp.bind((LOOPBACK, rdt_port))
            self._http = _http_server(self, http_port)
        except OSError:
            self._udp.close()
            raise
        self._threads = [
            threading.Thread(target=self._serve_rdt, name='Net F/T emulator RDT', daemon=True),
            threading.Thread(target=self._http.serve_forever, args=(0.05,), name='Net F/T emulator HTTP', daemon=True),
        ]

    @property
    def rdt_port(self) -> int:
        """UDP port of RDT; 49152 on a real box."""
        return int(self._udp.getsockname()[1])

    @property
    def http_port(self) -> int:
        """TCP port of the web pages; 80 on a real box."""
        return int(self._http.server_address[1])

    def __enter__(self) -> NetFtServer:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *args: object) -> None:
        self._stop.set()
        self._http.shutdown()
        for thread in self._threads:
            thread.join()
        self._http.server_close()
        self._udp.close()

    def page(self, target: str) -> tuple[int, bytes]:
        """HTTP status and body of a page."""
        with self._lock:
            if target == '/netftapi2.xml':
                return 200, self._xml()
            return self.change(target)

    def change(self, target: str) -> tuple[int, bytes]:
        """Response to a request that would change settings."""
        self.refused.append(target)
        return 403, b'this box is read-only'

    def _xml(self) -> bytes:
        box = self.box
        counts = box.counts_at(box.clock.count(self._clock.now_ns()))
        return xml(box.config, box.status_at(counts), counts)

    def _serve_rdt(self) -> None:
        while not self._stop.is_set():
            received = self._receive()
            with self._lock:
                now_ns = self._clock.now_ns()
                datagrams = self.box.due(now_ns)  # records due before the request go to the earlier client
                if received is not None:
                    self.box.request(*received, now_ns)
            for datagram, client in datagrams:
                with contextlib.suppress(OSError):  # the client may be gone; a box ignores that
                    self._udp.sendto(datagram, client)

    def _receive(self) -> tuple[bytes, Client] | None:
        self._udp.settimeout(self._wait_s())
        try:
            return self._udp.recvfrom(1500)
        except OSError:  # nothing came, or the last client's port is closed
            return None

    def _wait_s(self) -> float:
        next_ns = self.box.next_ns()
        if next_ns is None:
            return LONGEST_WAIT_S
        return min(LONGEST_WAIT_S / 10, max(SHORTEST_WAIT_S, (next_ns - self._clock.now_ns()) / NS_PER_S))


def _http_server(owner: NetFtServer, port: int) -> http.server.ThreadingHTTPServer:
    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            status, body = owner.page(self.path)
            kind = 'text/xml' if body.startswith(b'<?xml') else 'text/html'
            self.send_response(status)
            self.send_header('Content-Type', kind)
            self.send_header('Content-Length', str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *args: object) -> None:
            """Log nothing."""

    return http.server.ThreadingHTTPServer((LOOPBACK, port), Handler)
