"""The dialogue with Marlin: numbered lines with checksums, resends, signs of life, restarts, the end of everything.

Marlin deals with one line after the other, and with the emergency commands between them. So nothing is sent that takes
it long while something moves, but for what only the end of motion answers; then it answers ``M114`` at once also while
it moves, which is asked several times a second: its silence tells that it hangs. Marlin 1, and Marlin 2 with
M114_LEGACY, answer when they have come to rest; once one has, it is asked ``G21`` instead while it moves, which changes
nothing. Until it is known which of the two it is, a missing answer counts as silence only at rest, or when the signs of
life (``busy``, every two seconds) stay away.
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

BUSY_S = 5.0  # it says that it is busy every two seconds
MOST_RESENDS = 5
NO_OK_S = 0.3
LONGEST_LINE = 90
SILENT_S = 0.3  # with MOVING_S and the listener's period, silence in motion is noticed within 0.5 s
AT_ONCE = 0  # is answered whatever moves
MOVING_S = 0.1  # between two questions while something moves
STOP_S = 10.0  # without emergency parser it comes after the buffers
STOP = 'M410'  # answered after a second, in which it does nothing else
ALIVE = 'G21'  # millimetres, as before: every Marlin answers it at once
PLACE = 'M114 R'  # the real place, where it was compiled to know it; else the R is ignored, and it tells the target


class _Numbered(Request):
    """A request with its line number and what the controller asked to hear again."""

    number = 0
    resend = 0
    resend_ns = 0
    attempts = 0
    due_ns: int | None = 0
    until_ns = 0  # who sent it waits so long, and says then that it hangs
    in_motion = False


class MarlinDialogue:
    """One line in flight, but for the emergency commands.

    Args:
        port: open.
        clock: the host's.
        moving: whether the machine surely moves now.
        period_s: between questions for the place at rest, once `polling` is set.
        placed: told each answer to such a question, line by line.
        on_lost: told when the place is lost.
        traffic: told every byte.
        threaded: as of `Link`.
    """

    def __init__(
        self,
        port: Port,
        clock: Clock,
        moving: Callable[[], bool],
        period_s: float,
        placed: Callable[[list[str], int], None],
        on_lost: Callable[[], None],
        traffic: Traffic | None = None,
        threaded: bool = True,
    ) -> None:
        self._clock = clock
        self._moving = moving
        self._period_s = period_s
        self._placed = placed
        self._on_lost = on_lost
        self._said_ns = 0
        self._unanswered: deque[_Numbered] = deque()
        self._number = 0
        self._busy_ns = 0
        self._silence = Silence()
        self.generation = 0
        self.name = port.name
        self.starts = 0
        self.connected = False
        self.polling = False
        self.answers_in_motion: bool | None = None  # the question for the place; None: nobody knows yet
        self.killed = False
        self.fault = ''
        self.refusal = ''  # until it is stopped
        self.place_lost = False
        self.link = Link(port, clock, self._hear, self._idle, traffic, threaded)
        self.link.start()

    def begin(self, timeout_s: float) -> None:
        """Agree on the line number."""
        with self.link.changed:
            self._number = -1
            self.ask('M110 N0', timeout_s)

    @property
    def silent(self) -> bool:
        """Whether it owes an answer for longer than it may."""
        with self.link.changed:
            if not self._unanswered:
                return False
            oldest, stops = self._unanswered[0], any(each.text == STOP for each in self._unanswered)
            at_once = oldest.due_ns is not None and not stops and (not oldest.in_motion or self._answers(oldest.text))
            return self._silence.is_over(SILENT_S if at_once else BUSY_S)

    def _answers(self, text: str) -> bool:
        """Whether it surely answers that at once while it moves."""
        return self.answers_in_motion is not None and (self.answers_in_motion or text != PLACE)

    def ask(self, line: str, timeout_s: float, due_ns: int | None = AT_ONCE, generation: int | None = None) -> Request:
        """Send a line and wait for its ``ok``; signs of life extend the time.

        Args:
            line: without number and checksum.
            timeout_s: for the answer.
            due_ns: when it is answered at the latest, from when on a missing answer is silence; None: nobody knows.
            generation: when what the line says was decided; none is sent that was decided before a stop.

        Raises:
            DeviceFaultError: it is not known to this Marlin, or a stop or a restart came in between.
            DeviceTimeoutError: no answer.
            DeviceLostError: the port is gone.
        """
        assert line.isascii() and len(line) <= LONGEST_LINE
        with self.link.changed:
            generation = self.generation if generation is None else generation
            self._wait(lambda: not self._unanswered or generation != self.generation, line, timeout_s, self._turn_ns)
            if self.fault:
                self.require_sound()
            if generation != self.generation:
                raise DeviceFaultError(f'{self.name}: {line!r} was not sent, because the motion was broken off')
            request = self._put(line, due_ns)
            request.until_ns = request.sent_ns + round(timeout_s * NS_PER_S)
            self._wait(lambda: request.done, line, timeout_s)
        if request.error is not None:
            raise request.error
        return request

    def interrupt(self, line: str, timeout_s: float) -> None:
        """Send a line past what is unanswered, which fails; returns when everything is answered."""
        with self.link.changed:
            self.generation += 1
            for waiting in self._unanswered:
                waiting.error = DeviceFaultError(f'{self.name}: {waiting.text!r} was broken off by a stop')
            request = _Numbered(line)
            self._unanswered.append(request)
            request.sent_ns = self.link.send(line.encode('ascii') + b'\n')
            request.until_ns = request.sent_ns + round(timeout_s * NS_PER_S)
            self.link.changed.notify_all()
            self._wait(lambda: not self._unanswered, line, timeout_s)

    def require_sound(self, up: bool = False) -> None:  # noqa: ARG002
        """Raise what is wrong, if something is; whatever it is, it keeps this one from going up as well."""
        if wrong := self.fault or self.refusal:
            raise DeviceFaultError(f'{self.name} {wrong}')

    def brake(self, refusal: str) -> None:
        """Stop what moves, at once where it can; whoever commands it has to `stop` it before it goes on."""
        with self.link.changed:
            self.refusal = self.refusal or refusal
            self.generation += 1
            request = _Numbered(STOP)
            self._unanswered.append(request)
            # Without number: past what waits, by its emergency parser.
            request.sent_ns = self.link.send(STOP.encode('ascii') + b'\n')
            request.until_ns = request.sent_ns + round(STOP_S * NS_PER_S)
            self._break_off(f'was broken off, because the machine {self.fault or self.refusal}')

    def lose_place(self, fault: str) -> None:
        """From now on nobody knows where the tip is."""
        with self.link.changed:
            self.fault, self.place_lost = fault, True
            self._on_lost()

    def close(self) -> None:
        """Let go of the port."""
        with self.link.changed:
            self._break_off('was given up because the port was closed')
        self.link.close()

    def _put(self, line: str, due_ns: int | None = AT_ONCE) -> _Numbered:
        request = _Numbered(line)
        self._number += 1
        request.number, request.due_ns, request.in_motion = self._number, due_ns, self._moving()
        self._unanswered.append(request)
        request.sent_ns = self._said_ns = self._send(request)
        return request

    def _send(self, request: _Numbered) -> int:
        text = f'N{request.number} {request.text}'
        checksum = 0
        for byte in text.encode('ascii'):
            checksum ^= byte
        return self.link.send(f'{text}*{checksum}\n'.encode('ascii'))

    def _turn_ns(self) -> int:
        """Until when a line that waits for its turn has to wait, and says nothing: for who sent what is in its way."""
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
                'stopped answering, so its place is not known; cut its power, look at it, and connect again'
            )
            raise DeviceTimeoutError(
                f'{self.name} did not answer {line!r} within {timeout_s:.1f} s; '
                'it hangs: cut its power and connect again'
            )

    # Listening; all under the link's lock.

    def _hear(self, line: str, stamp_ns: int) -> None:
        if line == 'ok' or line.startswith('ok '):
            self._answered(line[2:].strip(), stamp_ns)
        elif line.startswith('echo:busy'):
            self._busy_ns = stamp_ns
        elif line.startswith(('Resend:', 'rs ')):
            self._asked_again(line)
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
        if request.text == PLACE and not (extra or request.lines or request.resend):
            return  # an ok too many, as a late one after a resend: the place comes before its own
        request.lines.append(extra)  # some firmware puts the answer to M114 there
        if request.resend and request.error is None:
            self._repeat(request)
            if not request.done:
                return
        self._unanswered.popleft()
        request.answered_ns = stamp_ns
        if request.text == PLACE:
            # An answer is not late because the computer stood still before it was read.
            quick = stamp_ns - request.sent_ns < SILENT_S * NS_PER_S or not self._silence.is_over(SILENT_S)
            if request.in_motion and quick == self._moving() and not self.answers_in_motion:
                self.answers_in_motion = quick  # late, and at rest by then: it waited for that
            self._placed(request.lines, stamp_ns)
        if any(line.startswith('echo:Unknown command') for line in request.lines) and request.error is None:
            request.error = DeviceFaultError(f'{self.name} does not know {request.text!r}; this Marlin lacks it')

    def _asked_again(self, line: str) -> None:
        match = re.search(r'\d+', line)
        if self._unanswered and match is not None:
            self._unanswered[0].resend = int(match.group())
            self._unanswered[0].resend_ns = self._clock.now_ns()

    def _idle(self) -> None:
        """Marlin sends an ok after it has asked for a resend; its relatives may not. And ask where it is."""
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
        """Any line is as good as a question: its answer shows that it lives."""
        period_s = min(self._period_s, MOVING_S) if self._moving() else self._period_s
        if self._clock.now_ns() - self._said_ns >= period_s * NS_PER_S:
            waits = self.answers_in_motion is False and self._moving()  # where it is, it would tell at rest alone
            self._put(ALIVE if waits else PLACE)

    def _repeat(self, request: _Numbered) -> None:
        """Say a line again, if it is the one that is asked for; if the next one is, this one had arrived."""
        wanted, request.resend = request.resend, 0
        damaged = any('checksum' in line.lower() for line in request.lines)
        if wanted == request.number + 1 and not damaged:
            request.answered_ns = self._clock.now_ns()
            return
        request.attempts += 1
        if wanted == 1 < request.number and self.connected:
            self.lose_place('has restarted, so its place is not known; look at its supply, then connect again')
            self._break_off(f'was broken off, because the machine {self.fault}')
        elif wanted != request.number or request.attempts > MOST_RESENDS:
            request.error = DeviceFaultError(
                f'{self.name} asks again for line {wanted}, sent was {request.number} ({request.text!r}); '
                'the line is too noisy or somebody else talks to it'
            )
        else:
            self._send(request)

    def _started(self) -> None:
        self.starts += 1
        if self.connected:
            self.lose_place('restarted by itself, so its place is not known; look at its supply, then connect again')
            self.brake('')  # should it be no restart, but something that only looks like one
        self._break_off(f'was lost, because the machine {self.fault or "was restarted"}')
        self._unanswered.clear()

    def _halted(self, line: str) -> None:
        self.killed = True
        self.lose_place(f'halted itself ({line}); cut its power, look at it, and connect again')
        self._break_off('was broken off because the controller halted')
        self._unanswered.clear()

    def _break_off(self, why: str) -> None:
        for request in self._unanswered:
            request.error = request.error or DeviceFaultError(f'{self.name}: {request.text!r} {why}')
        self.link.changed.notify_all()
