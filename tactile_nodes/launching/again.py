"""A launch that is restarted whenever it ends, so that it fails without affecting other launches."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Callable
from pathlib import Path

from tactile_nodes.clock import monotonic_s
from tactile_nodes.errors import TactileError
from tactile_nodes.launching.processes.output import Line, Screen
from tactile_nodes.launching.service import LaunchService

FIRST_DELAY_S, LONGEST_DELAY_S = 1.0, 15.0
SETTLED_S = 75.0
"""A launch that lasts longer counts as working: it may wait a minute for its camera."""


class LaunchedAgain:
    """One launch after another, in a thread. The pause between them doubles from 1 s to 15 s until one works.

    If it fails repeatedly for the same reason, only the logs of the last failure are kept: without its camera, a sensor
    is launched again for days.

    Args:
        make: creates a service that prints to the given screen; the number says how many launches were before it.
        screen: receives the output of the launches.
    """

    def __init__(self, make: Callable[[Screen, int], LaunchService], screen: Screen) -> None:
        self._make = make
        self._screen = screen
        self._number = 0
        self._began_s: float | None = None
        self._cause = self._complaint = ''
        self._works = False
        self._delay_s = FIRST_DELAY_S
        self._stopped = threading.Event()
        self._service: LaunchService | None = None
        self._failed: Path | None = None
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        self._thread.start()

    @property
    def trouble(self) -> str:
        """Why it does not run, or why the launch before it ended; empty if it works, or is the first."""
        if not self._cause or self._works or self._lasts_s > SETTLED_S:
            return ''
        return self._cause if self._began_s is None else f'restarted, not stable yet; last failure: {self._cause}'

    def report_works(self) -> None:
        """The present launch works, though it may not have lasted long."""
        self._works = self._began_s is not None

    def stop(self) -> None:
        """End the launch and do not restart it; from any thread, returns at once."""
        with self._lock:
            self._stopped.set()
            if self._service is not None:
                self._service.shutdown('the hand ends')

    def join(self, within_s: float) -> None:
        self._thread.join(within_s)

    @property
    def _lasts_s(self) -> float:
        began_s = self._began_s  # read once: the thread of the launch sets it
        return 0.0 if began_s is None else monotonic_s() - began_s

    def _run(self) -> None:
        while not self._stopped.is_set():
            self._began_s = monotonic_s()
            try:
                self._launch()
            except TactileError as error:
                self._complaint = str(error)
            except OSError as error:  # a full disk, no more processes: it may pass
                self._complaint = f'it could not be started: {error.strerror or error} ({error.filename})'
            except RuntimeError as error:  # no more threads: likewise
                self._complaint = f'it could not be started: {error}'
            settled, cause = self._lasts_s > SETTLED_S, self._complaint or 'it ended'
            delay_s = FIRST_DELAY_S if settled else self._delay_s
            self._clear_logs(again=cause == self._cause and not settled)
            self._cause, self._began_s, self._works = cause, None, False
            self._delay_s = min(2 * delay_s, LONGEST_DELAY_S)
            self._number += 1
            self._stopped.wait(delay_s)

    def _clear_logs(self, *, again: bool) -> None:
        """Remove the logs of the launch before the one that has ended, if both failed for the same reason."""
        if again and self._failed is not None:
            shutil.rmtree(self._failed, ignore_errors=True)
        self._failed = self._service.log_folder if self._service is not None else None

    def _launch(self) -> None:
        self._complaint = ''
        with self._lock:
            self._service = None
        service = self._make(self._take_line, self._number)
        with self._lock:
            if self._stopped.is_set():
                return
            self._service = service
        if service.run() == 0:
            self._complaint = ''  # it went on after what it complained of, maybe for days

    def _take_line(self, line: Line) -> None:
        if line.level == 'ERROR':
            self._complaint = line.text
        self._screen(line)
