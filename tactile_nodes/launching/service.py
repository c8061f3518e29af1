"""Runs a launch file: starts its processes, monitors them, and leaves none behind.

As ``ros2 launch``, with these differences. Everything is read and checked before the first process starts.
SIGTERM is a shutdown (the caller forwards it to `LaunchService.shutdown`). No process outlives the launcher, even if
the launcher is killed. The exit status is 1 if a required process failed or a process could not be started.
"""

from __future__ import annotations

import os
import signal
import uuid
from collections.abc import Callable, Mapping
from pathlib import Path

from tactile_nodes import paths
from tactile_nodes.errors import TactileError
from tactile_nodes.launching.actions import Action
from tactile_nodes.launching.context import Context
from tactile_nodes.launching.interpreter import Interpreter
from tactile_nodes.launching.processes import orphans
from tactile_nodes.launching.processes.agenda import Agenda, Appointment
from tactile_nodes.launching.processes.output import LaunchLog, Screen, make_log_folder, print_line
from tactile_nodes.launching.processes.plan import ProcessPlan
from tactile_nodes.launching.processes.supervisor import Supervisor

_CTRL_C = 'user interrupted with ctrl-c (SIGINT)'


class LaunchService:
    """A running launch file. It installs no signal handlers and may run in any thread.

    Args:
        file: the launch file.
        arguments: its launch arguments, as strings.
        screen: receives the lines for the screen, from several threads but one at a time; prints them by default.
        output: overrides the ``output`` of every process (default: ``$OVERRIDE_LAUNCH_PROCESS_OUTPUT``).
        environment: environment of the processes (default: that of this process).
        log_base: the folder in which the log folder of this launch is created.
        interactive: whether a person uses the terminal; after Ctrl-C the launcher then does not log each signal sent.
        debug: log the full command of each process.
    """

    def __init__(
        self,
        file: Path,
        arguments: Mapping[str, str] | None = None,
        *,
        screen: Screen = print_line,
        output: str | None = None,
        environment: Mapping[str, str] | None = None,
        log_base: Path | None = None,
        interactive: bool = False,
        debug: bool = False,
    ) -> None:
        self._file = file.absolute()
        self._arguments = dict(arguments or {})
        self._output = output or os.environ.get('OVERRIDE_LAUNCH_PROCESS_OUTPUT') or None
        self._interactive = interactive
        self._mark = uuid.uuid4().hex
        self._agenda = Agenda()
        self._supervisors: list[Supervisor] = []
        self._timers: dict[Appointment, bool] = {}
        self._deferred: list[Callable[[], None]] | None = []
        self._shutting_down = False
        self._status = 0
        self._cause = ''
        self._failures: list[str] = []
        self._log = LaunchLog(make_log_folder(log_base or paths.log_directory()), screen, debug=debug)
        context = Context(environment or os.environ, self.log_folder, file=self._file)
        self._interpreter = Interpreter(context, self, output_override=self._output)
        self._loaded = False

    @property
    def log_folder(self) -> Path:
        """The folder with launch.log, the log files of processes, and the parameter files written for them."""
        return self._log.folder

    def load(self) -> None:
        """Read the file and all it includes, and prepare every process; nothing is started.

        Raises:
            LaunchFileError: with file and line.
        """
        self._log.say('INFO', 'launch', f'All log files can be found below {self.log_folder}')
        self._log.say('INFO', 'launch', 'Default logging verbosity is set to INFO')
        self._loaded = True
        self._interpreter.include(self._file, self._arguments)

    def run(self) -> int:
        """Start everything, and return when all processes have ended.

        Returns:
            0; or 1 if the file has an error, a required process failed, or a process could not be started.
        """
        try:
            if not self._loaded:
                self.load()
        except TactileError as error:
            self._fail(str(error))
            self._log.close()
            return self._status
        return self._run()

    def shutdown(self, reason: str = 'LaunchService.shutdown() called') -> None:
        """End all processes, and then `run`; from any thread or signal handler."""
        self._agenda.post(lambda: self.request_shutdown(reason))

    def interrupt(self) -> None:
        """`shutdown` because of Ctrl-C."""
        self._agenda.post(self._interrupted)

    # --- called by actions: see interpreter.Host ----------------------------------------------------------------

    def log(self, level: str, source: str, text: str) -> None:
        self._log.say(level, source, text)

    def start(self, plan: ProcessPlan) -> None:
        self._later(lambda: self._start(plan))

    def after(self, seconds: float, actions: tuple[Action, ...], file: Path, cancel_on_shutdown: bool) -> None:
        self._later(lambda: self._set_timer(seconds, actions, file, cancel_on_shutdown))

    def request_shutdown(self, reason: str) -> None:
        self._later(lambda: self._shut_down(reason))

    # --- the thread of run ---------------------------------------------------------------------------------------

    def _run(self) -> int:
        guardian = orphans.Guardian(self._mark)
        try:
            deferred, self._deferred = self._deferred or [], None
            for task in deferred:
                task()
            while self._supervisors or self._timers:
                self._agenda.do_next()
        finally:
            orphans.end(lambda: orphans.marked(self._mark))
            guardian.dismiss()
            if self._cause:
                self._log.say('ERROR', 'launch', self._cause)
            self._log.close()
        return self._status

    def _later(self, task: Callable[[], None]) -> None:
        """Do it now if the launch runs, else when it starts."""
        if self._deferred is None:
            task()
        else:
            self._deferred.append(task)

    def _start(self, plan: ProcessPlan) -> None:
        if self._shutting_down:
            return
        supervisor = Supervisor(plan, self._mark, self._agenda, self._log, self._over)
        self._supervisors.append(supervisor)
        supervisor.start()

    def _over(self, supervisor: Supervisor, code: int | None) -> None:
        self._supervisors.remove(supervisor)
        name = supervisor.plan.name
        if code != 0 and not self._shutting_down:
            self._failures.append(f'{name} failed: {self._why(supervisor, code)}')
            if code is None or supervisor.plan.required:
                self._blame()
        if supervisor.plan.required and not self._shutting_down:
            self._log.say('INFO', 'launch', f'process[{name}] was required: shutting down launched system')
            self._stop_all(logged=True)

    def _set_timer(self, seconds: float, actions: tuple[Action, ...], file: Path, cancel_on_shutdown: bool) -> None:
        if self._shutting_down and cancel_on_shutdown:
            return

        def fire() -> None:
            del self._timers[appointment]
            self._perform(actions, file)

        appointment = self._agenda.after(seconds, fire)
        self._timers[appointment] = cancel_on_shutdown

    def _perform(self, actions: tuple[Action, ...], file: Path) -> None:
        try:
            with self._interpreter.context.inside(file):
                self._interpreter.perform(actions)
        except TactileError as error:
            self._fail(str(error))

    def _fail(self, text: str) -> None:
        self._log.say('ERROR', 'launch', text)
        self._failures.append(text)
        self._blame()
        self._stop_all(logged=True)

    def _blame(self) -> None:
        """Report that the launch has failed: the last failure, with those before as possible causes."""
        self._status = 1
        self._cause = '; then '.join(self._failures)

    def _why(self, supervisor: Supervisor, code: int | None) -> str:
        if code is None:
            return f'it could not be started: {supervisor.refusal}'
        complaint = self._log.last_complaint(supervisor.plan.name)
        if code < 0 and complaint:  # what it complained of need not be why somebody killed it
            return f'{_ended(code)}; its last error: {complaint}'
        return complaint or _ended(code)

    def _interrupted(self) -> None:
        self._log.say('WARNING', 'launch', f'{_CTRL_C} again, ignoring...' if self._shutting_down else _CTRL_C)
        self._stop_all(logged=not self._interactive)

    def _shut_down(self, reason: str) -> None:
        if not self._shutting_down:
            self._log.say('INFO', 'launch', f'shutting down: {reason}')
        self._stop_all(logged=True)

    def _stop_all(self, *, logged: bool) -> None:
        self._shutting_down = True
        for appointment in [timer for timer, cancel in self._timers.items() if cancel]:
            appointment.cancel()
            del self._timers[appointment]
        for supervisor in reversed(self._supervisors.copy()):
            supervisor.stop(logged=logged)


def _ended(code: int) -> str:
    if code > 0:
        return f'exit code {code}'
    named = {each.value: each.name for each in signal.Signals}  # of the real-time signals, only the first and the last
    return f'it was killed by {named.get(-code, f"signal {-code}")}'
