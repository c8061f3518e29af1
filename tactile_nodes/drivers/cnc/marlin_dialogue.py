"""The dialogue with Marlin: numbered lines with checksums, resends, busy messages, restarts and halts.

Marlin processes one line after another, with emergency commands in between. So while something moves, no line is sent
that blocks it for long, except lines whose response waits for the end of motion. ``M114`` is then answered at once
even during motion; it is sent several times per second, and silence means that the controller hangs. Marlin 1, and
Marlin 2 with M114_LEGACY, answer it only at rest. Once that was observed, ``G21``, which changes nothing, is sent
instead during motion. Until the variant is known, a missing response counts as silence only at rest, or if the busy
messages (every two seconds) do not come.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable

from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.drivers.cnc.contract import Traffic
from tactile_nodes.drivers.cnc.link import SILENT_IN_MOTION, Link, Request, Silence
from tactile_nodes.drivers.serial_port import Port
from tactile_nodes.errors import DeviceFaultError, DeviceTimeoutError

BUSY_S = 5.0  # busy messages come every two seconds
MOST_RESENDS = 5
NO_OK_S = 0.3
LONGEST_LINE = 90
SILENT_S = 0.3  # with MOVING_S and the listener's period, silence during motion is detected within 0.5 s
AT_ONCE = 0  # the response does not wait for motion
MOVING_S = 0.1  # between two requests during motion
STOP_S = 10.0  # without emergency parser it acts only after the buffered moves
LOST_S = 3.0  # longer than the pause after a quick stop, and than the time between two busy messages
IDENTITY, IDENTIFIED = 'M115', 'FIRMWARE_NAME:'  # the response to no other line says this
STOP = 'M410'  # the response takes a second, in which the controller does nothing else
HOMING_STOP_S, HOMING_STOPS = 0.5, 16  # so that one always waits when the second after another is over
ALIVE = 'G21'  # millimetres, as before: every Marlin answers it at once
PLACE = 'M114 R'  # the real position, if compiled in; else the R is ignored, and the target is reported


class _Numbered(Request):
    """A request with its line number and the requested resends."""

    number = 0
    resend = 0
    resend_ns = 0
    attempts = 0
    due_ns: int | None = 0
    until_ns = 0  # time limit of the sender, after which the controller counts as hung
    in_motion = False
    fence = False  # every ok before its own response belongs to earlier lines


class MarlinDialogue:
    """One line in flight, except for emergency commands.

    Args:
        port: open.
        clock: the host's.
        moving: whether the machine certainly moves now.
        period_s: between position requests at rest, once `polling` is set.
        placed: gets each response to such a request, line by line.
        on_lost: called when the position is lost, with whether the controller may have restarted.
        traffic: gets every byte.
        threaded: as of `Link`.
    """

    def __init__(
        self,
        port: Port,
        clock: Clock,
        moving: Callable[[], bool],
        period_s: float,
        placed: Callable[[list[str], int], None],
        on_lost: Callable[[bool], None],
        traffic: Traffic | None = None,
        threaded: bool = True,
    ) -> None:
        self._clock = clock
        self._moving = moving
        self._period_s = period_s
        self._placed = placed
        self._on_lost = on_lost
        self._sent_ns = 0
        self._unanswered: deque[_Numbered] = deque()
        self._number = 0
        self._busy_ns = 0
        self._silence = Silence()
        self.generation = 0
        self.name = port.name
        self.starts = 0
        self.connected = False
        self.polling = False
        self.answers_in_motion: bool | None = None  # to a position request; None: not known yet
        self.killed = False
        self.fault = ''
        self.refusal = ''  # kept until it is stopped
        self.place_lost = False
        self.obeys_upwards = True  # until it has halted itself
        self.link = Link(port, clock, self._hear, self._idle, traffic, threaded)
        self.link.start()

    def begin(self, timeout_s: float) -> None:
        """Synchronize the line number; again if the controller was still starting. Raises as `ask`."""
        starts = self.starts
        try:
            self._number_from_zero(timeout_s)
        except DeviceFaultError:
            if self.starts == starts:
                raise
            self.link.wait(lambda: False, NO_OK_S)  # it may have kept the line, and answer it now
            self._number_from_zero(timeout_s)

    def _number_from_zero(self, timeout_s: float) -> None:
        with self.link.changed:
            self._number = -1
            self.ask('M110 N0', timeout_s)

    @property
    def silent(self) -> bool:
        with self.link.changed:
            if not self._unanswered:
                return False
            oldest, stops = self._unanswered[0], any(each.text == STOP for each in self._unanswered)
            at_once = oldest.due_ns is not None and not stops and (not oldest.in_motion or self._answers(oldest.text))
            return self._silence.is_over(SILENT_S if at_once else BUSY_S)

    def _answers(self, text: str) -> bool:
        """Whether it certainly answers this line at once during motion."""
        return self.answers_in_motion is not None and (self.answers_in_motion or text != PLACE)

    def ask(
        self,
        line: str,
        timeout_s: float,
        due_ns: int | None = AT_ONCE,
        generation: int | None = None,
        up: bool = False,
    ) -> Request:
        """Send a line and wait for its ``ok``; busy messages extend the time.

        Args:
            line: without number and checksum.
            timeout_s: for the response.
            due_ns: latest time of the response; later, a missing response is silence. None: unknown.
            generation: of the dialogue, when the line was decided; a line decided before a stop is not sent.
            up: it belongs to a way straight up, for which the position may be unknown.

        Raises:
            DeviceFaultError: this Marlin does not know it, or a stop or a restart came in between.
            DeviceTimeoutError: no response.
            DeviceLostError: the port is gone.
        """
        assert line.isascii() and len(line) <= LONGEST_LINE
        with self.link.changed:
            generation = self.generation if generation is None else generation
            self._wait(lambda: not self._unanswered or generation != self.generation, line, timeout_s, self._turn_ns)
            if self.fault:
                self.require_sound(up)
            if generation != self.generation:
                raise DeviceFaultError(f'{self.name}: {line!r} was not sent, because the motion was aborted')
            request = self._put(line, due_ns)
            request.until_ns = request.sent_ns + round(timeout_s * NS_PER_S)
            self._wait(lambda: request.done, line, timeout_s)
        if request.error is not None:
            raise request.error
        return request

    def stop(self, homing: str) -> None:
        """Stop motion, at once if possible; unanswered lines fail. Returns when nothing is unanswered.

        If a response is missing, or the position is unknown, lines or responses may be lost: all is begun again.

        Args:
            homing: command during which the stop is repeated, until the controller halts or has homed; '': none. A
                single stop on the way off a switch ends only that way, and homing goes on.
        """
        with self.link.changed:
            self.generation += 1
            for waiting in self._unanswered:
                waiting.error = DeviceFaultError(f'{self.name}: {waiting.text!r} was aborted by a stop')
            self.link.changed.notify_all()
            self._send_stop()
            for _ in range(HOMING_STOPS):
                if self.link.wait(lambda: all(each.text != homing for each in self._unanswered), HOMING_STOP_S):
                    break
                self._send_stop()
            if self.obeys_upwards and (self.fault or not self._all_answered()):
                self._begin_again()

    def _send_stop(self) -> None:
        """Without number: handled by the emergency parser, before waiting lines."""
        request = _Numbered(STOP)
        self._unanswered.append(request)
        request.sent_ns = self.link.send(STOP.encode('ascii') + b'\n')
        request.until_ns = request.sent_ns + round(STOP_S * NS_PER_S)

    def _all_answered(self) -> bool:
        """Wait until nothing is unanswered; false: for `LOST_S` there was neither that nor a busy message."""
        since_ns = self._clock.now_ns()
        while not self.link.wait(lambda: not self._unanswered, LOST_S):
            if self._busy_ns < since_ns:
                return False
            since_ns = self._clock.now_ns()
        return True

    def _begin_again(self) -> None:
        """Repeat the stop, skip each ``ok`` until the response to one line that is known, and number lines from 0.

        The known line has no number: ``M110`` sets the number again when it is executed, after any line that follows.
        """
        self._break_off('was lost')
        self._unanswered.clear()
        request = _Numbered(IDENTITY)
        request.fence = True
        self._unanswered.append(request)
        request.sent_ns = self.link.send(f'{STOP}\n{IDENTITY}\n'.encode('ascii'))
        self._await(request)
        self._number = -1
        self._await(self._put('M110 N0'))

    def _await(self, request: _Numbered) -> None:
        request.due_ns, timeout_s = None, STOP_S - LOST_S
        request.until_ns = request.sent_ns + round(timeout_s * NS_PER_S)
        self._wait(lambda: request.done, request.text, timeout_s)
        if request.error is not None:
            raise request.error

    def require_sound(self, up: bool = False) -> None:
        """Raise the current fault, if any; for motion `up`, only one other than an unknown position."""
        if wrong := ('' if up and self.obeys_upwards else self.fault) or self.refusal:
            raise DeviceFaultError(f'{self.name} {wrong}')

    def brake(self, refusal: str) -> None:
        """Stop motion, at once if possible; the commanding thread has to `stop` it before it continues."""
        with self.link.changed:
            self.refusal = self.refusal or refusal
            self.generation += 1
            self._send_stop()
            self._break_off(f'was aborted, because the machine {self.fault or self.refusal}')

    def lose_place(self, fault: str) -> None:
        """Mark the position of the tip as unknown."""
        with self.link.changed:
            self.fault, self.place_lost = fault, True
            self._on_lost(True)

    def close(self) -> None:
        with self.link.changed:
            self._break_off('was aborted because the port was closed')
        self.link.close()

    def _put(self, line: str, due_ns: int | None = AT_ONCE) -> _Numbered:
        request = _Numbered(line)
        self._number += 1
        request.number, request.due_ns, request.in_motion = self._number, due_ns, self._moving()
        self._unanswered.append(request)
        request.sent_ns = self._sent_ns = self._send(request)
        return request

    def _send(self, request: _Numbered) -> int:
        text = f'N{request.number} {request.text}'
        checksum = 0
        for byte in text.encode('ascii'):
            checksum ^= byte
        return self.link.send(f'{text}*{checksum}\n'.encode('ascii'))

    def _turn_ns(self) -> int:
        """Time until which a waiting line raises no error: the sender of the line before it reports problems."""
        return max((each.until_ns for each in self._unanswered), default=0)

    def _wait(
        self, done: Callable[[], bool], line: str, timeout_s: float, until_ns: Callable[[], int] = lambda: 0
    ) -> None:
        begin_ns = self._clock.now_ns()
        while not self.link.wait(done, timeout_s):
            now_ns = self._clock.now_ns()
            if now_ns - max(begin_ns, self._busy_ns) < BUSY_S * NS_PER_S and self._busy_ns > begin_ns:
                continue
            if now_ns < until_ns():
                continue
            self.lose_place(
                'stopped responding, so its position is unknown; switch it off and on, check it, and connect again'
            )
            raise DeviceTimeoutError(
                f'{self.name} did not respond to {line!r} within {timeout_s:.1f} s; '
                'it hangs: switch it off and on, then connect again'
            )

    # Receiving; all under the link's lock.

    def _hear(self, line: str, stamp_ns: int) -> None:
        if line == 'ok' or line.startswith('ok '):
            self._answered(line[2:].strip(), stamp_ns)
        elif line.startswith('echo:busy'):
            self._busy_ns = stamp_ns
        elif line.startswith(('Resend:', 'rs ')):
            self._note_resend(line)
        elif line == 'start':
            self._started()
        elif line.startswith('Error:') and ('kill' in line or 'halted' in line):
            self._halted(line)
        elif self._unanswered:
            self._unanswered[0].lines.append(line)

    def _answered(self, extra: str, stamp_ns: int) -> None:
        if not self._unanswered:
            return
        request = self._unanswered[0]
        if request.fence and not any(line.startswith(IDENTIFIED) for line in request.lines):
            return
        if request.text in {PLACE, IDENTITY} and not (extra or request.lines or request.resend):
            return  # an extra ok, for example a late one after a resend: the response comes before its own ok
        request.lines.append(extra)  # some firmware puts the response to M114 there
        if request.resend and request.error is None:
            self._repeat(request)
            if not request.done:
                return
        self._unanswered.popleft()
        request.answered_ns = stamp_ns
        if request.text == PLACE:
            # An answer is not late if only this computer paused before it was read.
            quick = not self._silence.is_over(SILENT_S)
            if request.in_motion and quick == self._moving() and not self.answers_in_motion:
                self.answers_in_motion = quick  # late, and at rest by then: it waited for the end of motion
            self._placed(request.lines, stamp_ns)
        if any(line.startswith('echo:Unknown command') for line in request.lines) and request.error is None:
            request.error = DeviceFaultError(
                f'{self.name} does not know {request.text!r}; this Marlin does not support it'
            )

    def _note_resend(self, line: str) -> None:
        match = re.search(r'\d+', line)
        if self._unanswered and match is not None and not self._unanswered[0].fence:
            self._unanswered[0].resend = int(match.group())
            self._unanswered[0].resend_ns = self._clock.now_ns()

    def _idle(self) -> None:
        """Check for silence and request the position. Repeat a line even without the ok that some variants omit."""
        oldest = self._unanswered[0] if self._unanswered else None
        since_ns = max(oldest.sent_ns, self._busy_ns, oldest.due_ns or 0) if oldest else None
        self._silence.look(since_ns, self._clock.now_ns())
        if self._moving() and self.silent and not self.fault and not self.refusal:
            self.brake(SILENT_IN_MOTION)
        if self.polling and not self._unanswered and not self.fault:
            self._poll()
        elif self._unanswered and (request := self._unanswered[0]).resend and request.error is None:
            if self._clock.now_ns() - request.resend_ns > NO_OK_S * NS_PER_S:
                self._repeat(request)
            if request.done:
                self._unanswered.popleft()

    def _poll(self) -> None:
        """Send a line when it is due: its response shows that the controller is alive."""
        period_s = min(self._period_s, MOVING_S) if self._moving() else self._period_s
        if self._clock.now_ns() - self._sent_ns >= period_s * NS_PER_S:
            waits = self.answers_in_motion is False and self._moving()  # it would report its position only at rest
            self._put(ALIVE if waits else PLACE)

    def _repeat(self, request: _Numbered) -> None:
        """Send a line again if it is the requested one; if the next one is requested, this one had arrived."""
        wanted, request.resend = request.resend, 0
        damaged = any('checksum' in line.lower() for line in request.lines)
        if wanted == request.number + 1 and not damaged:
            request.answered_ns = self._clock.now_ns()
            return
        request.attempts += 1
        if wanted == 1 < request.number and self.connected:
            self.lose_place('has restarted, so its position is unknown; check its power supply, then connect again')
            self._break_off(f'was aborted, because the machine {self.fault}')
        elif wanted != request.number or request.attempts > MOST_RESENDS:
            request.error = DeviceFaultError(
                f'{self.name} requests line {wanted} again, but {request.number} ({request.text!r}) was sent; '
                'the line is too noisy, or another program uses it'
            )
        else:
            self._send(request)

    def _started(self) -> None:
        self.starts += 1
        if self.connected:
            self.lose_place(
                'restarted by itself, so its position is unknown; check its power supply, then connect again'
            )
            self.brake('')  # in case it was not a restart
        self._break_off(f'was lost, because the machine {self.fault or "was restarted"}')
        self._unanswered.clear()

    def _halted(self, line: str) -> None:
        self.killed, self.obeys_upwards = True, False
        self.lose_place(f'halted itself ({line}); switch it off and on, check it, and connect again')
        self._break_off('was aborted because the controller halted')
        self._unanswered.clear()

    def _break_off(self, why: str) -> None:
        for request in self._unanswered:
            request.error = request.error or DeviceFaultError(f'{self.name}: {request.text!r} {why}')
        self.link.changed.notify_all()
