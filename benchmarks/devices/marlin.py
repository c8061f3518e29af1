"""An emulated Marlin 2.1 controller, as seen by a host on its serial line.

It has the commands that an indentation rig uses: G0, G1, G4 (P is milliseconds), G28, G90, G91, M17, M84, M106/M107 as
the digital line, M110, M112, M114, M115, M220, M400, M410; and M92, M201, M203, M204 and M503 as queries. X and Y home
to their lower ends and Z to its upper end, so coordinates run from 0 to the room's size. Moves of under 6 steps are
dropped (MIN_STEPS_PER_SEGMENT). Blocks start and end at rest (see `motion`). M410 stops immediately, as in Marlin; if
it homes, it then halts.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Generator
from dataclasses import dataclass
from functools import partial

from tactile_nodes.clock import Clock
from tactile_nodes.emulators.cnc.planner import Block, Planner
from tactile_nodes.emulators.motion import Vector, plus
from tactile_nodes.emulators.serial_device import Program, SerialDevice, Wait
from tactile_nodes.emulators.world import World
from tactile_nodes.params import parameter

QUEUE, RECEIVE_BYTES, PLANNER_BLOCKS, BUSY_NS = 4, 128, 16, 2_000_000_000
CLEANING_NS = 1_000_000_000  # after a quick stop it processes nothing for this time
STEPS_PER_MM: Vector = (80.0, 80.0, 400.0)
FEWEST_STEPS = 6
BUMP_MM = 5.0  # off a switch, and to it again
AXIS_SETTINGS = 'M92', 'M203', 'M201', 'M204'
BOOT = ('start', 'echo: Last Updated: 2025-11-24 | Author: (none, default config)', 'Marlin 2.1.2.7')
IDENTITY = (
    'FIRMWARE_NAME:Marlin 2.1.2.7 (Nov 24 2025 12:00:00) SOURCE_CODE_URL:github.com/MarlinFirmware/Marlin '
    'PROTOCOL_VERSION:1.0 MACHINE_TYPE:3D Printer EXTRUDER_COUNT:1 UUID:cede2a2f-41a2-4748-9b12-c55c62f367ff'
)


@dataclass(frozen=True)
class MarlinSettings:
    """Build options and settings of this Marlin."""

    baud: int = parameter(115200, 'bits per second', minimum=9600)
    emergency_parser: bool = parameter(True, 'M112 and M410 act when they arrive, not when their turn comes')
    realtime_position: bool = parameter(False, 'M114 R reports where it is (M114_REALTIME); else the R is ignored')
    legacy_position: bool = parameter(False, 'M114 waits for the end of motion (Marlin 1, or M114_LEGACY)')
    tells_settings: bool = parameter(True, 'M503 tells the settings; else it is unknown (DISABLE_M503)')
    rate_mm_s: tuple[float, ...] = parameter((40.0, 40.0, 20.0), 'greatest speed of x, y, z')
    acceleration: tuple[float, ...] = parameter((200.0, 200.0, 200.0), 'of x, y, z in mm/s²')


class Marlin(SerialDevice):
    """One controller, with its machine in a world."""

    def __init__(self, world: World, clock: Clock, settings: MarlinSettings | None = None) -> None:
        self._settings = settings or MarlinSettings()
        super().__init__(clock, self._settings.baud)
        self.world = world
        self._planner = Planner(world, PLANNER_BLOCKS)
        self._origin = world.motor_at(self.now_ns)
        self._partial = bytearray()
        self.overflowed = 0
        self._boot()

    def power_cycle(self) -> None:
        """Restart: the machine stops immediately, and its position becomes zero."""
        with self._lock:
            self._planner.flush(self.now_ns)
            self._origin = self.world.motor_at(self.now_ns)
            self.world.set_line(False, self.now_ns)
            self.faults.hung = False
            self._boot()

    def _boot(self) -> None:
        self._waiting: deque[str] = deque()
        self._queue: deque[str] = deque()
        self._partial.clear()
        self._last_line = 0
        self._relative, self._homed, self._feed_mm_s = False, False, 20.0
        self._killed = self._homing = False
        self._way_stopped = False  # the way to a switch or off it
        self._stop_waits = False  # a quick stop that acts when the one before it is over
        self._dropped: Vector | None = None  # target of a move that was too short
        self._cleaning_ns = self._busy_ns = 0
        self._wake_ns: int | None = None
        self._start_program(self._main())

    def tell(self, text: str) -> None:
        """Send a line to the host."""
        self.say(text.encode('ascii') + b'\n')

    def answer(self) -> None:
        """Report that a line was processed, which does not mean that it was understood."""
        if not self.faults.swallow_ok:
            self.tell('ok')

    # The line.

    def _byte(self, byte: int) -> None:
        if self._killed:
            return
        if byte not in b'\r\n':
            self._partial.append(byte)
            return
        line, self._partial = self._partial.decode('ascii', 'replace').strip(), bytearray()
        command = re.sub(r'^N\d+\s*|\*.*$', '', line).strip()
        if self._settings.emergency_parser and command in {'M112', 'M410'}:
            self._kill() if command == 'M112' else self._quick_stop()
        if line and not self._killed:
            self._keep(line)

    def _keep(self, line: str) -> None:
        if sum(len(each) + 1 for each in self._waiting) + len(line) < RECEIVE_BYTES:
            self._waiting.append(line)
            self._take_in()
        else:
            self.overflowed += len(line) + 1

    def _take_in(self) -> None:
        """Numbers and checksums are checked as lines enter the queue, not when they are executed."""
        while self._waiting and len(self._queue) < QUEUE:
            if command := self._accepted(self._waiting.popleft()):
                self._queue.append(command)

    def _main(self) -> Program:
        for row in BOOT:
            self.tell(row)
        while True:
            yield lambda: bool(self._queue)
            command = self._queue.popleft()
            self._busy_ns = self.now_ns + BUSY_NS
            yield from self._clean()
            yield from self._execute(command)
            self.answer()
            self._take_in()

    def _accepted(self, line: str) -> str:
        """The command in a line, without number and checksum. If these are wrong, request a resend; returns ''."""
        line = line.split(';', maxsplit=1)[0].strip()
        match = re.fullmatch(r'N(\d+)\s*(.*?)(?:\*(\d+))?', line)
        if match is None:
            return line
        number, command, checksum = int(match.group(1)), match.group(2).strip(), match.group(3)
        if checksum is None:
            return self._refuse('No Checksum with line number')
        if int(checksum) != xor(line[: line.rindex('*')]):
            return self._refuse('checksum mismatch')
        if command.startswith('M110'):
            given = re.search(r'N(\d+)', command[4:])
            number = int(given.group(1)) if given else number
        elif number != self._last_line + 1:
            return self._refuse('Line Number is not Last Line Number+1')
        self._last_line = number
        return command

    def _refuse(self, why: str) -> str:
        self.tell(f'Error:{why}, Last Line: {self._last_line}')
        self.tell(f'Resend: {self._last_line + 1}')
        self.answer()
        return ''

    def _execute(self, command: str) -> Program:
        code, rest = re.fullmatch(r'([A-Z]\d*(?:\.\d+)?|)(.*)', command).groups()  # type: ignore[union-attr]
        words = {match[0]: float(match[1] or 0) for match in re.findall(r'([A-Z])\s*([-+]?\d*\.?\d+)?', rest)}
        handler = _HANDLERS.get(code)
        if handler is None:
            self.tell(f'echo:Unknown command: "{command}"')
        else:
            yield from handler(self, words)

    # Commands.

    def _number_lines(self, words: dict[str, float]) -> Program:
        """Sets the number of the last line once more, when it is executed: lines received meanwhile count no more."""
        self._last_line = int(words.get('N', self._last_line))
        yield from ()

    def _travel(self, words: dict[str, float]) -> Program:
        self._feed_mm_s = words['F'] / 60 if 'F' in words else self._feed_mm_s
        start = list(self._place_planned())
        for axis, letter in enumerate('XYZ'):
            if letter in words:
                start[axis] = words[letter] + (start[axis] if self._relative else 0.0)
        if self._homed:  # soft end stops: a target outside is clipped without a message
            start = [min(max(value, 0.0), size) for value, size in zip(start, self.world.settings.room_mm, strict=True)]
        yield from self._go((start[0], start[1], start[2]), self._feed_mm_s)

    def _go(self, target: Vector, feed_mm_s: float) -> Program:
        yield lambda: self._planner.used < PLANNER_BLOCKS
        steps = plus(target, plus(self._planner.target(self.now_ns), self._origin, -1.0), -1.0)
        short = all(abs(way) * each < FEWEST_STEPS - 0.5 for way, each in zip(steps, STEPS_PER_MM, strict=True))
        self._dropped = target if short else None
        if short:
            return
        rates, acceleration = (_vector(each) for each in (self._settings.rate_mm_s, self._settings.acceleration))
        self._planner.add(Block(plus(target, self._origin), feed_mm_s, rates, acceleration), self.now_ns)

    def _dwell(self, words: dict[str, float]) -> Program:
        yield from self._finish({})
        due_ns = self.now_ns + round(words.get('S', 0.0) * 1e9 + words.get('P', 0.0) * 1e6)
        yield from self._busy_until(lambda: self.now_ns >= due_ns, due_ns)

    def _finish(self, words: dict[str, float]) -> Program:  # noqa: ARG002
        yield from self._busy_until(lambda: self._planner.used == 0, None)

    def _busy_until(self, done: Wait, due_ns: int | None) -> Generator[Wait, None, None]:
        """Wait, with a busy message every two seconds of the command."""
        while not done():
            self._wake_ns = self._busy_ns if due_ns is None else min(self._busy_ns, due_ns)
            yield self._done_or_past(done, self._wake_ns)
            if self.now_ns >= self._busy_ns and not done():
                self.tell('echo:busy: processing')
                self._busy_ns += BUSY_NS
        self._wake_ns = None

    def _clean(self) -> Program:
        """Wait until a quick stop is over; another one may come meanwhile."""
        while (due_ns := self._cleaning_ns) > self.now_ns:
            yield from self._busy_until(partial(self._is_past, due_ns), due_ns)

    def _is_past(self, time_ns: int) -> bool:
        return self.now_ns >= time_ns

    def _done_or_past(self, done: Wait, time_ns: int) -> Wait:
        return lambda: done() or self.now_ns >= time_ns

    def _home(self, words: dict[str, float]) -> Program:  # noqa: ARG002
        yield from self._finish({})
        room, self._homing = self.world.settings.room_mm, True
        for axis, end, back in ((2, 0.0, -BUMP_MM), (0, -room[0], BUMP_MM), (1, -room[1], BUMP_MM)):
            for off in (0.0, back, 0.0):
                yield from self._home_one_way(axis, end + off, to_switch=not off)
        self._homing = False
        at_home = (0.0, 0.0, room[2])
        self._origin = plus(self.world.motor_at(self.now_ns), at_home, -1.0)
        self._homed = True
        yield from self._position({})

    def _home_one_way(self, axis: int, end: float, to_switch: bool) -> Program:
        """A way to a switch, or off it. A quick stop ends the way; only one to a switch then fails, and halts it."""
        tip, motor = self.world.tip_at(self.now_ns), self.world.motor_at(self.now_ns)
        x, y, z = (motor[each] + (end - tip[each] if each == axis else 0.0) for each in range(3))
        yield from self._go(plus((x, y, z), self._origin, -1.0), 25.0)
        self._way_stopped = False
        if self._stop_waits:
            self._quick_stop()
        yield from self._finish({})
        yield from self._clean()
        if self._way_stopped and to_switch:  # VALIDATE_HOMING_ENDSTOPS, on by default
            self.tell('echo:Homing Failed')
            self._kill()
            yield from _silence()

    def _position(self, words: dict[str, float]) -> Program:
        realtime = 'R' in words and self._settings.realtime_position
        if self._settings.legacy_position and not realtime:
            yield from self._finish({})
        target, real = self._place_planned(), plus(self.world.motor_at(self.now_ns), self._origin, -1.0)
        place = real if realtime else target
        text = ' '.join(f'{letter}:{value:.2f}' for letter, value in zip('XYZ', place, strict=True))
        counts = ' '.join(f'{a}:{v * s:.0f}' for a, v, s in zip('XYZ', real, STEPS_PER_MM, strict=True))
        self.tell(f'{text} E:0.00 Count {counts}')
        yield from ()

    def _identify(self, words: dict[str, float]) -> Program:  # noqa: ARG002
        parser = int(self._settings.emergency_parser)
        self.tell(IDENTITY)
        for row in ('SERIAL_XON_XOFF:0', 'EEPROM:0', 'AUTOREPORT_POS:0', 'Z_PROBE:0', f'EMERGENCY_PARSER:{parser}'):
            self.tell(f'Cap:{row}')
        yield from ()

    def _tell_settings(self, words: dict[str, float]) -> Program:
        if self._settings.tells_settings:
            for code in AXIS_SETTINGS:
                yield from self._tell_setting(code)(self, words)
        else:
            self.tell('echo:Unknown command: "M503"')

    @staticmethod
    def _tell_setting(code: str) -> Handler:
        """The answer of Marlin 2.1 to M92, M201, M203 and M204 without values."""

        def tell(marlin: Marlin) -> None:
            rows = {'M92': STEPS_PER_MM, 'M201': marlin._settings.acceleration, 'M203': marlin._settings.rate_mm_s}
            axes = ' '.join(f'{axis}{each:.2f}' for axis, each in zip('XYZ', rows.get(code, ()), strict=code in rows))
            marlin.tell(f'  {code} {axes} E25.00' if axes else '  M204 P3000.00 R3000.00 T3000.00')

        return _at_once(tell)

    def _set_line(self, level: bool) -> None:
        self.world.set_line(level, self.now_ns)

    def _set_relative(self, relative: bool) -> None:
        self._relative = relative

    def _quick_stop(self) -> None:
        self._stop_waits = self._homing and self._way_stopped
        if self._stop_waits:
            return
        self._way_stopped = True
        self._dropped = None
        self._planner.flush(self.now_ns)
        self._cleaning_ns = self.now_ns + CLEANING_NS

    def _stop_in_turn(self, words: dict[str, float]) -> Program:  # noqa: ARG002
        if not self._settings.emergency_parser:
            self._quick_stop()
        yield from self._clean()

    def _kill(self) -> None:
        self._planner.flush(self.now_ns)
        self._killed = True
        self.tell('Error:Printer halted. kill() called!')
        self._start_program(_silence())

    def _place_planned(self) -> Vector:
        if self._dropped is not None:
            return self._dropped
        return plus(self._planner.target(self.now_ns), self._origin, -1.0)

    # Time.

    def _progress(self) -> None:
        self._planner.step(self.now_ns)

    def _own_events_ns(self) -> list[int]:
        times = (self._planner.next_event_ns(self.now_ns), self._wake_ns)
        return [time for time in times if time is not None]


def xor(text: str) -> int:
    """Marlin's checksum: the exclusive or of all characters before the asterisk."""
    value = 0
    for byte in text.encode('ascii'):
        value ^= byte
    return value


def _silence() -> Program:
    while True:
        yield lambda: False


Handler = Callable[[Marlin, dict[str, float]], Program]


def _at_once(action: Callable[[Marlin], None]) -> Handler:
    def run(marlin: Marlin, words: dict[str, float]) -> Program:  # noqa: ARG001
        action(marlin)
        yield from ()

    return run


def _vector(values: tuple[float, ...]) -> Vector:
    x, y, z = values
    return (x, y, z)


def _ignore(marlin: Marlin) -> None:
    """For commands without effect here: millimetres, 100 % feed, motors on."""


_HANDLERS: dict[str, Handler] = {
    'G0': Marlin._travel,
    'G1': Marlin._travel,
    'G4': Marlin._dwell,
    'G21': _at_once(_ignore),
    'G28': Marlin._home,
    'G90': _at_once(lambda marlin: marlin._set_relative(False)),
    'G91': _at_once(lambda marlin: marlin._set_relative(True)),
    'M17': _at_once(_ignore),
    'M84': _at_once(_ignore),
    'M106': _at_once(lambda marlin: marlin._set_line(True)),
    **{code: Marlin._tell_setting(code) for code in AXIS_SETTINGS},
    'M107': _at_once(lambda marlin: marlin._set_line(False)),
    'M110': Marlin._number_lines,
    'M112': _at_once(lambda marlin: marlin._kill()),
    'M114': Marlin._position,
    'M115': Marlin._identify,
    'M400': Marlin._finish,
    'M220': _at_once(_ignore),
    'M410': Marlin._stop_in_turn,
    'M503': Marlin._tell_settings,
}
