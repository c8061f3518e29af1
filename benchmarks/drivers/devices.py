"""The emulated devices of the driver benchmark, each in a separate process that knows the times of its data.

It passes an address to the measuring process and, as plain data, what is necessary to find the time of each item: the
clock of a sensor, or the place of the pictures' stamps.
"""

from __future__ import annotations

import contextlib
import http.server
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.devices.marlin import Marlin
from tactile_nodes.clock import NS_PER_S, SystemClock
from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.emulators.clocks import DeviceClock
from tactile_nodes.emulators.cnc.grbl import Grbl
from tactile_nodes.emulators.cnc.grbl_dialect import GrblSettings
from tactile_nodes.emulators.force_torque.net_ft import NetFtServer
from tactile_nodes.emulators.force_torque.net_ft_box import NetFtBox
from tactile_nodes.emulators.force_torque.net_ft_config import NetFtConfig
from tactile_nodes.emulators.force_torque.serial_ft import PtySensor, Talker
from tactile_nodes.emulators.force_torque.serial_ft_bota import BotaSensor
from tactile_nodes.emulators.force_torque.serial_ft_sensor import microsecond_clock
from tactile_nodes.emulators.force_torque.serial_ft_text import TextLineSensor
from tactile_nodes.emulators.serial_device import SerialDevice
from tactile_nodes.emulators.serial_ports import PtyPort
from tactile_nodes.emulators.world import World, WorldSettings, Wrench
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Optics

DRIFT_PPM = 100.0
OFFSET = 5000
TEXT_RATE_HZ = 500.0  # the limit of 115200 baud for lines with one channel
START_MM = {'marlin': (-115.0, -115.0, -5.0), 'grbl': (-5.0, -5.0, -5.0)}  # near the end switches
QUALITY = 90
NUMBER_BITS, BLOCK_PX = 8, 24
PICTURES = 1 << NUMBER_BITS
BOUNDARY = b'--picture\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n'

Address = dict[str, Any]


class Load:
    """A constant load."""

    def wrench_at(self, time_ns: int) -> Wrench:  # noqa: ARG002
        """1 N and a little torque."""
        return 0.1, -0.2, 1.0, 0.01, -0.02, 0.0


@contextlib.contextmanager
def net_ft(folder: Path, stamps: np.ndarray) -> Iterator[Address]:  # noqa: ARG001
    """A Net F/T box that sends 7000 records a second."""
    clock = SystemClock()
    ticks = DeviceClock(7000.0, clock.now_ns(), OFFSET, DRIFT_PPM)
    box = NetFtBox(Load(), NetFtConfig(divider=1), ticks, noise=(0.002, 0.0001))
    with NetFtServer(box, clock) as server:
        yield {'rdt_port': server.rdt_port, 'http_port': server.http_port, 'ticks': ticks, 'step': 1.0}


@contextlib.contextmanager
def bota(folder: Path, stamps: np.ndarray) -> Iterator[Address]:  # noqa: ARG001
    """A Bota sensor on a serial line; its driver sets its rate."""
    yield from _serial_sensor(lambda ticks: BotaSensor(Load(), ticks), folder, 51 * 1e6 / 51_200)


@contextlib.contextmanager
def text(folder: Path, stamps: np.ndarray) -> Iterator[Address]:  # noqa: ARG001
    """A load cell that sends lines."""
    yield from _serial_sensor(
        lambda ticks: TextLineSensor(Load(), clock=ticks, rate_hz=TEXT_RATE_HZ), folder, 1e6 / TEXT_RATE_HZ
    )


def _serial_sensor(make: Callable[[DeviceClock], Talker], folder: Path, step: float) -> Iterator[Address]:
    clock = SystemClock()
    ticks = microsecond_clock(clock.now_ns(), OFFSET, DRIFT_PPM)
    with PtySensor(make(ticks), clock, folder / 'ttyFT') as device:
        yield {'device': str(device.path), 'ticks': ticks, 'step': step}


@contextlib.contextmanager
def grbl(folder: Path, stamps: np.ndarray) -> Iterator[Address]:  # noqa: ARG001
    """A Grbl 1.1h on a serial line."""
    yield from _controller('grbl', lambda world, clock: Grbl(world, clock, GrblSettings()), folder)


@contextlib.contextmanager
def marlin(folder: Path, stamps: np.ndarray) -> Iterator[Address]:  # noqa: ARG001
    """A Marlin 2.1 on a serial line."""
    yield from _controller('marlin', Marlin, folder)


def _controller(kind: str, make: Callable[[World, SystemClock], SerialDevice], folder: Path) -> Iterator[Address]:
    clock, world = SystemClock(), World(WorldSettings(start_mm=START_MM[kind]))
    with PtyPort(make(world, clock), clock, folder / 'ttyCNC', reset_on_open=True) as port:
        yield {'device': str(port.path)}


@contextlib.contextmanager
def camera_60(folder: Path, stamps: np.ndarray) -> Iterator[Address]:  # noqa: ARG001
    """MJPEG over HTTP, 60 pictures a second."""
    yield from _camera(stamps, 60.0)


@contextlib.contextmanager
def camera_flood(folder: Path, stamps: np.ndarray) -> Iterator[Address]:  # noqa: ARG001
    """MJPEG over HTTP, as fast as the connection allows."""
    yield from _camera(stamps, 0.0)


def _camera(stamps: np.ndarray, fps: float) -> Iterator[Address]:
    parts, clock, stop = _numbered_pictures(), SystemClock(), threading.Event()

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header('Content-Type', 'multipart/x-mixed-replace; boundary=picture')
            self.end_headers()
            with contextlib.suppress(OSError):  # the client has disconnected
                self._send_pictures()

        def _send_pictures(self) -> None:
            due_ns = clock.now_ns()
            while not stop.is_set():
                clock.sleep_until(due_ns)
                number = int(stamps[0])
                stamps[1 + number % PICTURES], stamps[0] = clock.now_ns(), number + 1
                self.wfile.write(parts[number % PICTURES])
                due_ns = max(due_ns + round(NS_PER_S / fps), clock.now_ns() - NS_PER_S) if fps else clock.now_ns()

        def log_message(self, format: str, *args: object) -> None:
            """Log nothing."""

    server = http.server.ThreadingHTTPServer(('127.0.0.1', 0), Handler)
    server.daemon_threads, server.block_on_close = True, False
    thread = threading.Thread(target=server.serve_forever, args=(0.05,), name='camera', daemon=True)
    thread.start()
    yield {
        'url': f'http://127.0.0.1:{server.server_address[1]}/',
        'bytes': float(np.mean([len(part) for part in parts])),
    }
    stop.set()
    server.shutdown()
    thread.join()
    server.server_close()


def _numbered_pictures() -> list[bytes]:
    """Pictures of the gel at rest, 640x480, with a number at the upper edge in blocks large enough for JPEG."""
    import cv2

    gel = Gel()
    scene = np.array(Optics(gel, contact_table(gel)).render((), noise_seed=1), np.uint8)
    parts = []
    for number in range(PICTURES):
        for bit in range(NUMBER_BITS):
            scene[:BLOCK_PX, bit * BLOCK_PX : (bit + 1) * BLOCK_PX] = 255 * (number >> bit & 1)
        data = cv2.imencode('.jpg', scene, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
        parts.append(BOUNDARY % len(data) + data + b'\r\n')
    return parts


def number_in(image: np.ndarray) -> int:
    """The number in a picture of `_numbered_pictures`."""
    grey = image if image.ndim == 2 else image[..., 1]
    middles = grey[BLOCK_PX // 2, BLOCK_PX // 2 : NUMBER_BITS * BLOCK_PX : BLOCK_PX]
    return sum(1 << bit for bit, value in enumerate(middles) if value > 127)
