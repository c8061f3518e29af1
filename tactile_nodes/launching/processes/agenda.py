"""What the launch service has to do, now and later: a queue that any thread and any signal handler may add to."""

from __future__ import annotations

import heapq
import itertools
import queue
from collections.abc import Callable

from tactile_nodes import clock
from tactile_nodes.bus.node.taking import take

Task = Callable[[], None]

_LONGEST_S = 3600.0  # a wait of years is more than the operating system takes at once


class Appointment:
    """A task at a later time; may be cancelled."""

    def __init__(self, task: Task) -> None:
        self.task: Task | None = task

    def cancel(self) -> None:
        self.task = None


class Agenda:
    """Tasks for one thread, which does them one by one with `do_next`, so that they need no locks."""

    def __init__(self) -> None:
        # SimpleQueue.put is safe in a signal handler that interrupted the very same call.
        self._now: queue.SimpleQueue[Task] = queue.SimpleQueue()
        self._later: list[tuple[float, int, Appointment]] = []
        self._order = itertools.count()

    def post(self, task: Task) -> None:
        """Have a task done as soon as possible; from any thread."""
        self._now.put(task)

    def after(self, seconds: float, task: Task) -> Appointment:
        """Have a task done later; only from the thread of `do_next`."""
        appointment = Appointment(task)
        heapq.heappush(self._later, (clock.monotonic_s() + seconds, next(self._order), appointment))
        return appointment

    def do_next(self) -> None:
        """Wait for the next task, and do it; after a very long wait, return without."""
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
    """What is left of a cancelled task."""
