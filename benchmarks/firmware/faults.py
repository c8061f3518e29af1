"""Faults during a press: of the serial line, of the board, and of the force sensor."""

from __future__ import annotations

import math
import random
import re
from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.devices.liars import Values, frozen, zeros
from benchmarks.firmware.line import Line
from tactile_nodes.collection.safety import FORCE, OVERLOAD, SENSOR
from tactile_nodes.emulators.world import NOTHING, Wrench

THRESHOLD = 0x8001_0000
LATE_S, FALTER = 1.5, 0.8
NOISE_COUNTS = (5000.0, 100.0)
BANNERS = {'grbl': b"Grbl 1.1h ['$' for help]\r\n", 'marlin': b'start\n'}
ZERO = {'grbl': rb'[MW]Pos:[-\d.,]+', 'marlin': rb'\bX:\S+ Y:\S+ Z:\S+(?= E)'}
AT_ZERO = {'grbl': b'MPos:0.000,0.000,0.000', 'marlin': b'X:0.00 Y:0.00 Z:0.00'}
BANNER = re.compile(rb'(?i)^(grbl|grblhal) \d|^start\s*$')
BOTH = ('grbl', 'marlin')
Lying = Callable[[Values], Values]


def _nothing(_: Line) -> None:
    """No fault of the line or the board."""


@dataclass(frozen=True)
class Fault:
    """A fault that begins once, at a depth of 0.3 mm.

    Attributes:
        title: name in the table.
        begin: applies the fault to the line or the board.
        lie: the sensor's values from then on, from its last six true counts (Net F/T) or values (Bota).
        every: one of this number of samples is left, by the depth below the start of the fault, in mm.
        late_s: the age that samples reach.
        status: bits in each record.
        load: additional load on the tip from then on, as long as the tip is in the gel.
        trip: required kind of the trip; '': any.
        kills: whether the process that commands the machine is killed; it is then a separate process.
        sensor: required sensor.
        harmless: whether the press must go on to its end.
        damages_a_line: whether it damages a line to the firmware; with checksums it is sent again, the press goes on.
        bounded: whether the press may go on, because the tip goes no further than commanded.
        kinds: the firmwares that it applies to.
    """

    title: str
    begin: Callable[[Line], None] = _nothing
    lie: Lying | None = None
    every: Callable[[float], int] = lambda _: 1
    late_s: float = 0.0
    status: int = 0
    load: Wrench = NOTHING
    trip: str = ''
    kills: bool = False
    sensor: str = 'net_ft'
    harmless: bool = False
    damages_a_line: bool = False
    bounded: bool = False
    kinds: tuple[str, ...] = BOTH


def digit(letter: bytes, change: Callable[[float], float]) -> Callable[[Line], None]:
    """Change the number behind a letter in the next line of motion, but not the checksum, if there is one."""

    def begin(line: Line) -> None:
        done: list[bytes] = []

        def lie(way: str, data: bytes) -> bytes:
            found = re.search(rb'(?<=' + letter + rb')-?\d+\.\d+', data) if way == '>' and b'G' in data else None
            if found is None or done:
                return data
            done.append(found[0])
            places = len(found[0].partition(b'.')[2])
            new = f'{change(float(found[0])):.{places}f}'.encode('ascii')
            return data[: found.start()] + new + data[found.end() :]

        line.faults.lie = lie

    return begin


def _reports(old: bytes, new: Callable[[re.Match[bytes]], bytes], times: int) -> Callable[[Line], None]:
    """Replace `old` in the next `times` reports."""

    def begin(line: Line) -> None:
        done: list[bytes] = []

        def lie(way: str, data: bytes) -> bytes:
            if way == '>' or len(done) >= times or re.search(old, data) is None:
                return data
            done.append(data)
            return re.sub(old, new, data, count=1)

        line.faults.lie = lie

    return begin


def _one_report(line: Line) -> None:
    axes = rb'(?<=MPos:)-?\d' if line.kind == 'grbl' else rb'(?<=\bX:)\d(?=.* E:)'
    _reports(axes, lambda found: found[0] + b'7', 1)(line)


def _at_zero(line: Line) -> None:
    _reports(ZERO[line.kind], lambda _: AT_ZERO[line.kind], 10**9)(line)


def _restart(line: Line) -> None:
    line.restart()


def _restart_unheard(line: Line) -> None:
    line.faults.lie = lambda way, data: b'' if way == '<' and BANNER.search(data) else data
    line.restart()


def _banner(line: Line) -> None:
    line.say(BANNERS[line.kind])


def _reset(line: Line) -> None:
    line.wire.write(b'\x18')


def _mute(line: Line) -> None:
    line.faults.mute = True


def _cut(line: Line) -> None:
    line.cut = True


def _halt(line: Line) -> None:
    line.wire.halt()


def echo(line: Line) -> None:
    """Everything that is sent is echoed, in addition to the firmware's output."""

    def lie(way: str, data: bytes) -> bytes:
        if way == '>':
            line.say(data)
        return data

    line.faults.lie = lie


def _kill(line: Line) -> None:
    line.asking = True
    line.kill_host()


def no_number(last: Values) -> Values:
    """The last axis is NaN; the others repeat their values, which alone would be detected later."""
    return (*last[:-1], math.nan)


def noisy() -> Lying:
    """The force at 0.3 mm forever, with the noise of an intact sensor: no value repeats, is late or is NaN."""
    noise = random.Random(1)  # noqa: S311  (noise, not secrets)
    return lambda last: tuple(value + noise.gauss(0.0, NOISE_COUNTS[axis >= 3]) for axis, value in enumerate(last))


def _halved(deeper_mm: float) -> int:
    return 1 << max(0, min(8, math.ceil(deeper_mm / 0.1)))


FAULTS = {
    'none': Fault('nothing', harmless=True),
    'deeper_1': Fault('Z of one jog 1 mm deeper (one digit)', digit(b'Z', lambda z: z - 1.0), damages_a_line=True),
    'deeper_9': Fault('Z of one jog 9 mm deeper (one digit)', digit(b'Z', lambda z: z - 9.0), damages_a_line=True),
    'sideways': Fault('X of one jog off by 1 mm (one digit)', digit(b'X', lambda x: x - 1.0), damages_a_line=True),
    'faster': Fault(
        'F60 of one jog becomes F960 (one digit more)', digit(b'F', lambda feed: feed + 900.0), bounded=True
    ),
    'report': Fault('one report is corrupted', _one_report, harmless=True),
    'restart': Fault('the board restarts (power lost for a moment)', _restart),
    'unheard': Fault('the board restarts, its banner is lost', _restart_unheard),
    'banner': Fault('a start banner during the press, without a restart', _banner),
    'reset': Fault('another program resets it (0x18)', _reset, kinds=('grbl',)),
    'zero': Fault('every report says 0, 0, 0', _at_zero),
    'mute': Fault('nothing that it sends arrives', _mute),
    'cut': Fault('nothing arrives in either direction', _cut),
    'halt': Fault('its processor hangs', _halt),
    'echo': Fault('everything sent is echoed', echo, harmless=True),
    'killed': Fault('the process that commands it is killed (SIGKILL)', _kill, kills=True),
    'force': Fault('3.5 N more (limits.force_n: 3 N)', load=(0.0, 0.0, 3.5, 0.0, 0.0, 0.0), trip=FORCE),
    'bearable': Fault('6 N more (limits.bearable_n: 5 N)', load=(0.0, 0.0, 6.0, 0.0, 0.0, 0.0), trip=OVERLOAD),
    'torque': Fault('0.25 N m (3 N at 60 mm: 0.18 N m)', load=(0.0, 0.0, 0.0, 0.25, 0.0, 0.0), trip=FORCE),
    'rise': Fault('2 N more, suddenly (40 N/s over 40 ms)', load=(0.0, 0.0, 2.0, 0.0, 0.0, 0.0), trip=FORCE),
    'frozen': Fault('the force sensor repeats one value', lie=frozen, trip=SENSOR),
    'zeros': Fault('the force sensor sends zeros', lie=zeros, trip=SENSOR),
    'old_force': Fault('the force stays that of 0.3 mm, with noise', lie=noisy()),
    'one_axis': Fault(
        'Fz repeats one value, the other axes do not', lie=lambda last: last, sensor='net_ft z', trip=SENSOR
    ),
    'late': Fault('samples become 1.5 s old', late_s=LATE_S, trip=SENSOR),
    'slower': Fault('half as many samples for every further 0.1 mm', every=_halved, trip=SENSOR),
    'threshold': Fault('the box latches its own threshold', status=THRESHOLD, trip=OVERLOAD),
    'no_number': Fault('one axis of the force sensor is NaN (Bota)', lie=no_number, sensor='bota', trip=SENSOR),
}
