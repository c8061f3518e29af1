"""Grbl 1.1, grblHAL and FluidNC over a serial line.

Every motion line is absolute, in machine coordinates and complete (``G21 G90 G53 G1 X… F…``), so that no modal state
left by a probe or a reset can change its meaning. After moves, `wait_idle` sends ``G4 P0.01``, whose ``ok`` comes when
the planner is empty; after jogs it waits for a report. `stop` cancels a jog with 0x85; otherwise it holds with ``!``,
waits for rest, and resets with 0x18, which at rest keeps the position. No setting is written; ``$X`` is never sent.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from types import MappingProxyType

from tactile_nodes.clock import NS_PER_S
from tactile_nodes.drivers.cnc.contract import CncState, CncStatus, Place, Switched
from tactile_nodes.drivers.cnc.dead_man import ALONE_S, ALONE_TIMES
from tactile_nodes.drivers.cnc.envelope import AXES, guard
from tactile_nodes.drivers.cnc.grbl_check import (
    acceleration_of,
    check,
    identity_of,
    of_fluidnc,
    speeds_of,
    travel,
    without_homing,
)
from tactile_nodes.drivers.cnc.grbl_dialogue import RESET, GrblDialogue
from tactile_nodes.drivers.cnc.grbl_hearing import HOLD, JOG_CANCEL, SILENT_S
from tactile_nodes.drivers.cnc.grbl_words import NEEDS_RESET, Report, inches, is_moving, setting_of
from tactile_nodes.drivers.cnc.serial_line import SerialCnc
from tactile_nodes.drivers.health import Health, Level
from tactile_nodes.errors import DeviceFaultError, DeviceTimeoutError

PREAMBLE = 'G21 G90 G94 G17 G54'
BARRIER = 'G4 P0.01'
REST_S = 3.0  # time in which any feed comes to rest
RESET_S = 3.0
LONGEST_WAY_S = 10.0
POLL_S = 0.03
OFFSET_S = 0.01


class GrblCnc(SerialCnc[GrblDialogue]):
    """One controller; the arguments are those of `SerialCnc`."""

    _memory: Mapping[int, str] = MappingProxyType({})
    _warnings: tuple[str, ...] = ()

    @property
    def description(self) -> Mapping[str, str]:
        """Firmware, options and all settings of the controller."""
        base = {'source': self._settings.source, 'kind': f'CNC, {self._identity.firmware} {self._identity.version}'}
        settings = {f'${number}': value for number, value in self._memory.items()}
        return {**base, 'options': ' '.join(self._identity.options), 'notes': '; '.join(self._warnings), **settings}

    def connect(self) -> None:
        self.close()
        self._homed = False
        self._dialogue = dialogue = GrblDialogue(
            self._open_port(),
            self._clock,
            self._settings,
            self._motion,
            self._place_lost,
            self._traffic,
            self._threaded,
        )
        self._greet(dialogue)
        dialogue.expect_no_restart()
        restarts = dialogue.restarts
        try:
            self._introduce(dialogue)
        except DeviceFaultError:
            if dialogue.restarts == restarts:
                raise
            dialogue.forgive()  # some boards restart a second time after their port was opened
            self._introduce(dialogue)
        dialogue.polling = True

    def home(self) -> None:
        dialogue = self._talk()
        if dialogue.fault or dialogue.busy:
            dialogue.reset(RESET_S)  # some faults need it, and later responses then belong to later requests
        dialogue.forgive()
        self._at_rest()
        self._motion.forget()
        if not without_homing(self._memory, self._settings):
            self._find_switches(dialogue)
        dialogue.ask(PREAMBLE, self._settings.answer_s)
        dialogue.place_lost, dialogue.polling = False, True
        self._homed = True
        self._rests_at(self.status().position_mm)
        rules = self._rules()
        feed = self.feed_along((0.0, 0.0, 1.0), self._settings.retract_mm_min)
        up = f'$J=G21 G90 G53 Z{rules.safe_z_mm:.3f} F{feed:.1f}\n'.encode('ascii')
        # A hold, the first half of a stop, refuses all jogs until a reset, which keeps the position only at rest: when
        # the tip is up. The next program waits for the port for 20 s.
        way_mm = rules.safe_z_mm - rules.envelope.lowest_mm[2]
        up_s = min(REST_S + 60 * way_mm / feed, LONGEST_WAY_S)
        self._keep_watch([(0.0, JOG_CANCEL), *[(ALONE_S, up)] * ALONE_TIMES, (up_s, RESET), *[(ALONE_S, up)] * 2])

    def stop(self) -> None:
        """As `Cnc.stop`: jog cancel, or hold, rest and reset."""
        dialogue = self._talk()
        self._stops += 1
        dialogue.link.send(JOG_CANCEL if self._motion.jogging else HOLD)  # before anything else
        dialogue.abandon('was aborted by a stop')
        if dialogue.homing:
            dialogue.reset(RESET_S)
        elif dialogue.alarm is None:
            self._come_to_rest(dialogue)
        self._at_rest()
        self._after_stop(dialogue)

    def wait_idle(self) -> None:
        dialogue, stops = self._talk(), self._stops
        self._require_ready()
        patience_s = self._patience_s()
        if self._motion.jogging:
            over = dialogue.poll_until(lambda report: not is_moving(report), patience_s)
            dialogue.require_sound()
            if not over and stops == self._stops:
                raise DeviceTimeoutError(f'{self._name} is still moving after {patience_s:.1f} s; stop it')
        else:
            dialogue.ask(BARRIER, patience_s)
        dialogue.require_sound()
        if stops != self._stops:
            raise DeviceFaultError(f'{self._name}: the motion was aborted by a stop')
        self._arrived()

    def status(self) -> CncStatus:
        dialogue = self._talk()
        report = dialogue.fresh_report(self._settings.answer_s)
        reports = dialogue.reports
        if reports.position is None:  # work coordinates; their offset comes with every tenth or thirtieth report
            dialogue.poll_until(lambda _: reports.position is not None, self._settings.answer_s, OFFSET_S)
            report = reports.last or report
        position = reports.position
        if position is None:
            raise DeviceFaultError(f'{self._name} does not report machine coordinates; set $10=1')
        homed = self._homed and not dialogue.place_lost
        return CncStatus(report.state, position, homed, reports.stamp_ns, reports.uncertainty_ns)

    # Connecting.

    def _greet(self, dialogue: GrblDialogue) -> None:
        """Wait for the banner of a board that restarts when its port is opened, or else check for a response."""
        if not dialogue.link.wait(lambda: dialogue.restarts > 0, self._settings.boot_s):
            try:
                with contextlib.suppress(DeviceFaultError):  # '$' invalidates an incomplete line of another host
                    dialogue.ask('$', self._settings.answer_s)
            except DeviceTimeoutError as error:
                raise DeviceTimeoutError(
                    f'no response from {self._name} at {self._settings.baud} baud; check power, cable, baud, and '
                    'the setting dtr, because some boards are in reset while the port is open'
                ) from error

    def _introduce(self, dialogue: GrblDialogue) -> None:
        """Read identity, state and settings."""
        restarts = dialogue.restarts
        try:
            lines = dialogue.ask('$I', self._settings.answer_s).lines
        except DeviceFaultError:
            if dialogue.restarts == restarts:  # refused: Grbl answers $I only at rest
                self._report_at_rest(dialogue)
            raise
        self._identity = identity_of(lines, dialogue.banner)
        report = self._report_at_rest(dialogue)
        self._read_settings(dialogue)
        if report.state is not CncState.ALARM:
            dialogue.ask(PREAMBLE, self._settings.answer_s)

    def _report_at_rest(self, dialogue: GrblDialogue) -> Report:
        report = dialogue.fresh_report(self._settings.answer_s)
        if report.state not in {CncState.IDLE, CncState.ALARM}:
            raise DeviceFaultError(f'{self._name} is busy ({report.word}); stop it, then connect again')
        return report

    def _read_settings(self, dialogue: GrblDialogue) -> None:
        lines = dialogue.ask('$$', self._settings.answer_s).lines
        self._memory = dict(pair for line in lines if (pair := setting_of(line)) is not None)
        if self._identity.firmware == 'FluidNC':
            self._memory |= of_fluidnc(lambda key: self._value_of(dialogue, key))
        self._warnings = tuple(check(self._name, self._identity, self._memory, self._settings))
        self._guard = guard(self._settings, travel(self._identity, self._memory))
        self.deceleration_mm_s2 = acceleration_of(self._memory, self.deceleration_mm_s2)
        self._speeds = speeds_of(self._memory)
        dialogue.reports.factor = inches(self._memory.get(13, '0'))

    def _value_of(self, dialogue: GrblDialogue, key: str) -> str:
        """Value of a named setting of FluidNC; empty if it has none."""
        try:
            lines = dialogue.ask(key, self._settings.answer_s).lines
        except DeviceFaultError:
            return ''
        return next((line.partition('=')[2] for line in lines if line.startswith(f'{key}=')), '')

    def _find_switches(self, dialogue: GrblDialogue) -> None:
        self._homed, dialogue.homing = False, True
        try:
            dialogue.ask(self._settings.home_command or '$H', self._settings.home_s)
        finally:
            dialogue.homing_over()

    # Motion.

    def _send_move(self, target: Place, feed: float) -> None:
        self._send(f'G21 G90 G53 G1 {_words(target)} F{feed:.1f}')

    def _send_jog(self, target: Place, feed: float) -> None:
        """Jog to a position, not by a distance, so that the next line corrects the error of a damaged one."""
        self._send(f'$J=G21 G90 G53 {_words(target)} F{feed:.1f}')

    def _send_up(self, distance: float, feed: float) -> None:
        self._send(f'$J=G91 G21 Z{distance:.3f} F{feed:.1f}')

    def _send(self, line: str) -> None:
        self._talk().ask(line, self._patience_s(), self._generation)

    def _await_lifted(self, timeout_s: float) -> None:
        self._talk().poll_until(lambda report: not is_moving(report), timeout_s)

    @property
    def _locks_itself(self) -> bool:
        return not without_homing(self._memory, self._settings)

    def _switch(self, level: bool) -> Switched:
        on, off = self._settings.line_on or 'M8', self._settings.line_off or 'M9'
        request = self._talk().ask(on if level else off, self._settings.answer_s)
        return Switched(level, request.sent_ns, request.answered_ns)

    def _come_to_rest(self, dialogue: GrblDialogue) -> None:
        if self._motion.jogging:
            if self._cancel_jog(dialogue):
                return
            dialogue.link.send(HOLD)
        dialogue.poll_until(_resting, REST_S)
        dialogue.reset(RESET_S)  # at rest it keeps the position; otherwise alarm 3 reports the loss

    def _cancel_jog(self, dialogue: GrblDialogue) -> bool:
        """Cancel until it is idle: a jog may still have been in its buffer at the first cancel.

        A silent controller gets no more time than a moving one.
        """
        deadline_ns = self._clock.now_ns() + round(REST_S * NS_PER_S)
        while self._clock.now_ns() < deadline_ns:
            quiet = not dialogue.busy
            with contextlib.suppress(DeviceTimeoutError):
                state = dialogue.fresh_report(SILENT_S).state
                if quiet and state is CncState.IDLE:
                    return True
            if dialogue.alarm is not None:
                return False
            dialogue.link.send(JOG_CANCEL)
            dialogue.link.wait(lambda: dialogue.alarm is not None, POLL_S)
        return False

    def _after_stop(self, dialogue: GrblDialogue) -> None:
        """Read the position, and set the modal state again."""
        if dialogue.alarm in NEEDS_RESET:
            return
        place = self.status().position_mm
        if self._motion.doubted:  # a damaged report, or a lost position
            place = self.status().position_mm
        dialogue.refusal = ''
        if self._homed and not dialogue.place_lost:
            self._rests_at(place)
        report = dialogue.reports.last
        if report is not None and report.state is CncState.ALARM and not dialogue.fault:
            dialogue.lose_place('is locked after a stop; check it, then home it')
        if not dialogue.fault:
            dialogue.ask(PREAMBLE, self._settings.answer_s)
            dialogue.polling = True

    def _health_of(self, dialogue: GrblDialogue) -> Health:
        report = dialogue.reports.last
        state = report.word if report is not None else 'connected'
        where = state if self._homed else f'{state}, not homed'
        return Health(
            Level.WARN if self._warnings or not self._homed else Level.OK, '; '.join([where, *self._warnings])
        )


def _words(target: Place) -> str:
    return ' '.join(f'{axis.upper()}{value:.3f}' for axis, value in zip(AXES, target, strict=True))


def _resting(report: Report) -> bool:
    return report.held or not is_moving(report)
