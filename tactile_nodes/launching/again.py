"""A launch that is started again whenever it ends: beside others it fails alone, and is back when it can."""

from __future__ import annotations

import threading
from collections.abc import Callable

from tactile_nodes.clock import monotonic_s
from tactile_nodes.errors import TactileError
from tactile_nodes.launching.processes.output import Line, Screen
from tactile_nodes.launching.service import LaunchService

FIRST_DELAY_S, LONGEST_DELAY_S = 1.0, 15.0

Tell = Callable[[str], None]
"""Hears why a launch ended, or nothing when it starts; called from the launch's thread."""


class LaunchedAgain:
    """One launch after the other, in a thread. The pause between two doubles, from 1 s to 15 s, until one lasts longer.

    Args:
        make: a new service, whose screen is the one it is handed.
        tell: told of each start and end.
        screen: what the launches say.
    """

    def __init__(self, make: Callable[[Screen], LaunchService], tell: Tell, screen: Screen) -> None:
        self._make = make
        self._tell = tell
        self._screen = screen
        self._complaint = ''
        self._delay_s = FIRST_DELAY_S
        self._stopped = threading.Event()
        self._service: LaunchService | None = None
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        """End the launch, and start no other; from any thread, returns at once."""
        with self._lock:
            self._stopped.set()
            if self._service is not None:
                self._service.shutdown('the hand ends')

    def join(self, within_s: float) -> None:
        """Wait until all has ended."""
        self._thread.join(within_s)

    def _run(self) -> None:
        while not self._stopped.is_set():
            began_s = monotonic_s()
            try:
                self._launch()
            except TactileError as error:
                self._complaint = str(error)
            delay_s = FIRST_DELAY_S if monotonic_s() - began_s > LONGEST_DELAY_S else self._delay_s
            self._delay_s = min(2 * delay_s, LONGEST_DELAY_S)
            if not self._stopped.is_set():
                self._tell(f'{self._complaint or "it ended"}; started again in {delay_s:.0f} s')
            self._stopped.wait(delay_s)

    def _launch(self) -> None:
        self._complaint = ''
        service = self._make(self._heard)
        with self._lock:
            if self._stopped.is_set():
                return
            self._service = service
        self._tell('')
        service.run()

    def _heard(self, line: Line) -> None:
        if line.level == 'ERROR':
            self._complaint = line.text
        self._screen(line)
