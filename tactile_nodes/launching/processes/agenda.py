"""The tasks of the launch service, now and later: a queue that any thread and any signal handler may add to."""

from __future__ import annotations

import heapq
import itertools
import queue
from collections.abc import Callable

from tactile_nodes import clock
from tactile_nodes.bus.node.taking import take

Task = Callable[[], None]

_LONGEST_S = 3600.0  # the operating system does not accept a wait of years


class Appointment:
    """A task at a later time; may be cancelled."""

    def __init__(self, task: Task) -> None:
        self.task: Task | None = task

    def cancel(self) -> None:
        self.task = None


class Agenda:
    """Tasks for one thread. It runs them one by one with `do_next`, so they need no locks."""

    def __init__(self) -> None:
        # SimpleQueue.put is safe in a signal handler, even if it interrupts another put.
        self._now: queue.SimpleQueue[Task] = queue.SimpleQueue()
        self._later: list[tuple[float, int, Appointment]] = []
        self._order = itertools.count()

    def post(self, task: Task) -> None:
        """Run a task as soon as possible; from any thread."""
        self._now.put(task)

    def after(self, seconds: float, task: Task) -> Appointment:
        """Run a task later; only from the thread of `do_next`."""
        appointment = Appointment(task)
        heapq.heappush(self._later, (clock.monotonic_s() + seconds, next(self._order), appointment))
        return appointment

    def do_next(self) -> None:
        """Wait for the next task and run it; after a very long wait, return without running one."""
        while self._later and self._later[0][2].task is None:
            heapq.heappop(self._later)
        try:
            task = take(self._now, self._patience_s())
        except queue.Empty:
            task = self._due()
        task()

    def _due(self) -> Task:
        if self._later and self._later[0][0] <= clock.monotonic_s():
            return heapq.heappop(self._later)[2].task or _nothing
        return _nothing

    def _patience_s(self) -> float | None:
        return min(max(0.0, self._later[0][0] - clock.monotonic_s()), _LONGEST_S) if self._later else None


def _nothing() -> None:
    """Replaces a cancelled task."""
