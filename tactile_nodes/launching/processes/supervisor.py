"""The life of one process of a launch: start, monitor, restart, end with stronger and stronger signals."""

from __future__ import annotations

import signal
from collections.abc import Callable

from tactile_nodes import clock
from tactile_nodes.errors import NOT_AGAIN
from tactile_nodes.launching.processes.agenda import Agenda, Appointment
from tactile_nodes.launching.processes.child import Child
from tactile_nodes.launching.processes.output import LaunchLog
from tactile_nodes.launching.processes.plan import ProcessPlan

SETTLED_S = 10.0
"""A process that fails sooner has never worked: a restart would not help."""
LONGEST_DELAY_S = 30.0
_WITHOUT_DELAY_S = 0.1
"""The delay that is doubled if a launch file sets none."""
_MOST_DOUBLINGS = 100  # 2.0 ** 1024 is more than a float can hold


class Supervisor:
    """One process of a launch. All its methods run in the thread of the agenda.

    Args:
        plan: what to start.
        mark: of the launch, see `orphans`.
        over: called after it has ended for good, with its exit code, or None if it could not be started.
    """

    def __init__(
        self,
        plan: ProcessPlan,
        mark: str,
        agenda: Agenda,
        log: LaunchLog,
        over: Callable[[Supervisor, int | None], None],
    ) -> None:
        self.plan = plan
        self._mark = mark
        self._agenda = agenda
        self._log = log
        self._over = over
        self._child: Child | None = None
        self._respawns = self._quick = 0
        self._started_s = 0.0
        self._stopping = False
        self._appointments: list[Appointment] = []
        self.refusal = ''
        """Why it could not be started; empty if it was."""

    def start(self) -> None:
        self._say('DEBUG', f"process details: cmd='{self.plan.command_line}', cwd='{self.plan.cwd}'")
        self._log.forget_complaint(self.plan.name)
        try:
            child = Child(self.plan, self._mark, self._log, self._report)
        except OSError as error:
            self.refusal = f'{error.strerror or error}: {error.filename or self.plan.command[0]}'
            self._say('ERROR', f'process could not be started: {self.refusal}')
            if self._respawns and self._has_tries:  # a package that is being upgraded has no programs for a while
                self._start_later(quick=True)
            else:
                self._over(self, None)
            return
        self._child = child
        self._started_s = clock.monotonic_s()
        self._say('INFO', f'process started with pid [{child.pid}]')
        child.watch()

    def stop(self, *, logged: bool) -> None:
        """End it: SIGINT, and after its timeouts SIGTERM and SIGKILL; `logged` says whether to log the SIGINT."""
        if self._stopping:
            return
        self._stopping = True
        if self._child is None:  # waiting to be restarted
            self._cancel()
            self._over(self, 0)
            return
        if logged:
            self._say('INFO', f"sending signal 'SIGINT' to process[{self.plan.name}]")
        if not self._signal(signal.SIGINT):
            return
        to_term, to_kill = float(self.plan.sigterm_timeout), float(self.plan.sigkill_timeout)
        self._escalate(to_term, self.plan.sigterm_timeout, signal.SIGINT, signal.SIGTERM)
        self._escalate(to_term + to_kill, str(to_term + to_kill), signal.SIGTERM, signal.SIGKILL)

    def _escalate(self, seconds: float, shown: str, last: signal.Signals, number: signal.Signals) -> None:
        def send() -> None:
            self._say(
                'ERROR',
                f"process[{self.plan.name}] failed to terminate '{shown}' seconds after receiving '{last.name}', "
                f"escalating to '{number.name}'",
            )
            self._say('INFO', f"sending signal '{number.name}' to process[{self.plan.name}]")
            self._signal(number)

        self._appointments.append(self._agenda.after(seconds, send))

    def _signal(self, number: signal.Signals) -> bool:
        if self._child is None or self._child.signal(number):
            return True
        self._say(
            'ERROR',
            f'process[{self.plan.name}] belongs to another user and may not be signalled; the launch waits for it: '
            f'end it with sudo kill {self._child.pid}',
        )
        return False

    def _report(self, code: int) -> None:
        self._agenda.post(lambda: self._exited(code))

    def _exited(self, code: int) -> None:
        pid = self._child.pid if self._child else 0
        self._child = None
        self._cancel()
        if code == 0:
            self._say('INFO', f'process has finished cleanly [pid {pid}]')
        else:
            self._say('ERROR', f'process has died [pid {pid}, exit code {code}].')
        quick = clock.monotonic_s() - self._started_s < SETTLED_S
        if self._may_respawn(code, quick):
            self._start_later(quick=quick)
        else:
            self._over(self, code)

    def _start_later(self, *, quick: bool) -> None:
        self._respawns += 1
        self._quick = self._quick + 1 if quick else 0
        self._appointments = [self._agenda.after(self._delay_s, self.start)]

    @property
    def _delay_s(self) -> float:
        """Doubles each time the process ends soon, so that a broken program does not fill disk and log."""
        delay_s = self.plan.respawn_delay_s
        if self._quick <= 1:
            return delay_s
        doubled_s = (delay_s or _WITHOUT_DELAY_S) * 2.0 ** min(self._quick - 1, _MOST_DOUBLINGS)
        return min(doubled_s, max(delay_s, LONGEST_DELAY_S))

    def _may_respawn(self, code: int, quick: bool) -> bool:
        plan = self.plan
        if plan.required and (code in {0, NOT_AGAIN} or (code > 0 and quick)):
            return False
        return plan.respawn and self._has_tries and not self._stopping

    @property
    def _has_tries(self) -> bool:
        return self.plan.respawn_max_retries < 0 or self._respawns < self.plan.respawn_max_retries

    def _cancel(self) -> None:
        for appointment in self._appointments:
            appointment.cancel()
        self._appointments.clear()

    def _say(self, level: str, text: str) -> None:
        self._log.say(level, self.plan.name, text)
