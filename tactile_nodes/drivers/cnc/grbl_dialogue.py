"""The dialogue with Grbl: lines with their responses, resets, and status reports on request."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

from tactile_nodes.clock import NS_PER_S
from tactile_nodes.drivers.cnc.grbl_hearing import SILENT_S, GrblHearing
from tactile_nodes.drivers.cnc.grbl_words import Report, check_line
from tactile_nodes.drivers.cnc.link import Request
from tactile_nodes.errors import DeviceError, DeviceFaultError, DeviceTimeoutError

RESET = b'\x18'


class GrblDialogue(GrblHearing):
    """The sending side. The arguments are those of `GrblHearing`."""

    def ask(self, line: str, timeout_s: float, generation: int | None = None) -> Request:
        """Send a line and wait for its response.

        Args:
            line: without its end.
            timeout_s: for the response.
            generation: of the dialogue, when the line was decided; a line decided before a stop is not sent.

        Raises:
            DeviceFaultError: it was refused, or an alarm, a stop or a restart came instead.
            DeviceTimeoutError: no response; the controller hangs.
            DeviceLostError: the port is gone.
        """
        check_line(line)
        request = Request(line)
        with self.link.changed:
            generation = self.generation if generation is None else generation
            if not self.link.wait(lambda: not self._unanswered or generation != self.generation, timeout_s):
                raise self._hung(line, timeout_s)
            if generation != self.generation:
                raise DeviceFaultError(f'{self.name}: {line!r} was not sent, because the motion was aborted')
            self._unanswered.append(request)
            self.braking = False
            request.sent_ns = self.link.send(line.encode('ascii') + b'\n')
        self._settle(request, timeout_s)
        return request

    def reset(self, timeout_s: float) -> None:
        """Soft reset. Returns after the banner, or after a status report, because FluidNC's banner can be any text.

        Raises:
            DeviceTimeoutError: neither came.
        """
        with self.link.changed:
            before = self.restarts
            self._restart_expected = True
            self.link.send(RESET)
            if self.link.wait(lambda: self.restarts > before, timeout_s):
                return
            self.reports.open = False
            self.reports.request()
            if not self.link.wait(lambda: not self.reports.open, SILENT_S):
                raise self._hung('the reset', timeout_s)
            self._restarted(self.banner)

    def fresh_report(self, timeout_s: float) -> Report:
        """A report that was requested after this call began.

        Raises:
            DeviceTimeoutError: none came.
        """
        with self.link.changed:
            lost = self._lost_reports
            came = lambda: not self.reports.open or self._lost_reports != lost  # noqa: E731
            self.link.wait(came, SILENT_S)  # a report that is under way is outdated
            self.reports.request()
            if not self.link.wait(came, timeout_s) or self.reports.last is None:
                raise DeviceTimeoutError(
                    f'{self.name} reported no position within {timeout_s:g} s; switch it off and on, then start again; '
                    'firmware older than Grbl 1.1 is not supported, and Marlin needs cnc.kind: marlin'
                )
            if self._lost_reports != lost:
                raise DeviceTimeoutError(f'{self.name} {self.refusal or "reports no position"}')
            return self.reports.last

    def poll_until(self, done: Callable[[Report], bool], timeout_s: float, every_s: float = 0.05) -> bool:
        """Request reports until one satisfies the condition; False: none did, or everything was aborted.

        A question that takes longer than it can, because this computer stood still, counts for no longer than that.
        """
        left_ns, generation = round(timeout_s * NS_PER_S), self.generation
        longest_ns = round((2 * SILENT_S + every_s) * NS_PER_S)
        while self.alarm is None and generation == self.generation and left_ns > 0:
            asked_ns = self._clock.now_ns()
            with contextlib.suppress(DeviceTimeoutError):  # a lost response; the time limit decides
                if done(self.fresh_report(SILENT_S)):
                    return True
            self.link.wait(lambda: self.alarm is not None, every_s)
            left_ns -= min(self._clock.now_ns() - asked_ns, longest_ns)
        return False

    def _settle(self, request: Request, timeout_s: float) -> None:
        if not self.link.wait(lambda: request.done, timeout_s):
            raise self._hung(request.text, timeout_s)
        if request.error is not None:
            raise request.error

    def _hung(self, line: str, timeout_s: float) -> DeviceError:
        self.lose_place(
            'stopped responding, so its position is unknown; switch it off and on, check it, and connect again',
            obeys_upwards=True,
            restarted=False,
        )
        return DeviceTimeoutError(
            f'{self.name} did not respond to {line!r} within {timeout_s:.1f} s; it hangs: switch it off and on, then '
            'connect again'
        )
