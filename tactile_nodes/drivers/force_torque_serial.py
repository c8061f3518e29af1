"""What sensors that send by themselves over a serial line have in common: missing and repeated readings."""

from __future__ import annotations

WAIT_S = 0.05
"""How long to wait for bytes before looking whether it is time to stop."""


class Repetition:
    """Counts how often the very same reading came: a converter that stands still repeats, a living one has noise."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._last: object = None
        self._times = 0

    def too_often(self, reading: object) -> bool:
        """Whether this reading is one of more than `limit` equal ones in a row; never if `limit` is 0."""
        self._times = self._times + 1 if reading == self._last else 0
        self._last = reading
        return 0 < self._limit <= self._times


class Gaps:
    """How many samples are missing, from the sensor's own clock and the usual distance of its samples."""

    def __init__(self, period_ticks: float = 0.0) -> None:
        self.period_ticks = period_ticks
        self._last: int | None = None
        self._learnt: list[int] = []

    def missing(self, ticks: int) -> int:
        """Samples that should have come between the last call and this one.

        With 12 500 ticks from sample to sample, 37 480 ticks are three periods: two are missing.
        """
        step, self._last = (0 if self._last is None else ticks - self._last), ticks
        if step <= 0:
            return 0
        if self.period_ticks <= 0:
            self._learn(step)
            return 0
        return max(0, round(step / self.period_ticks) - 1)

    def _learn(self, step: int) -> None:
        self._learnt.append(step)
        if len(self._learnt) >= 7:
            self.period_ticks = float(sorted(self._learnt)[len(self._learnt) // 2])
