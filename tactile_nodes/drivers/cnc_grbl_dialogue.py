"""The dialogue with Grbl: which answer belongs to which line, reports, alarms, restarts."""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable

from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.drivers.cnc import CncSettings, CncState, Place, Traffic
from tactile_nodes.drivers.cnc_grbl_words import (
    BANNER,
    HOMING_REQUIRED,
    KEEPS_PLACE,
    MM_PER_INCH,
    NEEDS_RESET,
    Report,
    alarm_text,
    error_text,
    number_of,
    parse_report,
)
from tactile_nodes.drivers.cnc_link import Link, Request
from tactile_nodes.drivers.serial_port import Port
from tactile_nodes.errors import ConfigurationError, DeviceError, DeviceFaultError, DeviceTimeoutError

RESET, JOG_CANCEL, HOLD, RESUME, REPORT = b'\x18', b'\x85', b'!', b'~', b'?'
LINE_LIMIT = 79
SILENT_S = 0.5
REALTIME = frozenset('?!~')


class GrblDialogue:
    """Everything that is said, and what it means for who waits. Nothing here decides to move anything."""

    def __init__(
        self, port: Port, clock: Clock, settings: CncSettings, traffic: Traffic | None = None, threaded: bool = True
    ) -> None:
        self._clock = clock
        self._settings = settings
        self._unanswered: deque[Request] = deque()
        self._restart_expected = True
        self._asked_ns = self._owed_ns = 0
        self._asked_open = False
        self._offset: Place | None = None
        self.name = port.name
        self.window = 0  # bytes that may be unanswered; 0: one line
        self.factor = 1.0  # mm in a unit of the reports
        self.banner = ''
        self.restarts = 0
        self.garbled = 0
        self.homing = False
        self.polling = False
        self.alarm: int | None = None
        self.fault = ''  # until a person homes it
        self.refusal = ''  # until it is stopped
        self._generation = 0
        self.place_lost = False
        self.report: Report | None = None
        self.report_ns = self.uncertainty_ns = 0
        self.link = Link(port, clock, self._hear, self._idle, traffic, threaded)
        self.link.start()

    @property
    def position(self) -> Place | None:
        """Machine coordinates in the last report."""
        report = self.report
        if report is None:
            return None
        if report.machine is not None or report.work is None or self._offset is None:
            return report.machine
        work, offset = report.work, self._offset
        return (work[0] + offset[0], work[1] + offset[1], work[2] + offset[2])

    @property
    def busy(self) -> bool:
        """Whether lines are unanswered."""
        return bool(self._unanswered)

    @property
    def silent(self) -> bool:
        """Whether it owes a report for longer than it may."""
        owed_s = (self._clock.now_ns() - self._owed_ns) / NS_PER_S
        return self._asked_open and owed_s > SILENT_S and not self.homing

    def ask(self, line: str, timeout_s: float) -> Request:
        """Send a line and wait for its answer.

        Raises:
            DeviceFaultError: it was refused, or an alarm, a stop or a restart came instead.
            DeviceTimeoutError: no answer; the controller hangs.
            DeviceLostError: the port is gone.
        """
        request = self.post(line, timeout_s, awaited=True)
        self._settle(request, timeout_s)
        return request

    def post(self, line: str, timeout_s: float, awaited: bool = False) -> Request:
        """Send a line as soon as the controller's buffer has room for it; do not wait for the answer."""
        _check(line)
        request = Request(line, awaited=awaited)
        with self.link.changed:
            generation = self._generation
            if not self.link.wait(lambda: self._fits(line) or generation != self._generation, timeout_s):
                raise self._hung(line, timeout_s)
            if generation != self._generation:
                raise DeviceFaultError(f'{self.name}: {line!r} was not sent, because the motion was broken off')
            self._unanswered.append(request)
            request.sent_ns = self.link.send(line.encode('ascii') + b'\n')
        return request

    def reset(self, timeout_s: float) -> None:
        """A soft reset; returns after the banner, or, as FluidNC's can be anything, with the next sign of life.

        Raises:
            DeviceTimeoutError: neither came.
        """
        with self.link.changed:
            before = self.restarts
            self._restart_expected = True
            self.link.send(RESET)
            if self.link.wait(lambda: self.restarts > before, timeout_s):
                return
            self._asked_open = False
            self._request_report()
            if not self.link.wait(lambda: not self._asked_open, SILENT_S):
                raise self._hung('the reset', timeout_s)
            self._restarted(self.banner)

    def fresh_report(self, timeout_s: float) -> Report:
        """A report that was asked for after this call began.

        Raises:
            DeviceTimeoutError: none came.
        """
        with self.link.changed:
            self.link.wait(lambda: not self._asked_open, SILENT_S)  # what is under way tells of the past
            self._request_report()
            if not self.link.wait(lambda: not self._asked_open, timeout_s):
                raise DeviceTimeoutError(
                    f'{self.name} reports no position within {timeout_s:g} s; cut its power and start again'
                )
            assert self.report is not None
            return self.report

    def poll_until(self, done: Callable[[Report], bool], timeout_s: float, every_s: float = 0.05) -> bool:
        """Ask for reports until one satisfies; False: none did."""
        deadline_ns = self._clock.now_ns() + round(timeout_s * NS_PER_S)
        while self.alarm is None and self._clock.now_ns() < deadline_ns:
            with contextlib.suppress(DeviceTimeoutError):  # an answer that was lost; the deadline decides
                if done(self.fresh_report(SILENT_S)):
                    return True
            self.link.wait(lambda: self.alarm is not None, every_s)
        return False

    def abandon(self, why: str) -> None:
        """Whoever waits for an answer shall not wait on."""
        with self.link.changed:
            self._generation += 1
            for request in self._unanswered:
                request.error = request.error or DeviceFaultError(f'{self.name}: {request.text!r} {why}')
            self.link.changed.notify_all()

    def homing_over(self) -> None:
        """A report that was asked for before it homed is not late: while it homes it answers none."""
        with self.link.changed:
            self.homing, self._owed_ns = False, self._clock.now_ns()

    def require_sound(self) -> None:
        """Raise what is wrong, if something is."""
        if wrong := self.fault or self.refusal:
            raise DeviceFaultError(f'{self.name} {wrong}')

    def forgive(self) -> None:
        """A person has asked to begin anew: forget alarm and fault."""
        with self.link.changed:
            self.fault, self.refusal, self.alarm = '', '', None

    def close(self) -> None:
        """Let go of the port."""
        self.abandon('was given up because the port was closed')
        self.link.close()

    def _settle(self, request: Request, timeout_s: float) -> None:
        if not self.link.wait(lambda: request.done, timeout_s):
            raise self._hung(request.text, timeout_s)
        if request.error is not None:
            raise request.error

    def _hung(self, line: str, timeout_s: float) -> DeviceError:
        self.fault = 'stopped answering, so its place is not known; cut its power, look at it, and connect again'
        self.place_lost = True
        return DeviceTimeoutError(
            f'{self.name} did not answer {line!r} within {timeout_s:.1f} s; it hangs: cut its power and connect again'
        )

    def _fits(self, line: str) -> bool:
        if not self._unanswered:
            return True
        flying = sum(len(request.text) + 1 for request in self._unanswered)
        return flying + len(line) + 1 <= self.window

    # Listening; all under the link's lock.

    def _hear(self, line: str, stamp_ns: int) -> None:
        if line == 'ok' or line.startswith('error:'):
            self._answered(line, stamp_ns)
        elif line.startswith('<'):
            self._reported(line, stamp_ns)
        elif line.startswith('ALARM:'):
            self._alarmed(number_of(line))
        elif BANNER.match(line):
            self._restarted(line)
        elif line[0] in '[$':
            if self._unanswered:
                self._unanswered[0].lines.append(line)
        elif line[0] != '>':
            self.garbled += 1

    def _answered(self, line: str, stamp_ns: int) -> None:
        if not self._unanswered:
            return
        request = self._unanswered.popleft()
        request.answered_ns = stamp_ns
        if line != 'ok' and request.error is None:
            request.error = DeviceFaultError(f'{self.name} refused {request.text!r}: {error_text(line)}')
            if not request.awaited:  # what was sent after it would run on without it
                self.refusal = f'refused {request.text!r}: {error_text(line)}; stop it, then look at the plan'
                self.link.send(HOLD)
                self.abandon('was broken off because an earlier line was refused')

    def _reported(self, line: str, stamp_ns: int) -> None:
        report = parse_report(line, self.factor)
        if report is None:
            self.garbled += 1
            return
        self._offset = report.offset or self._offset
        self.report, self._asked_open = report, False
        self.uncertainty_ns = max(0, stamp_ns - self._asked_ns) // 2
        self.report_ns = stamp_ns - self.uncertainty_ns

    def _alarmed(self, number: int) -> None:
        if number == HOMING_REQUIRED:  # breaks nothing off: so grblHAL says after a start that it is locked
            return
        self.alarm = number
        self.place_lost = self.place_lost or number not in KEEPS_PLACE
        self.fault = f'is locked by {alarm_text(number)}; look at it, then home it'
        self.abandon(f'was broken off by {alarm_text(number)}')

    def _restarted(self, line: str) -> None:
        self.banner = line
        self.restarts += 1
        if not self._restart_expected:
            self.place_lost = True
            self.fault = 'restarted by itself, so its place is not known; look at its supply, then home it'
        self.abandon('was lost in a restart of the controller')
        self._unanswered.clear()
        self._restart_expected, self._asked_open = False, False

    def _idle(self) -> None:
        now_ns = self._clock.now_ns()
        if self.polling and now_ns - self._asked_ns >= NS_PER_S / self._settings.report_hz and self._may_ask():
            self._request_report()

    def _may_ask(self) -> bool:
        """It answers no report while it homes, nor after a critical alarm; a second question overtakes nothing."""
        owed_s = (self._clock.now_ns() - self._asked_ns) / NS_PER_S
        mute = self.homing or self.alarm in NEEDS_RESET
        return not mute and (not self._asked_open or owed_s > SILENT_S)

    def _request_report(self) -> None:
        self._asked_ns = self.link.send(REPORT)
        if not self._asked_open:
            self._asked_open, self._owed_ns = True, self._asked_ns


def inches(setting: str) -> float:
    """The factor to mm by setting $13."""
    return MM_PER_INCH if setting.strip() not in {'0', ''} else 1.0


def _check(line: str) -> None:
    """Real-time characters act wherever they stand, so no line may hold one.

    Raises:
        ConfigurationError: the line cannot be sent.
    """
    if not line.isascii() or not line.isprintable() or set(line) & REALTIME or len(line) > LINE_LIMIT:
        raise ConfigurationError(
            f'cannot send {line!r} to Grbl: a line is at most {LINE_LIMIT} ASCII characters without ? ! ~'
        )


def is_moving(report: Report) -> bool:
    """Whether a report tells of motion."""
    return report.state in {CncState.RUN, CncState.JOG, CncState.HOME} or report.word == 'Hold:1'
