"""The receiving side of Grbl: responses, reports, alarms, restarts and silence, and their effect on waiting threads."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.drivers.cnc.contract import CncSettings, CncState, Place, Traffic
from tactile_nodes.drivers.cnc.envelope import describe_place
from tactile_nodes.drivers.cnc.grbl_words import (
    BANNER,
    HOMING_REQUIRED,
    NEEDS_RESET,
    Report,
    alarm_text,
    error_text,
    is_moving,
    number_of,
    parse_report,
)
from tactile_nodes.drivers.cnc.link import SILENT_IN_MOTION, Link, Request, Silence
from tactile_nodes.drivers.cnc.motion import Motion, Verdict
from tactile_nodes.drivers.serial_port import Port
from tactile_nodes.errors import DeviceFaultError

MOVING_S = 0.1  # between two requests during motion
SILENT_S = 0.3  # with MOVING_S and the listener's period, silence during motion is detected within 0.5 s


class Reports:
    """Requested and received reports. Used under the link's lock.

    Args:
        ask: sends the request; returns its stamp.
        period_s: between two requests at rest.
    """

    def __init__(self, ask: Callable[[], int], period_s: float) -> None:
        self._ask = ask
        self._period_s = period_s
        self._offset: Place | None = None
        self._owed_ns = 0
        self._silence = Silence()
        self.requested_ns = 0
        self.open = False
        self.factor = 1.0  # mm per unit of the reports
        self.last: Report | None = None
        self.stamp_ns = self.uncertainty_ns = 0

    @property
    def position(self) -> Place | None:
        """Machine coordinates in the last report."""
        report = self.last
        if report is None:
            return None
        if report.machine is not None or report.work is None or self._offset is None:
            return report.machine
        work, offset = report.work, self._offset
        return (work[0] + offset[0], work[1] + offset[1], work[2] + offset[2])

    @property
    def silent(self) -> bool:
        return self.open and self._silence.is_over(SILENT_S)

    def request(self) -> None:
        self.requested_ns = self._ask()
        if not self.open:
            self.open, self._owed_ns = True, self.requested_ns

    def listened(self, now_ns: int) -> None:
        """Note that everything that had arrived by now was read."""
        self._silence.look(self._owed_ns if self.open else None, now_ns)

    def excuse(self, now_ns: int) -> None:
        """Start the time limit of an open request again."""
        self._owed_ns = now_ns

    def is_due(self, now_ns: int, moving: bool) -> bool:
        """Whether a request is due. An open one is repeated only after `SILENT_S`: sooner would not help."""
        since_s = (now_ns - self.requested_ns) / NS_PER_S
        period_s = min(self._period_s, MOVING_S) if moving else self._period_s
        return since_s >= (max(period_s, SILENT_S) if self.open else period_s)

    def take(self, line: str, arrival_ns: int) -> bool:
        """Store a report that has arrived; False: it is damaged."""
        report = parse_report(line, self.factor)
        if report is None:
            return False
        self._offset = report.offset or self._offset
        self.last, self.open = report, False
        self.uncertainty_ns = max(0, arrival_ns - self.requested_ns) // 2
        self.stamp_ns = arrival_ns - self.uncertainty_ns
        return True


JOG_CANCEL, HOLD, REPORT = b'\x85', b'!', b'?'
ECHOED = '?!~\x18\ufffd'
"""Real-time characters, as they appear if everything sent is echoed (0x85 is not ASCII)."""


class GrblHearing:
    """The receiving side. It never starts motion, and only stops it.

    Args:
        port: open.
        clock: the host's.
        settings: interval of status requests.
        motion: expected motion, which reports must agree with.
        on_lost: called when the position is lost, with whether the controller may have restarted or is locked.
        traffic: gets every byte.
        threaded: as of `Link`.
    """

    def __init__(
        self,
        port: Port,
        clock: Clock,
        settings: CncSettings,
        motion: Motion,
        on_lost: Callable[[bool], None],
        traffic: Traffic | None = None,
        threaded: bool = True,
    ) -> None:
        self._clock = clock
        self._motion = motion
        self._on_lost = on_lost
        self._unanswered: deque[Request] = deque()
        self._restart_expected = True
        self._lost_reports = 0
        self.name = port.name
        self.banner = ''
        self.restarts = 0
        self.homing = False
        self.polling = False
        self.alarm: int | None = None
        self.fault = ''  # kept until a person homes it
        self.refusal = ''  # kept until it is stopped
        self.braking = False  # motion has to stop; kept until a new command is sent
        self.generation = 0  # counts events that abort all requests
        self.place_lost = False
        self.obeys_upwards = False  # the fault concerns only the position
        self.reports = Reports(lambda: self.link.send(REPORT), 1 / settings.report_hz)
        self.link = Link(port, clock, self._hear, self._idle, traffic, threaded)
        self.link.start()

    @property
    def busy(self) -> bool:
        return bool(self._unanswered)

    @property
    def silent(self) -> bool:
        return self.reports.silent and not self.homing

    def expect_no_restart(self) -> None:
        """A restart is a fault from now on: boards that restart when the port is opened do so before they respond."""
        with self.link.changed:
            self._restart_expected = False

    def abandon(self, why: str) -> None:
        """End the wait of all threads that wait for a response."""
        with self.link.changed:
            self.generation += 1
            for request in self._unanswered:
                request.error = request.error or DeviceFaultError(f'{self.name}: {request.text!r} {why}')
            self.link.changed.notify_all()

    def homing_over(self) -> None:
        """End homing. A report requested before it is not late, because the controller sends none while it homes."""
        with self.link.changed:
            self.homing = False
            self.reports.excuse(self._clock.now_ns())

    def require_sound(self, up: bool = False) -> None:
        """Raise the current fault, if any; for motion `up`, only one other than an unknown position."""
        if wrong := ('' if up and self.obeys_upwards else self.fault) or self.refusal:
            raise DeviceFaultError(f'{self.name} {wrong}')

    def lose_place(self, fault: str, obeys_upwards: bool = False, restarted: bool = True) -> None:
        """Mark the position of the tip as unknown; not `restarted`: because of missing responses alone."""
        with self.link.changed:
            self.fault, self.place_lost, self.obeys_upwards = fault, True, obeys_upwards
            self._on_lost(restarted)

    def forgive(self) -> None:
        """Clear alarm and fault, because a person has asked to start again."""
        with self.link.changed:
            self.fault, self.refusal, self.alarm = '', '', None

    def close(self) -> None:
        self.abandon('was aborted because the port was closed')
        self.link.close()

    # Receiving; all under the link's lock.

    def _hear(self, line: str, stamp_ns: int) -> None:
        line = line.lstrip(ECHOED)
        if not line or (self._unanswered and line == self._unanswered[0].text):
            return  # an echo
        if line == 'ok' or line.startswith('error:'):
            self._answered(line, stamp_ns)
        elif line.startswith('<'):
            self._reported(line, stamp_ns)
        elif line.startswith('ALARM:'):
            self._alarmed(number_of(line))
        elif line.startswith('[echo:'):
            self._echoed(line[6:-1])
        elif line[0] not in '[$>' and BANNER.search(line):  # noise of a failing power supply may precede it
            self._restarted(line)
        elif line[0] in '[$' and self._unanswered:
            self._unanswered[0].lines.append(line)

    def _answered(self, line: str, stamp_ns: int) -> None:
        if not self._unanswered:
            return
        request = self._unanswered.popleft()
        request.answered_ns = stamp_ns
        if line != 'ok' and request.error is None:
            request.error = DeviceFaultError(f'{self.name} refused {request.text!r}: {error_text(line)}')

    def _echoed(self, echo: str) -> None:
        """Some builds echo each received line without blanks, so it can be compared with the sent line."""
        sent = self._unanswered[0].text if self._unanswered else ''
        if echo.replace(' ', '').upper() != sent.replace(' ', '').upper():
            self._brake(f'received {echo.strip()!r} instead of {sent!r}; check its cable')

    def _reported(self, line: str, stamp_ns: int) -> None:
        if not self.reports.take(line, stamp_ns):
            return
        place, report = self.reports.position, self.reports.last
        if self.braking and report is not None and is_moving(report):
            self._send_brake()  # a command that was in transit during the stop has started motion again
        if place is None or report is None or self.homing or self.fault or not self._motion.is_known:
            return
        if report.state is CncState.ALARM and self.alarm is None:
            self._doubt('is locked although it reported no alarm: it has restarted', obeys_upwards=False)
        else:
            self._judge(place, stamp_ns, report.feed_mm_min)

    def _judge(self, place: Place, stamp_ns: int, feed_mm_min: float) -> None:
        """Compare a report with the commanded motion."""
        verdict = self._motion.judge(place, stamp_ns, feed_mm_min)
        if verdict is Verdict.STRAYED:
            self._brake(f'is at {describe_place(place)}, off the commanded path; check its cable')
        elif verdict is Verdict.HASTY:
            self._brake(f'moves at {feed_mm_min:g} mm/min, faster than commanded; check its cable')
        elif verdict is Verdict.DOUBTFUL:
            self.reports.request()
        elif verdict is Verdict.LOST:
            self._doubt(f'reports {describe_place(place)}, which it cannot have reached', obeys_upwards=True)

    def _doubt(self, why: str, obeys_upwards: bool) -> None:
        self.lose_place(f'{why}, so its position is unknown; check it, then home it', obeys_upwards)
        self._brake('')

    def _brake(self, refusal: str) -> None:
        """Stop motion at once; the commanding thread has to `stop` it before it continues."""
        self.refusal, self.braking = self.refusal or refusal, True
        if self._motion.moving:
            self._send_brake()
        self.abandon(f'was aborted, because the machine {self.fault or self.refusal}')

    def _send_brake(self) -> None:
        self.link.send(JOG_CANCEL if self._motion.jogging else HOLD)

    def _alarmed(self, number: int) -> None:
        if number in HOMING_REQUIRED:  # aborts nothing: sent after a start, because it is locked
            return
        self.alarm = number
        self.lose_place(f'is locked by {alarm_text(number)}; check it, then home it')
        self.abandon(f'was aborted by {alarm_text(number)}')

    def _restarted(self, line: str) -> None:
        self.banner = line
        self.restarts += 1
        why = 'was restarted'
        if not self._restart_expected:
            why = 'restarted by itself, so its position is unknown; check its power supply, then home it'
            self.lose_place(why, obeys_upwards=True)
            self._brake('')
        self.abandon(f'was lost, because the machine {why}')
        self._unanswered.clear()
        self._restart_expected = self.reports.open = False

    def _idle(self) -> None:
        now_ns, moving = self._clock.now_ns(), self._motion.moving
        self.reports.listened(now_ns)
        if moving and self.silent and not self.fault and not self.refusal:
            self._lost_reports += 1
            self._brake(SILENT_IN_MOTION)
        mute = self.homing or self.alarm in NEEDS_RESET  # it sends no reports in these states
        if self.polling and not mute and self.reports.is_due(now_ns, moving):
            self.reports.request()
            if self.braking and self.silent:
                self._send_brake()
