"""Boxes that do in their own way what RDT leaves open: written anew, in as few lines as it takes."""

from __future__ import annotations

import contextlib
import http.server
import itertools
import socket
import statistics
import struct
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import pytest
from ft_rigs import LOST_S, assert_counted, read, working

from tactile_nodes.clock import SystemClock
from tactile_nodes.drivers.force_torque.contract import ForceTorqueSettings, NetFtSettings
from tactile_nodes.drivers.force_torque.net_ft_config import read_config
from tactile_nodes.drivers.force_torque.opening import open_force_torque
from tactile_nodes.drivers.health import Level
from tactile_nodes.errors import DeviceError

RATE_HZ = 250.0
PAGE = (
    '<?xml version="1.0"?>\n<netft xmlns="http://example.org/box"><runrate>%g</runrate><cfgcpf>2000</cfgcpf>'
    '<cfgcpt>4e4</cfgcpt><scfgfu>lbf</scfgfu><scfgtu>N-mm</scfgtu><comrdtrate>250</comrdtrate></netft>'
)


@dataclass
class Habits:
    """What it does in its own way.

    Attributes:
        other_port: it sends from another port than the one that it listens at.
        deaf_while_sending: a request to start that comes while it sends is ignored.
        step: internal samples from record to record, of which there are `internal_hz` a second.
        first: the number of the first record of a stream.
    """

    other_port: bool = False
    deaf_while_sending: bool = False
    step: int = 28
    internal_hz: float = 7000.0
    first: int = 1


class OtherBox:
    """A box in two threads."""

    def __init__(self, habits: Habits) -> None:
        self._habits = habits
        self._listening = _socket()
        self._sending = _socket() if habits.other_port else self._listening
        self._page = (PAGE % habits.internal_hz).encode()
        self._http = http.server.HTTPServer(('127.0.0.1', 0), self._pages())
        self._over = threading.Event()
        self._threads = [threading.Thread(target=self._run), threading.Thread(target=self._http.serve_forever)]
        self.requests: list[tuple[int, int]] = []
        self.starts = 0

    def __enter__(self) -> OtherBox:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._http.shutdown()
        for thread in self._threads:
            thread.join()
        self._http.server_close()
        self._listening.close()
        self._sending.close()

    @property
    def settings(self) -> NetFtSettings:
        rdt_port, http_port = self._listening.getsockname()[1], self._http.server_address[1]
        return NetFtSettings(rdt_port=rdt_port, http_port=http_port, renew_s=0.5)

    def _pages(self) -> type[http.server.BaseHTTPRequestHandler]:
        page = self._page

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                self.send_response(200)
                self.end_headers()
                self.wfile.write(page)

            def log_message(self, *args: object) -> None:
                """Quiet."""

        return Handler

    def _run(self) -> None:
        client, left, number, internal, due = None, 0, 0, 1000, time.monotonic()
        while not self._over.is_set():
            with contextlib.suppress(TimeoutError):
                data, sender = self._listening.recvfrom(64)
                _, command, count = struct.unpack('>HHI', data)
                self.requests.append((command, count))
                if command == 0:
                    left = 0
                elif not (left and self._habits.deaf_while_sending):
                    client, left, number = sender, count, self._habits.first
                    self.starts += 1
            while time.monotonic() >= due:
                due, internal = due + 1 / RATE_HZ, internal + self._habits.step
                if left and client is not None:
                    self._sending.sendto(struct.pack('>3I6i', number, internal, 0, 2000, 0, 0, 0, 0, 40_000), client)
                    left, number = left - 1, number + 1


def _socket() -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.bind(('127.0.0.1', 0))
    opened.settimeout(0.002)
    return opened


Start = Callable[[OtherBox], object]


@pytest.fixture
def start() -> Iterator[Start]:
    with contextlib.ExitStack() as stack:

        def opened(box: OtherBox, count_s: float = 60.0) -> object:
            ports = replace(box.settings, count_s=count_s)
            settings = ForceTorqueSettings('netft://127.0.0.1', net_ft=ports, same_values=0, lost_s=LOST_S)
            return stack.enter_context(contextlib.closing(open_force_torque(settings, SystemClock())))

        yield opened


def test_a_page_in_other_clothes_is_read(start: Start) -> None:
    """2000 counts are 1 lbf, 40 000 are 1 N·mm."""
    with OtherBox(Habits()) as box:
        sample = read(start(box), 5)[-1]
    assert sample.wrench == pytest.approx((4.4482216, 0, 0, 0, 0, 0.001))


def test_another_device_at_the_address_of_the_box_is_told_from_it() -> None:
    router = http.server.ThreadingHTTPServer(('127.0.0.1', 0), http.server.BaseHTTPRequestHandler)  # answers 501
    with router, contextlib.closing(router.socket):
        threading.Thread(target=router.handle_request, daemon=True).start()
        with pytest.raises(DeviceError, match=r'responded 501 .*perhaps another device, such as a router, has this'):
            read_config('127.0.0.1', router.server_address[1])


def test_a_box_that_answers_from_another_port_is_accepted(start: Start) -> None:
    with OtherBox(Habits(other_port=True)) as box:
        samples = read(start(box), 50)
    assert_counted(samples)
    assert samples[-1].dropped == 0


def test_what_a_stranger_sends_is_not_the_boxs(start: Start) -> None:
    """Of another address; a box is known by its own."""
    with OtherBox(Habits()) as box, contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as stranger:
        stranger.bind(('127.0.0.2', 0))
        sensor = start(box)
        port = sensor._source.connection._socket.getsockname()[1]
        for _ in range(5):
            stranger.sendto(struct.pack('>3I6i', 7, 7, 0, 9, 9, 9, 9, 9, 9), ('127.0.0.1', port))
        assert {sample.raw for sample in read(sensor, 30)} == {(2000, 0, 0, 0, 0, 40_000)}


def test_a_box_that_is_deaf_while_it_sends_is_asked_again_as_soon_as_it_has_ended(start: Start) -> None:
    """Its second of records ends twice; meanwhile it is asked every 0.1 s, and not once in a renewal of 0.5 s."""
    with OtherBox(Habits(deaf_while_sending=True)) as box:
        samples = read(start(box, count_s=1.0), round(2.2 * RATE_HZ))
        assert box.starts >= 3
        assert len(box.requests) - box.starts > 3
    assert_counted(samples)


def test_records_may_be_numbered_from_nought(start: Start) -> None:
    with OtherBox(Habits(first=0)) as box:
        samples = read(start(box), round(1.3 * RATE_HZ))
    assert samples[-1].dropped == 0


def test_the_internal_rate_is_the_boxs_own(start: Start) -> None:
    """32 internal samples of 8000 a second from record to record are 250 records a second.

    Most are 4 ms apart; some may come late, all at once, from a process that was made to wait.
    """
    with OtherBox(Habits(step=32, internal_hz=8000.0)) as box:
        sensor = start(box)
        samples = read(sensor, 300)
        assert sensor.rate_hz == 250.0
    steps = [(b.stamp_ns - a.stamp_ns) / (b.sequence - a.sequence) for a, b in itertools.pairwise(samples)]
    assert statistics.median(steps) == pytest.approx(1e9 / RATE_HZ, rel=0.01)


def test_a_counter_of_records_in_place_of_internal_samples_is_reported_and_arrival_counts(start: Start) -> None:
    """One a record, where 28 were announced: by that counter the sensor would be further behind every second.

    A machine that stands still for a moment looks alike at first, so it may take some time.
    """
    with OtherBox(Habits(step=1)) as box:
        sensor = start(box)
        batches = (read(sensor, 100) for _ in range(50))
        assert any(max(sample.arrival_ns - sample.stamp_ns for sample in batch) < 1e6 for batch in batches)
        assert 'does not keep the announced rate' in working(sensor, Level.WARN).message
        assert sensor.rate_hz == 250.0
