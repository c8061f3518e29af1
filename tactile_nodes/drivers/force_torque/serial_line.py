"""What sensors that send by themselves over a serial line have in common: missing readings."""

from __future__ import annotations

from tactile_nodes.errors import DeviceLostError

WAIT_S = 0.05
"""How long to wait for bytes before looking whether it is time to stop."""


RESTART_US = 1_000_000


def require_no_restart(time_us: int, last_us: int, port: str) -> None:
    """Raise DeviceLostError where the sensor's clock went back: it was switched off and on, and must be set up anew."""
    if time_us < last_us - RESTART_US:
        raise DeviceLostError(f'the sensor at {port} has begun anew, by its clock; see that its power is steady')


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
