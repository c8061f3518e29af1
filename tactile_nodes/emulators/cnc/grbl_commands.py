"""Executes the lines of Grbl. Each command runs until its response is due, and waits by yielding a condition."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from tactile_nodes.emulators.cnc.grbl_code import GrblError, understand, understand_jog
from tactile_nodes.emulators.cnc.grbl_dialect import axes_of
from tactile_nodes.emulators.motion import Vector, length, plus
from tactile_nodes.emulators.serial_device import Program

if TYPE_CHECKING:
    from tactile_nodes.emulators.cnc.grbl import Grbl

HELP = '[HLP:$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x]'


class Restart(Exception):  # noqa: N818
    """The firmware starts again and keeps its position."""


def gcode(grbl: Grbl, line: str) -> Program:
    """Execute a line of G-code."""
    if grbl.state in {'Alarm', 'Jog'}:
        raise GrblError(9)
    command = understand(line)
    if coolant := command.codes & {'M8', 'M9'}:
        yield from grbl.wait_until_empty()
        grbl.switch_coolant('M8' in coolant)
    if 'G4' in command.codes:
        if 'P' not in command.values:
            raise GrblError(28)
        yield from grbl.wait_until_empty()
        yield from grbl.wait_s(command.values['P'])
    if 'G1' in command.codes:
        feed = command.feed_mm_min
        yield from _travel(grbl, grbl.machine.target(command, grbl.now_ns), feed)


def _travel(grbl: Grbl, target: Vector, feed: float) -> Program:
    machine = grbl.machine
    if machine.beyond_travel(target):
        yield from _soft_limit(grbl)
    yield lambda: machine.planner.used < machine.planner.capacity
    if machine.planner.add(machine.block(target, feed), grbl.now_ns) and grbl.state == 'Idle':
        grbl.state = 'Run'


def _soft_limit(grbl: Grbl) -> Program:
    planner = grbl.machine.planner
    if grbl.state == 'Run':
        grbl.state = 'Hold'
        planner.hold(grbl.now_ns)
        yield lambda: planner.at_rest(grbl.now_ns)
    planner.flush(grbl.now_ns)
    yield from critical(grbl, 2)


def critical(grbl: Grbl, number: int) -> Program:
    """Raise an alarm that only a reset ends. Until then Grbl ignores all lines, and grblHAL refuses them."""
    grbl.critical = True
    grbl.state = 'Alarm'
    grbl.tell(f'ALARM:{number}')
    grbl.tell('[MSG:Reset to continue]')
    if grbl.dialect.answers_in_critical_alarm:
        grbl.answer()
    while True:
        yield from _refuse_or_wait(grbl)


def _refuse_or_wait(grbl: Grbl) -> Program:
    if not grbl.dialect.answers_in_critical_alarm:
        yield lambda: False
    yield from grbl.next_line()
    grbl.answer(79)


def system(grbl: Grbl, line: str) -> Program:
    """Execute a line that starts with ``$``."""
    if line.startswith('$J='):
        yield from _jog(grbl, line[3:])
    elif line == '$H':
        yield from _home(grbl)
    elif line in _COMMANDS:
        _COMMANDS[line](grbl)
    else:
        raise GrblError(3)


def _jog(grbl: Grbl, text: str) -> Program:
    if grbl.state not in {'Idle', 'Jog'}:
        raise GrblError(79 if grbl.critical else 8)
    machine, planner = grbl.machine, grbl.machine.planner
    command = understand_jog(text)
    feed = command.feed_mm_min
    target = machine.target(command, grbl.now_ns)
    if machine.beyond_travel(target):
        raise GrblError(15)
    yield lambda: planner.used < planner.capacity
    if planner.add(machine.block(target, feed), grbl.now_ns):
        grbl.state = 'Jog'


def _home(grbl: Grbl) -> Program:
    machine = grbl.machine
    if not machine.flag(22):
        raise GrblError(5)
    if grbl.state not in {'Idle', 'Alarm'}:
        raise GrblError(8)
    grbl.state, grbl.homing = 'Home', True
    switch, sign = _switches(grbl)
    fast, back = float(machine.memory[25]), float(machine.memory[27])
    for axes in ((2,), (0, 1)):
        yield from _seek(grbl, {axis: switch[axis] for axis in axes}, fast)
    if length(plus(grbl.world.tip_at(grbl.now_ns), switch, -1.0)) > 0.01:
        grbl.homing, grbl.alarm_lock = False, True
        grbl.tell('ALARM:9')
        grbl.answer()
        raise Restart
    off = plus(switch, sign, -back)
    yield from _seek(grbl, dict(enumerate(off)), fast)
    travel = axes_of(machine.memory, 130)
    x, y, z = (-back if up > 0 else back - most for up, most in zip(sign, travel, strict=True))
    machine.origin = plus(grbl.world.motor_at(grbl.now_ns), (x, y, z), -1.0)
    grbl.state, grbl.homing, grbl.alarm_lock = 'Idle', False, False


def _switches(grbl: Grbl) -> tuple[Vector, Vector]:
    """Positions of the end switches in the world, and the end of each axis where they are (1: upper, -1: lower)."""
    mask, room = int(float(grbl.machine.memory[23])), grbl.world.settings.room_mm
    x, y, z = (-1.0 if mask & (1 << axis) else 1.0 for axis in range(3))
    ends = [0.0 if sign > 0 else -size for sign, size in zip((x, y, z), room, strict=True)]
    return (ends[0], ends[1], ends[2]), (x, y, z)


def _seek(grbl: Grbl, ends: dict[int, float], feed: float) -> Program:
    """Move axes of the tip to positions in the world, even if steps were lost before."""
    tip, motor = grbl.world.tip_at(grbl.now_ns), grbl.world.motor_at(grbl.now_ns)
    x, y, z = (motor[axis] + ends.get(axis, tip[axis]) - tip[axis] for axis in range(3))
    machine = grbl.machine
    machine.planner.add(machine.block(plus((x, y, z), machine.origin, -1.0), feed), grbl.now_ns)
    yield from grbl.wait_until_empty()


def _only_at_rest(grbl: Grbl) -> None:
    if grbl.critical:
        raise GrblError(79)
    if grbl.state not in {'Idle', 'Alarm'}:
        raise GrblError(8)


def _settings(grbl: Grbl) -> None:
    if grbl.state in {'Run', 'Hold'}:
        raise GrblError(8)
    for number, value in grbl.machine.memory.items():
        grbl.tell(f'${number}={value}')


def _identity(grbl: Grbl) -> None:
    _only_at_rest(grbl)
    for row in grbl.dialect.identity:
        grbl.tell(row)


_COMMANDS: dict[str, Callable[[Grbl], None]] = {
    '$': lambda grbl: grbl.tell(HELP),
    '$$': _settings,
    '$I': _identity,
}
