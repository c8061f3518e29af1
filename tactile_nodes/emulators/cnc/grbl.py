"""A Grbl 1.1h or grblHAL controller, as a host on its serial line sees it.

The sequences of responses were observed on the original firmware, compiled for a PC. Left out, because no driver asks
for it: arcs, probing, work coordinates, spindle, program stops, resuming, overrides, safety door, check mode, sleep,
startup blocks, reports of modes and offsets, modal state, unlocking, changing settings. Left out besides: limit pins,
hard limits (raise alarm 1 with `alarm`), step rounding. Blocks start and end at rest (see `motion`).
"""

from __future__ import annotations

from collections.abc import Generator

from tactile_nodes.clock import Clock
from tactile_nodes.emulators.cnc import grbl_commands as commands
from tactile_nodes.emulators.cnc.grbl_code import MM_PER_INCH, GrblError
from tactile_nodes.emulators.cnc.grbl_dialect import GrblSettings
from tactile_nodes.emulators.cnc.grbl_machine import GrblMachine
from tactile_nodes.emulators.motion import Vector
from tactile_nodes.emulators.serial_device import Program, SerialDevice, Wait
from tactile_nodes.emulators.world import World


class SlowFields:
    """The fields of a status report that come only with every tenth to thirtieth."""

    def __init__(self) -> None:
        self._until_offset = 0
        self._until_overrides = 0

    def next(self, busy: bool, coolant: bool, inches: bool) -> list[str]:
        """Those of the next report."""
        fields = []
        if self._until_offset > 0:
            self._until_offset -= 1
        else:
            self._until_offset = 29 if busy else 9
            self._until_overrides = self._until_overrides or 1  # not both in one report
            fields.append(f'WCO:{coordinates((0.0, 0.0, 0.0), inches)}')
        if self._until_overrides > 0:
            self._until_overrides -= 1
        else:
            self._until_overrides = 19 if busy else 9
            fields.append('Ov:100,100,100')
            fields += ['A:F'] if coolant else []
        return fields


def coordinates(place_mm: Vector, inches: bool) -> str:
    """Three numbers as Grbl prints them: 0.6 mm is 0.0236 in inches."""
    if inches:
        return ','.join(f'{value / MM_PER_INCH:.4f}' for value in place_mm)
    return ','.join(f'{value:.3f}' for value in place_mm)


LINE_LIMIT = 79
RESET, JOG_CANCEL = 0x18, 0x85


class Grbl(SerialDevice):
    """One controller with its machine in a world."""

    def __init__(self, world: World, clock: Clock, settings: GrblSettings | None = None) -> None:
        self._settings = settings or GrblSettings()
        super().__init__(clock, self._settings.baud)
        self.machine: GrblMachine = GrblMachine(world, self._settings, self.now_ns)
        self.dialect = self.machine.dialect
        self.overflowed = 0
        self._received = bytearray()
        self._wake_ns: int | None = None
        self.alarm_lock = self.machine.flag(22)
        self._boot()

    # Actions of tests and demonstrations.

    def power_cycle(self) -> None:
        """Restart: the machine stops at once, and its position becomes machine zero."""
        with self._lock:
            self.machine.planner.flush(self.now_ns)
            self.machine.origin = self.machine.world.motor_at(self.now_ns)
            self.machine.world.set_line(False, self.now_ns)
            self.faults.hung = False
            self.alarm_lock = self.machine.flag(22)
            self._boot()

    def alarm(self, number: int) -> None:
        """Raise an alarm, which stops the machine at once; 1 is a limit switch that was hit."""
        with self._lock:
            self.run()
            self.machine.planner.flush(self.now_ns)
            self._start_program(commands.critical(self, number))
            self._step()

    # State, used by the commands.

    @property
    def world(self) -> World:
        return self.machine.world

    def tell(self, text: str) -> None:
        self.say(text.encode('ascii') + b'\r\n')

    def answer(self, error: int = 0) -> None:
        """Send the response to a line: ``ok``, or an error."""
        if error:
            self.tell(f'error:{error}')
        elif not self.faults.swallow_ok:
            self.tell('ok')

    def switch_coolant(self, on: bool) -> None:
        self.coolant = on
        self.world.set_line(on, self.now_ns)

    def wait_until_empty(self) -> Program:
        yield lambda: self.machine.planner.used == 0

    def wait_s(self, seconds: float) -> Program:
        self._wake_ns = due_ns = self.now_ns + round(seconds * 1e9)
        yield lambda: self.now_ns >= due_ns
        self._wake_ns = None

    # Lines.

    def _boot(self) -> None:
        self._clear()
        self._start_program(self._main())

    def _clear(self) -> None:
        self._received.clear()
        self.coolant = False
        self._slow_fields = SlowFields()
        self._wake_ns, self._rest_then_idle = None, False
        self.homing, self.critical = False, False
        self.state = 'Alarm' if self.alarm_lock else 'Idle'

    def _main(self) -> Program:
        while True:
            self.say(b'\r\n' + self.dialect.banner.encode('ascii') + b'\r\n')
            if self.state == 'Alarm':
                self.tell("[MSG:'$H'|'$X' to unlock]")
            try:
                while True:
                    line = yield from self.next_line()
                    yield from self._execute(line)
            except commands.Restart:
                self._clear()

    def next_line(self) -> Generator[Wait, None, str]:
        """The next line without spaces and comments, in capitals."""
        line: list[str] = []
        comment = False
        while True:
            yield lambda: bool(self._received)
            character = chr(self._received.pop(0))
            if character in '\r\n':
                return ''.join(line)
            if character in '();':
                comment = character != ')'
            elif not comment and character not in ' /\t':
                line.append(character.upper())

    def _execute(self, line: str) -> Program:
        try:
            if len(line) > LINE_LIMIT:
                raise GrblError(11)
            if line.startswith('$'):
                yield from commands.system(self, line)
            elif line:
                yield from commands.gcode(self, line)
            self.answer()
        except GrblError as error:
            self.answer(error.number)

    # Real-time commands.

    def _byte(self, byte: int) -> None:
        character = chr(byte)
        if character == '?':
            self._report()
        elif byte == RESET:
            self._reset()
        elif character == '!':
            self._hold()
        elif byte == JOG_CANCEL:
            self._cancel_jog()
        elif byte < 0x80:
            self._accept(byte)

    def _accept(self, byte: int) -> None:
        if len(self._received) < self.dialect.receive_bytes:
            self._received.append(byte)
        else:
            self.overflowed += 1

    def _report(self) -> None:
        if self.homing or (self.critical and not self.dialect.answers_in_critical_alarm):
            return
        machine, now_ns = self.machine, self.now_ns
        mask, inches, segment = int(float(machine.memory[10])), machine.inches, machine.planner.segment
        speed = machine.world.motor_speed_at(now_ns)
        if self.state == 'Hold' and segment is not None:
            speed = segment.shape.speed(segment.shape.duration_s / 2)  # the firmware reports the feed before the hold
        blocks_free = machine.planner.capacity - machine.planner.used
        bytes_free = self.dialect.receive_bytes - len(self._received)
        feed = 60 * speed / (MM_PER_INCH if inches else 1)
        fields = [
            self._state_text(),
            f'{"MPos" if mask & 1 else "WPos"}:{coordinates(machine.place(now_ns), inches)}',
            *([f'Bf:{blocks_free},{bytes_free}'] if mask & 2 else []),
            f'FS:{feed:.0f},0',
            *self._slow_fields.next(self.state in {'Run', 'Hold', 'Jog', 'Home'}, self.coolant, inches),
        ]
        self.tell(f'<{"|".join(fields)}>')

    def _state_text(self) -> str:
        if self.state != 'Hold':
            return self.state
        return 'Hold:0' if self.machine.planner.at_rest(self.now_ns) else 'Hold:1'

    def _reset(self) -> None:
        planner = self.machine.planner
        moving = self.state in {'Run', 'Jog', 'Home'} or not planner.at_rest(self.now_ns)
        if self.critical and not self.dialect.answers_in_critical_alarm:
            self.answer()  # the late response to the line that hit the limit
        if moving:
            self.tell('ALARM:6' if self.homing else 'ALARM:3')
        planner.flush(self.now_ns)
        self.world.set_line(False, self.now_ns)
        self.alarm_lock = moving or self.state == 'Alarm'
        self._boot()

    def _hold(self) -> None:
        if self.state == 'Jog':
            self._cancel_jog()
        elif self.state in {'Run', 'Idle'}:
            self.state = 'Hold'
            self.machine.planner.hold(self.now_ns)

    def _cancel_jog(self) -> None:
        if self.state == 'Jog':
            self.machine.planner.hold(self.now_ns)
            self.machine.planner.drop_queue()
            self._rest_then_idle = True

    # Events in time.

    def _progress(self) -> None:
        planner = self.machine.planner
        if self._rest_then_idle and planner.at_rest(self.now_ns):
            planner.flush(self.now_ns)
            self._rest_then_idle = False
        planner.step(self.now_ns)
        if self.state in {'Run', 'Jog'} and planner.used == 0:
            self.state = 'Idle'

    def _own_events_ns(self) -> list[int]:
        times = (self.machine.planner.next_event_ns(self.now_ns), self._wake_ns)
        return [time for time in times if time is not None]
