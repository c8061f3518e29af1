"""Marlin over a serial line: 3D printers as rigs (docs/cnc.md).

It processes one line after another, and ``M400`` blocks it until it is at rest. So `wait_idle` sends ``M400`` only when
the motion can be over, and `status` is answered meanwhile. ``M410`` stops at once only with the emergency parser;
without, jogs are limited to 0.05 mm. Marlin silently drops a move of fewer than 6 steps of every axis, so such a jog is
refused, or left out if it is no longer than the error with which a target counts as reached.
"""

from __future__ import annotations

import contextlib
import math
import re
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

from tactile_nodes.clock import NS_PER_S
from tactile_nodes.drivers.cnc.contract import (
    BLIND_STEP_MM,
    NO_HOMING,
    OTHER_FIRMWARE,
    CncState,
    CncStatus,
    Identity,
    Place,
    Switched,
)
from tactile_nodes.drivers.cnc.dead_man import ALONE_S, ALONE_TIMES
from tactile_nodes.drivers.cnc.envelope import AXES, describe_place, guard, way_between
from tactile_nodes.drivers.cnc.guarded import ARRIVED_MM, UNKNOWN_ACCELERATION
from tactile_nodes.drivers.cnc.marlin_dialogue import AT_ONCE, IDENTITY, PLACE, STOP, STOP_S, MarlinDialogue
from tactile_nodes.drivers.cnc.motion import Motion, Verdict
from tactile_nodes.drivers.cnc.serial_line import SerialCnc
from tactile_nodes.drivers.health import Health, Level
from tactile_nodes.errors import ConfigurationError, DeviceFaultError, DeviceTimeoutError

NUMBER = r'-?\d{1,6}(?:\.\d*)?'
QUESTIONS = ('M503', 'M92', 'M203', 'M201', 'M204')  # the first if supported, else the others


@dataclass(frozen=True)
class AxisSettings:
    """Settings of x, y and z as reported (marlinfw.org/docs/gcode/M503); None: not reported.

    ``M503`` reports all of them, in the same format in Marlin 1 and 2, with or without ``echo:``. A Marlin compiled
    with DISABLE_M503 reports them one by one since 2.0.9, and before that not at all.

    Attributes:
        steps_per_mm: of each (M92).
        speeds: the largest of each, in mm/s (M203). The axis does not go faster, whatever feed is commanded.
        acceleration: of the slowest axis, for moves with and without extrusion, in mm/s² (M201, M204).
    """

    steps_per_mm: Place | None = None
    speeds: Place | None = None
    acceleration: float | None = None

    @property
    def tells_times(self) -> bool:
        """Whether the duration of a move is known."""
        return self.speeds is not None and self.acceleration is not None

    def steps(self, way: Place) -> int | None:
        """Steps of the axis with the most on a way; None: unknown."""
        if self.steps_per_mm is None:
            return None
        return max(round(abs(mm) * each) for mm, each in zip(way, self.steps_per_mm, strict=True))


def axis_settings(lines: list[str]) -> AxisSettings:
    """From the responses to `QUESTIONS`; empty if there are none."""
    most = _axes('M201', lines)
    match = next((found for line in lines if (found := re.search(rf'M204 P({NUMBER}).* T({NUMBER})', line))), None)
    accelerations = [*(most or ()), *((float(each) for each in match.groups()) if match else ())]
    slowest = min(accelerations) if most and match else 0.0
    return AxisSettings(_axes('M92', lines), _axes('M203', lines), slowest or None)


def _axes(code: str, lines: list[str]) -> Place | None:
    """X, Y, Z in ``M92 X80.00 Y80.00 Z400.00 E500.00``; None: not reported, or one is zero."""
    found = (re.search(rf'{code} X({NUMBER}) Y({NUMBER}) Z({NUMBER})', line) for line in lines)
    match = next((each for each in found if each is not None), None)
    if match is None:
        return None
    x, y, z = (float(each) for each in match.groups())
    return (x, y, z) if min(x, y, z) > 0 else None


PREAMBLE = ('G21', 'G90', 'M220 S100', 'M84 S0')  # the last two: no feed override; never release the motors
FEWEST_STEPS = 6  # of the axis with the most: default of MIN_STEPS_PER_SEGMENT
ROUNDED_MM = 0.005  # positions are reported to 0.01 mm
FEWEST_BLOCKS = 8  # any planner of Marlin holds this many: the response to a further move may wait until one is done
BEFORE_FIRST_NS = 100_000_000  # delay before the first move: BLOCK_DELAY_FOR_1ST_MOVE


class MarlinCnc(SerialCnc[MarlinDialogue]):
    """One controller; the arguments are those of `SerialCnc`."""

    _axes = AxisSettings()
    _ends: deque[int]  # end times of the moves since the last rest that are not done yet

    @property
    def description(self) -> Mapping[str, str]:
        """Firmware and capabilities."""
        kind = f'CNC, {self._identity.firmware} {self._identity.version}'
        return {'source': self._settings.source, 'kind': kind, 'options': ' '.join(self._identity.options)}

    @property
    def blind_step_mm(self) -> float | None:
        """As `Cnc.blind_step_mm`: None if there is an emergency parser."""
        return None if 'EMERGENCY_PARSER:1' in self._identity.options else BLIND_STEP_MM

    def connect(self) -> None:
        self.close()
        self._motion = Motion(follows=False)  # most report the target
        self._homed = False
        self._guard = guard(self._settings, None)
        self._dialogue = dialogue = MarlinDialogue(
            self._open_port(),
            self._clock,
            lambda: self._surely_moving,
            1 / self._settings.report_hz,
            self._placed,
            self._place_lost,
            self._traffic,
            self._threaded,
        )
        dialogue.link.wait(lambda: dialogue.starts > 0, self._settings.boot_s)
        try:
            dialogue.begin(self._settings.answer_s)
        except DeviceTimeoutError as error:
            raise DeviceTimeoutError(
                f'no response from {self._name} at {self._settings.baud} baud; check power, cable, baud '
                '(Marlin often uses 250000) and cnc.kind'
            ) from error
        dialogue.connected = True
        self._identity = marlin_identity(dialogue.ask(IDENTITY, self._settings.answer_s).lines)
        self._require_marlin()
        for line in PREAMBLE:
            dialogue.ask(line, self._settings.answer_s)
        self._axes = self._query_settings(dialogue)
        self.deceleration_mm_s2 = self._axes.acceleration or UNKNOWN_ACCELERATION
        self._speeds = self._axes.speeds or self._speeds
        dialogue.polling = True

    def _require_marlin(self) -> None:
        """Refuse other firmware. Klipper says `ok` to a stop that it does not know, and to moves that it refuses."""
        firmware = f'{self._identity.firmware} {self._identity.version}'
        if 'marlin' not in firmware.lower() and OTHER_FIRMWARE not in self._settings.accept:
            raise DeviceFaultError(
                f'{self._name} runs {firmware.strip()}, not Marlin: it may ignore the stop command {STOP}; use a '
                f"machine with Marlin or Grbl, or, if this one stops, add '{OTHER_FIRMWARE}' to the setting accept"
            )

    def jog(self, dx: float = 0.0, dy: float = 0.0, dz: float = 0.0, *, feed: float) -> None:
        """As `Cnc.jog`.

        Raises:
            ConfigurationError: also for a jog that Marlin would drop, if the tip would then be too far from its target.
        """
        steps = self._axes.steps((dx, dy, dz))
        if self.blind_step_mm is None or steps is None or not 0 < steps < FEWEST_STEPS:
            super().jog(dx, dy, dz, feed=feed)
        elif math.hypot(dx, dy, dz) > ARRIVED_MM:
            raise ConfigurationError(
                f'{self._name} would silently drop a jog of {steps} steps, and without an emergency parser a '
                'longer one cannot be stopped; build its firmware with EMERGENCY_PARSER, or use finer microsteps'
            )

    def home(self) -> None:
        """As `Cnc.home`, with the command from the settings."""
        dialogue = self._talk()
        dialogue.require_sound()
        self._homed = False
        if self._settings.home_command:
            dialogue.ask(self._settings.home_command, self._settings.home_s, due_ns=None)
        elif NO_HOMING not in self._settings.accept:
            raise ConfigurationError(
                f'{self._name} has no homing command, as G28 may drive the tip into the gel; set home_command to one '
                'that is safe on this machine'
            )
        dialogue.place_lost, dialogue.answers_in_motion = False, None
        self._homed = True
        self._motion.forget()
        self._rests_at(self.status().position_mm)
        up = f'G90\nG1 Z{self._rules().safe_z_mm:.3f} F{self._settings.retract_mm_min:.1f}\n'.encode('ascii')
        self._keep_watch([(ALONE_S, up)] * ALONE_TIMES)

    def stop(self) -> None:
        """As `Cnc.stop`: M410, which acts at once with the emergency parser, and after the buffers without.

        During homing it halts the controller, which then has to be switched off and on.
        """
        dialogue = self._talk()
        self._stops += 1
        if dialogue.obeys_upwards:
            dialogue.stop(self._settings.home_command if self.blind_step_mm is None else '')
            dialogue.refusal = ''
            dialogue.ask('M400', STOP_S, due_ns=None, up=True)
            dialogue.ask('G90', STOP_S, up=True)
        self._at_rest()
        if self._homed and not dialogue.fault:
            self._after_stop(dialogue)

    def _after_stop(self, dialogue: MarlinDialogue) -> None:
        """Read the position."""
        place = self.status().position_mm
        dialogue.refusal = ''
        if not dialogue.place_lost:
            self._rests_at(place)

    def wait_idle(self) -> None:
        """As `Cnc.wait_idle`: M400, sent when it blocks the controller only briefly."""
        dialogue, stops = self._talk(), self._stops
        self._require_ready()
        patience_s = self._patience_s()
        moving_s = max(0, self._cruising_until_ns - self._clock.now_ns()) / NS_PER_S
        dialogue.link.wait(lambda: bool(dialogue.fault) or stops != self._stops, moving_s)
        dialogue.require_sound()
        if stops == self._stops:
            due_ns = self._busy_until_ns + BEFORE_FIRST_NS if self._axes.tells_times else None
            dialogue.ask('M400', patience_s - moving_s, due_ns)
        if stops != self._stops:
            raise DeviceFaultError(f'{self._name}: the motion was aborted by a stop')
        self._arrived()

    def status(self) -> CncStatus:
        """As `Cnc.status`: M114, again after a doubtful response, which may be damaged."""
        status = self._asked_status()
        return self._asked_status() if status.position_mm == self._motion.doubtful else status

    def _asked_status(self) -> CncStatus:
        dialogue = self._talk()
        request = dialogue.ask(PLACE, self._patience_s())
        place = _place_in(request.lines)
        if place is None:
            raise DeviceFaultError(f'{self._name} did not report its position on M114; check its firmware')
        stamp_ns = (request.sent_ns + request.answered_ns) // 2
        homed = self._homed and not dialogue.place_lost
        return CncStatus(self._state(), place, homed, stamp_ns, (request.answered_ns - request.sent_ns) // 2)

    def _arrived(self) -> None:
        """As for every machine, but accept a remaining way of so few steps that Marlin has dropped the move."""
        target = self._target
        try:
            super()._arrived()
        except DeviceFaultError:
            place = self._target
            if target is None or place is None:
                raise
            x, y, z = (max(0.0, abs(mm) - ROUNDED_MM) for mm in way_between(place, target))
            left = self._axes.steps((x, y, z))
            if left is None or left >= FEWEST_STEPS:
                raise

    def _query_settings(self, dialogue: MarlinDialogue) -> AxisSettings:
        """The reported settings; empty for a Marlin without these queries."""
        lines: list[str] = []
        for question in QUESTIONS:
            with contextlib.suppress(DeviceFaultError):
                lines += dialogue.ask(question, self._settings.answer_s).lines
            if axis_settings(lines).tells_times:
                break
        return axis_settings(lines)

    def _placed(self, lines: list[str], stamp_ns: int) -> None:
        """Compare a reported position with the commanded motion; in the listening thread."""
        dialogue, place = self._dialogue, _place_in(lines)
        if dialogue is None or place is None or dialogue.fault or not self._motion.is_known:
            return
        verdict = self._motion.judge(place, stamp_ns)
        if verdict is Verdict.LOST:
            dialogue.lose_place(
                f'reports {describe_place(place)}, which it cannot have reached, so its position is unknown; check it, '
                'then connect again'
            )
        if verdict in {Verdict.STRAYED, Verdict.LOST}:
            dialogue.brake(f'is at {describe_place(place)}, off the commanded path; check its cable')

    def _state(self) -> CncState:
        if self._dialogue is not None and self._dialogue.killed:
            return CncState.ALARM
        if not self._motion.moving:
            return CncState.IDLE
        return CncState.JOG if self._motion.jogging else CncState.RUN

    def _send_move(self, target: Place, feed: float) -> None:
        words = ' '.join(f'{axis.upper()}{value:.3f}' for axis, value in zip(AXES, target, strict=True))
        self._talk().ask(f'G1 {words} F{feed:.1f}', self._patience_s(), self._taken_ns(), self._generation)

    def _taken_ns(self) -> int | None:
        """Latest time of the response to a move: when it fits into the planner. None: unknown."""
        self._ends.append(self._busy_until_ns)
        if self._axes.tells_times:
            while self._ends[0] + BEFORE_FIRST_NS < self._clock.now_ns():
                self._ends.popleft()
        if len(self._ends) <= FEWEST_BLOCKS:
            return AT_ONCE
        return self._ends[-FEWEST_BLOCKS - 1] + BEFORE_FIRST_NS if self._axes.tells_times else None

    def _send_jog(self, target: Place, feed: float) -> None:
        self._send_move(target, feed)  # absolute, so that G91 cannot remain active after an interruption

    def _send_up(self, distance: float, feed: float) -> None:
        for line in ('G91', f'G1 Z{distance:.3f} F{feed:.1f}', 'G90'):
            self._talk().ask(line, self._patience_s(), up=True)

    def _await_lifted(self, timeout_s: float) -> None:
        self._talk().ask('M400', timeout_s, due_ns=None, up=True)

    def _at_rest(self) -> None:
        super()._at_rest()
        self._ends = deque()

    def _switch(self, level: bool) -> Switched:
        on, off = self._settings.line_on or 'M106 S255', self._settings.line_off or 'M107'
        request = self._talk().ask(on if level else off, self._settings.answer_s)
        return Switched(level, request.sent_ns, request.answered_ns)

    def _go_up(self, distance: float, feed: float) -> None:
        """Move up in one piece: motion up need not be stoppable, so it needs no small steps."""
        self.move(z=self._known_place()[2] + distance, feed=feed)

    def _health_of(self, dialogue: MarlinDialogue) -> Health:  # noqa: ARG002
        state = self._state().value
        return Health(Level.OK, state) if self._homed else Health(Level.WARN, f'{state}, not homed')


def marlin_identity(lines: list[str]) -> Identity:
    """The answer to M115: firmware, and capabilities like ``EMERGENCY_PARSER:1``."""
    text = next((line for line in lines if line.startswith('FIRMWARE_NAME:')), '')
    match = re.match(r'FIRMWARE_NAME:\s*(\S.*?)\s+(?:FIRMWARE_VERSION:)?(\S+)(?= \(| [A-Z_]+:|$)', text)
    name, version = match.groups() if match else (text.partition(':')[2].strip() or 'Marlin', '')
    return Identity(name, version, tuple(line[4:] for line in lines if line.startswith('Cap:')))


def _place_in(lines: list[str]) -> Place | None:
    return next((found for line in lines if (found := marlin_place(line)) is not None), None)


def marlin_place(line: str) -> Place | None:
    """The position in ``X:10.00 Y:0.00 Z:60.00 E:0.00 Count X:0 Y:0 Z:24000``; None: another line."""
    match = re.match(rf'X:\s*({NUMBER}) Y:\s*({NUMBER}) Z:\s*({NUMBER})(?![\d.])', line)
    return (float(match.group(1)), float(match.group(2)), float(match.group(3))) if match else None
