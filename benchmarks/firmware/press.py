"""One press on a firmware, with a fault, as on a rig; gel and sensor are simulated at the firmware's reported place."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

from benchmarks.devices.liars import BotaLiar, Changed, Lie, UdpProxy, Values
from benchmarks.firmware.descent import SLOPE, above, down, station
from benchmarks.firmware.faults import FALTER, Fault
from benchmarks.firmware.killed import DEEP_S, FREE_S, Commander, until
from benchmarks.firmware.line import Line, ReportedPlace, Wire, open_wire
from tactile_nodes.clock import NS_PER_S, Clock, monotonic_s
from tactile_nodes.collection.hands import Hands, TrippedError
from tactile_nodes.collection.press.surface import HERTZ, Loading
from tactile_nodes.collection.press.up import bring_up
from tactile_nodes.collection.safety import MACHINE, PASSING, SILENT_MACHINE
from tactile_nodes.collection.settings import CollectionSettings
from tactile_nodes.collection.station import Station
from tactile_nodes.collection.wrench import Tare
from tactile_nodes.drivers.cnc.contract import CncSettings, Place
from tactile_nodes.drivers.force_torque.contract import ForceTorqueSettings, NetFtSettings
from tactile_nodes.drivers.force_torque.net_ft_config import read_config
from tactile_nodes.emulators.force_torque.net_ft import NetFtServer
from tactile_nodes.emulators.force_torque.net_ft_box import NetFtBox
from tactile_nodes.emulators.force_torque.net_ft_config import NetFtConfig
from tactile_nodes.emulators.force_torque.serial_ft import PtySensor
from tactile_nodes.emulators.force_torque.serial_ft_bota import BotaSensor
from tactile_nodes.emulators.serial_ports import PtyPort
from tactile_nodes.emulators.world import NOTHING, Wrench
from tactile_nodes.errors import TactileError

BEGINS_MM = 0.3
NOISE = (0.005, 0.0001)
PORT = 'firmware'  # file name in the folder of a trial
SETTLE_S, ASKED_S = 1.0, 3.0
WATCHED = 'what watches over it'
NEAR_MM = 0.05


@dataclass(frozen=True)
class Machine:
    """A firmware, and the place of its presses.

    Attributes:
        name: its name.
        source: command, port or socket.
        settings: settings of its driver; `source` is set here.
        gel_mm: centre of the gel's surface in its coordinates.
        box: host and ports of a real Net F/T box at rest; '': one is emulated.
    """

    name: str
    source: str
    settings: CncSettings
    gel_mm: Place
    box: str = ''

    @property
    def kind(self) -> str:
        """Its protocol: grbl or marlin."""
        return self.settings.kind


@dataclass
class Outcome:
    """The result of a press.

    Attributes:
        said: reason of the stop; '': it was not stopped.
        kind: kind of the trip; 'driver': raised by the driver; `WATCHED`: only the watchdog program was left.
        reached_mm: largest depth, as reported by the firmware.
        noticed_s: time from the fault to the detection.
        rest_s: time from the fault to the last reported change of the place.
        up: result of the retraction.
        up_mm: height above the gel at the end.
    """

    said: str = ''
    kind: str = ''
    reached_mm: float = 0.0
    noticed_s: float | None = None
    rest_s: float | None = None
    up: str = ''
    up_mm: float | None = None


@dataclass
class Bench:
    """A firmware behind a line, and a sensor with the gel's force at the place that the firmware reports."""

    machine: Machine
    fault: Fault
    clock: Clock
    folder: Path
    begun_ns: int = 0
    descending: bool = False
    begun_mm: float = 0.0
    line: Line = field(init=False)
    reported: ReportedPlace = field(init=False)
    port: PtyPort = field(init=False)

    def __post_init__(self) -> None:
        self.reported = ReportedPlace(self.machine.gel_mm[2], self._look)

    @contextlib.contextmanager
    def plugged(self) -> Iterator[CncSettings]:
        """Connect the firmware to a port."""
        settings = self.machine.settings
        wire: Wire = open_wire(self.machine.source, settings.baud, self.clock)
        try:
            self.line = Line(wire, self.machine.kind, self.reported, self.clock)
            with PtyPort(self.line, self.clock, self._path) as self.port:
                yield replace(settings, source=str(self.port.path))
        finally:
            self.line.wire.close()

    @property
    def _path(self) -> Path:
        return self.folder / PORT

    def named(self, text: str) -> str:
        """A sentence with 'it' instead of the port's path."""
        return text.replace(str(self._path), 'it')

    def begun(self) -> bool:
        """Whether the fault has begun."""
        return self.begun_ns > 0

    def wrench_at(self, time_ns: int) -> Wrench:
        """As `WrenchSource.wrench_at`: the gel's force, 0.44 N at 1 mm, and the fault's load on the tip in it."""
        force = Loading(0.0, SLOPE, HERTZ).force_n(self.reported.depth_at(time_ns))
        if not force:
            return NOTHING
        fx, fy, fz, *torque = self.fault.load if self.begun() else NOTHING
        return (fx, fy, fz + force, torque[0], torque[1], torque[2])

    def _look(self, now_ns: int) -> None:
        if self.descending and not self.begun_ns and self.reported.depth_mm >= BEGINS_MM:
            self.begun_ns, self.begun_mm = now_ns, self.reported.depth_mm
            self.fault.begin(self.line)


def press(machine: Machine, fault: Fault, clock: Clock, folder: Path) -> Outcome:
    """Home, move above the gel and down, inject the fault at 0.3 mm, and move up again.

    Raises:
        TactileError, TrippedError: it failed before the press.
    """
    bench = Bench(machine, fault, clock, folder)
    with bench.plugged() as cnc, _sensor(bench) as sensor:
        outcome = (_killed if fault.kills else _watched)(bench, cnc, sensor)
        _asked(bench, outcome)
        if fault.kills:
            outcome.up = _up(bench, outcome)
    return replace(outcome, said=bench.named(outcome.said), up=bench.named(outcome.up))


def _watched(bench: Bench, cnc: CncSettings, sensor: ForceTorqueSettings) -> Outcome:
    """Press from this process, which moves up again as in a collection."""
    rig = station(cnc, sensor, bench.clock)
    try:
        outcome, tare = _pressed(bench, rig)
        _away(bench, rig, tare, outcome)
        require_begun(bench, outcome)
    finally:
        rig.close()
    return outcome


def require_begun(bench: Bench, outcome: Outcome) -> None:
    """Raises TactileError if the press was not stopped by its fault, but because the computer was busy."""
    if not bench.begun():
        raise TactileError(f'before its fault: {outcome.said or "nothing was heard of a tip so deep"}')
    if bench.fault.trip not in {'', outcome.kind} and outcome.kind in PASSING:
        raise TactileError(f'before its fault told: {outcome.said}')


def _killed(bench: Bench, cnc: CncSettings, sensor: ForceTorqueSettings) -> Outcome:
    """Press from another process, which the fault kills; after that, only receive.

    Raises:
        TactileError: the tip did not reach the depth of the fault.
    """
    commander = Commander(cnc, sensor, bench.machine.gel_mm)
    try:
        bench.line.kill_host = commander.kill
        bench.reported.begin()
        bench.descending = True
        commander.press()
        if not until(bench.begun, bench.clock, DEEP_S):
            raise TactileError(f'nobody heard that the tip came {BEGINS_MM:g} mm deep within {DEEP_S:g} s')
        free = until(lambda: not bench.port.in_use, bench.clock, FREE_S)
    finally:
        commander.close()
    commands = [(stamp_ns, data) for stamp_ns, data in bench.line.received if b'Z' in data]
    if not commands:
        return Outcome(kind=WATCHED)
    last = commands[-1][1].decode('ascii', 'replace').split('\n')[-2]
    times = sum(last.encode() in data for _, data in commands)
    over = '' if free else ', and still holds the port'
    outcome = Outcome(f'{WATCHED} says {times} times {last}{over}', WATCHED)
    outcome.noticed_s = _since(bench, next(stamp_ns for stamp_ns, data in commands if last.encode() in data))
    outcome.rest_s = _since(bench, bench.reported.moved_ns)
    return outcome


def _up(bench: Bench, outcome: Outcome) -> str:
    safe_mm = bench.machine.settings.safe_z_mm - bench.machine.gel_mm[2]
    is_up = outcome.up_mm is not None and abs(outcome.up_mm - safe_mm) < NEAR_MM
    return 'up' if is_up else f'not at the safe height, {safe_mm:.2f} mm'


def _pressed(bench: Bench, rig: Station) -> tuple[Outcome, Tare]:
    hands, outcome = rig.hands, Outcome()
    tare = above(rig, bench.machine.gel_mm, bench.machine.settings.safe_z_mm, bench.clock)
    bench.reported.begin()
    bench.descending = True
    try:
        hands.run(down(bench.machine.gel_mm[2], tare))
    except TrippedError as tripped:
        outcome.said, outcome.kind = tripped.trip.reason, tripped.trip.kind
        outcome.noticed_s = _since(bench, tripped.trip.stamp_ns)
        rig.guard.stopped.wait(10.0)
    except TactileError as error:
        outcome.said, outcome.kind = str(error), 'driver'
        outcome.noticed_s = _since(bench, bench.clock.now_ns())
    bench.clock.sleep_until(bench.clock.now_ns() + round(SETTLE_S * NS_PER_S))
    outcome.rest_s = _since(bench, bench.reported.moved_ns)
    return outcome, tare


def _away(bench: Bench, rig: Station, tare: Tare, outcome: Outcome) -> None:
    bench.descending = False
    doubted = outcome.kind in {MACHINE, SILENT_MACHINE, 'driver'}
    try:
        bring_up(_reset(rig.hands, bench.clock), tare, CollectionSettings(), doubted)
        outcome.up = 'up'
    except (TactileError, TrippedError) as error:
        outcome.up = str(error)


def _reset(hands: Hands, clock: Clock) -> Hands:
    """Reset the safety, as a person does after removing the cause; a remaining fault is detected again."""
    hands.safety.watching = False
    hands.safety.reset(clock.now_ns(), hands.safety.trip)
    return hands


def _asked(bench: Bench, outcome: Outcome) -> None:
    """Ask the firmware directly, without faults, for its final place."""
    bench.line.cut = True
    bench.clock.sleep_until(bench.clock.now_ns() + round(ASKED_S * NS_PER_S))
    outcome.reached_mm = round(bench.reported.deepest_mm, 3)
    outcome.up_mm = round(-bench.reported.depth_mm, 3)


def _since(bench: Bench, time_ns: int) -> float | None:
    return round((time_ns - bench.begun_ns) / NS_PER_S, 2) if bench.begun_ns and time_ns > bench.begun_ns else None


# The sensor.


@contextlib.contextmanager
def _sensor(bench: Bench) -> Iterator[ForceTorqueSettings]:
    with _bota(bench) if bench.fault.sensor == 'bota' else _net_ft(bench) as settings:
        yield settings


@contextlib.contextmanager
def _bota(bench: Bench) -> Iterator[ForceTorqueSettings]:
    lie = Lie(bench.begun, bench.fault.lie or (lambda last: last))
    with PtySensor(BotaLiar(BotaSensor(bench), lie), bench.clock, bench.folder / 'bota') as device:
        yield ForceTorqueSettings(f'bota:{device.path}', rate_hz=200.0)


class _Idle:
    """A sensor without load."""

    def wrench_at(self, time_ns: int) -> Wrench:  # noqa: ARG002
        return NOTHING


@contextlib.contextmanager
def _net_ft(bench: Bench) -> Iterator[ForceTorqueSettings]:
    """A real or emulated box; a proxy adds the gel's force to its records, and then the lie."""
    if bench.machine.box:
        host, rdt, http = bench.machine.box.split(':')
        with _proxied(bench, host, int(rdt), int(http)) as settings:
            yield settings
        return
    box = NetFtBox(_Idle(), NetFtConfig(divider=14), noise=NOISE)
    with NetFtServer(box, bench.clock) as server, _proxied(bench, '127.0.0.1', server.rdt_port, server.http_port) as it:
        yield it


@contextlib.contextmanager
def _proxied(bench: Bench, host: str, rdt: int, http: int) -> Iterator[ForceTorqueSettings]:
    units = read_config(host, http).units_per_count
    with UdpProxy(
        rdt,
        Changed(_distorted(bench, units)),
        status=lambda: bench.fault.status if bench.begun() else 0,
        delay_s=lambda: _delay_s(bench),
        every=lambda: bench.fault.every(bench.reported.depth_mm - bench.begun_mm) if bench.begun() else 1,
        now_s=monotonic_s,
    ) as proxy:
        yield ForceTorqueSettings(f'netft://{host}', net_ft=NetFtSettings(rdt_port=proxy.port, http_port=http))


def _distorted(bench: Bench, units: tuple[float, ...]) -> Callable[[Values], Values]:
    lie = Lie(bench.begun, bench.fault.lie) if bench.fault.lie else None

    def of(counts: Values) -> Values:
        wrench = bench.wrench_at(bench.clock.now_ns())
        true = tuple(count + value / unit for count, value, unit in zip(counts, wrench, units, strict=True))
        distorted = lie.of(true) if lie else true
        return (*true[:2], distorted[2], *true[3:]) if bench.fault.sensor == 'net_ft z' else distorted

    return of


def _delay_s(bench: Bench) -> float:
    """The delay of samples; it grows slowly, so that samples become older without a gap."""
    since_s = (bench.clock.now_ns() - bench.begun_ns) / NS_PER_S if bench.begun() else 0.0
    return min(bench.fault.late_s, FALTER * since_s)
