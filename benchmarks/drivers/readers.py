"""The measured side of the driver benchmark: each driver as used in an application, at its highest rate."""

from __future__ import annotations

import bisect
import contextlib
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from benchmarks.devices.sync_line import EmulatedControlLine
from benchmarks.drivers.devices import PICTURES, Address, number_in
from benchmarks.drivers.meter import Meter, Order
from tactile_nodes.clock import NS_PER_S
from tactile_nodes.drivers.camera.contract import CameraSettings
from tactile_nodes.drivers.camera.opening import open_camera
from tactile_nodes.drivers.cnc.contract import Cnc, CncSettings
from tactile_nodes.drivers.cnc.opening import open_cnc
from tactile_nodes.drivers.force_torque.contract import ForceTorqueSettings, NetFtSettings
from tactile_nodes.drivers.force_torque.opening import open_force_torque
from tactile_nodes.drivers.sync_input.control_line import SyncInputSettings, WatchedLine
from tactile_nodes.emulators.world import Edge
from tactile_nodes.errors import DeviceLostError, DeviceTimeoutError

PATIENCE_S = 5.0
FASTEST_BOTA_HZ = 1004.0
STATUSES_PER_JOG, JOGS_PER_STROKE = 3, 100
JOG_MM = {'grbl': -0.002, 'marlin': 0.01}  # away from the end switches
MARLIN_LOWEST_MM, MARLIN_HIGHEST_MM, MARLIN_SAFE_Z_MM = (0.0, 0.0, 0.0), (120.0, 120.0, 60.0), 50.0
SHORTEST_EDGE_S, LONGEST_EDGE_S = 0.01, 0.03

Reader = Callable[[Address, np.ndarray, Meter], None]


def net_ft(address: Address, _: np.ndarray, meter: Meter) -> None:
    """Read every record of a Net F/T box."""
    ports = NetFtSettings(rdt_port=address['rdt_port'], http_port=address['http_port'])
    _read_samples(ForceTorqueSettings('netft://127.0.0.1', net_ft=ports), address, meter)


def bota(address: Address, _: np.ndarray, meter: Meter) -> None:
    """Read every frame of a Bota sensor with its shortest filter."""
    _read_samples(ForceTorqueSettings(f'bota:{address["device"]}', rate_hz=FASTEST_BOTA_HZ), address, meter)


def text(address: Address, _: np.ndarray, meter: Meter) -> None:
    """Read every line of a load cell."""
    _read_samples(ForceTorqueSettings(f'text:{address["device"]}'), address, meter)


def _read_samples(settings: ForceTorqueSettings, address: Address, meter: Meter) -> None:
    order, ticks, step = Order(meter), address['ticks'], address['step']
    ns_per_tick = NS_PER_S / (ticks.rate_hz * (1 + ticks.drift_ppm * 1e-6))
    with contextlib.closing(open_force_torque(settings, meter.clock)) as sensor:
        at_begin, losses = None, 0
        while meter.going_on():
            try:
                samples = sensor.read(PATIENCE_S)
            except (DeviceLostError, DeviceTimeoutError):  # wait until it is found again; its losses are counted
                losses += meter.measuring
                meter.clock.sleep_until(meter.clock.now_ns() + NS_PER_S // 100)
                continue
            now_ns = meter.clock.now_ns()
            at_begin = samples[0].dropped if at_begin is None and meter.measuring else at_begin
            counts = np.array([sample.device_ticks for sample in samples]) - ticks.offset
            made_ns = ticks.start_ns + counts * ns_per_tick
            meter.handed_over(now_ns - made_ns, np.array([sample.stamp_ns for sample in samples]) - made_ns)
            order.follow(np.rint(counts / step))
        newest = sensor.newest()
        lost = newest.dropped - (at_begin or 0) if newest is not None else 0
        details = {'lost': lost, 'reads that failed': losses, 'health': sensor.health.message, **sensor.description}
        meter.extra['driver'] = details


def camera(address: Address, stamps: np.ndarray, meter: Meter) -> None:
    """Read the newest picture repeatedly."""
    last, unwrapped, lost, order = None, 0, 0, Order(meter)
    with contextlib.closing(open_camera(CameraSettings(source=address['url']), meter.clock)) as source:
        while meter.going_on():
            frame = source.read(PATIENCE_S)
            now_ns = meter.clock.now_ns()
            assert frame is not None
            number = number_in(frame.image)
            unwrapped += 0 if last is None else (number - last + PICTURES // 4) % PICTURES - PICTURES // 4
            last, lost, sent_ns = number, frame.dropped, int(stamps[1 + number])
            meter.handed_over([now_ns - sent_ns], [frame.stamp_ns - sent_ns])
            order.follow([unwrapped])
        meter.extra['driver'] = {'lost': lost, 'health': source.health.message, **source.description}
        meter.extra['bytes_per_picture'] = address['bytes']


class Traffic:
    """Counts questions, lines and their answers on a controller's serial line."""

    def __init__(self) -> None:
        self.sent = {'reports': 0, 'lines': 0}
        self.answered = {'reports': 0, 'lines': 0}
        self._rest = b''

    def hear(self, way: str, _: int, data: bytes) -> None:
        """Count the content of `data`."""
        if way == '>':
            self.sent['reports'] += data.count(b'?')
            self.sent['lines'] += data.count(b'\n')
            return
        *lines, self._rest = (self._rest + data).split(b'\n')
        self.answered['reports'] += sum(line.startswith(b'<') for line in lines)
        self.answered['lines'] += sum(line.strip() == b'ok' or line.startswith((b'ok ', b'error')) for line in lines)

    def unanswered(self) -> int:
        """Number of questions and lines without an answer; negative if there are too many answers."""
        return sum(self.sent.values()) - sum(self.answered.values())


def grbl(address: Address, _: np.ndarray, meter: Meter) -> None:
    """Exchange reports and jogs, each as soon as the last was answered."""
    _exchange(CncSettings(address['device']), 'grbl', meter)


def marlin(address: Address, _: np.ndarray, meter: Meter) -> None:
    """As `grbl`; the question is M114."""
    settings = CncSettings(
        address['device'],
        'marlin',
        home_command='G28',
        lowest_mm=MARLIN_LOWEST_MM,
        highest_mm=MARLIN_HIGHEST_MM,
        safe_z_mm=MARLIN_SAFE_Z_MM,
    )
    _exchange(settings, 'marlin', meter)


def _exchange(settings: CncSettings, kind: str, meter: Meter) -> None:
    """Move in strokes of small jogs back and forth; after each, the machine must be at the sum of its jogs."""
    traffic, way_mm, strokes = Traffic(), JOG_MM[kind], 0
    with contextlib.closing(open_cnc(settings, meter.clock, traffic=traffic.hear)) as cnc:
        cnc.home()
        while meter.going_on():
            _stroke(cnc, way_mm, meter)
            way_mm, strokes = -way_mm, strokes + 1
        meter.clock.sleep_until(meter.clock.now_ns() + NS_PER_S // 2)
        meter.extra['driver'] = {
            'health': cnc.health.message,
            'strokes': strokes,
            'jogs': strokes * JOGS_PER_STROKE,
            'sent': traffic.sent,
            'answered': traffic.answered,
        }
        meter.count('lost', max(0, traffic.unanswered()))
        meter.count('doubled', max(0, -traffic.unanswered()))


def _stroke(cnc: Cnc, way_mm: float, meter: Meter) -> None:
    """One stroke. `wait_idle` raises if the machine is at a wrong place; this also counts missing single jogs."""
    start = last = cnc.status().position_mm[0]
    for _ in range(JOGS_PER_STROKE):
        meter.going_on()
        _timed(lambda: cnc.jog(dx=way_mm, feed=600.0), meter)
        for _ in range(STATUSES_PER_JOG):
            x_mm = _timed(cnc.status, meter).position_mm[0]
            meter.count('reordered', (x_mm - last) * way_mm < 0)
            last = x_mm
    cnc.wait_idle()
    travelled = cnc.status().position_mm[0] - start
    meter.count('lost', abs(round(travelled / way_mm) - JOGS_PER_STROKE))


def _timed(ask: Callable[[], Any], meter: Meter) -> Any:
    begin_ns = meter.clock.now_ns()
    answer = ask()
    meter.handed_over([meter.clock.now_ns() - begin_ns])
    return answer


class Flicker:
    """A digital line that changes at irregular times, which are the same in every run."""

    def __init__(self, start_ns: int, seconds: float) -> None:
        chance = np.random.default_rng(1)
        steps_s = chance.uniform(SHORTEST_EDGE_S, LONGEST_EDGE_S, round(seconds / SHORTEST_EDGE_S))
        self.times_ns: list[int] = (start_ns + np.cumsum(steps_s * NS_PER_S).astype(np.int64)).tolist()

    def before(self, time_ns: int) -> int:
        """Number of changes up to a time."""
        return bisect.bisect_right(self.times_ns, time_ns)

    def line_level(self, time_ns: int) -> bool:
        """Whether it is high at a time."""
        return self.before(time_ns) % 2 == 1

    def line_edges(self) -> Sequence[Edge]:
        """All changes."""
        return [Edge(time_ns, index % 2 == 0) for index, time_ns in enumerate(self.times_ns)]


def sync(address: Address, _: np.ndarray, meter: Meter) -> None:
    """Read the edges of a line that is polled every millisecond."""
    flicker, order = Flicker(meter.clock.now_ns(), address['seconds']), Order(meter)
    settings = SyncInputSettings('emulated')
    line = EmulatedControlLine(flicker, meter.clock)
    watched = WatchedLine('CTS', lambda: line, settings, meter.clock)
    watched.open()
    with contextlib.closing(watched), contextlib.suppress(DeviceTimeoutError):
        while meter.going_on():
            edges = watched.read(PATIENCE_S)
            now_ns = meter.clock.now_ns()
            for edge in edges:
                index = _edge_of(flicker, edge.stamp_ns, edge.level)
                made_ns = flicker.times_ns[index]
                meter.handed_over([now_ns - made_ns], [edge.stamp_ns - made_ns])
                order.follow([index])
        meter.extra['driver'] = {'health': watched.health.message, **watched.description}


def _edge_of(flicker: Flicker, stamp_ns: int, level: bool) -> int:
    """The number of the change to this level that is nearest to a stamp."""
    after = flicker.before(stamp_ns)
    near = [index for index in range(max(0, after - 2), after + 2) if (index % 2 == 0) == level]
    return min(near, key=lambda index: abs(flicker.times_ns[index] - stamp_ns))
