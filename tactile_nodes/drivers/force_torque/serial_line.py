"""Common part of sensors that send continuously over a serial line: missing samples and restarts."""

from __future__ import annotations

from tactile_nodes.errors import DeviceLostError

WAIT_S = 0.05
"""How long to wait for bytes before checking whether to stop."""

RESTART_US = 1_000_000


def require_no_restart(time_us: int, last_us: int, lead_ns: float, port: str) -> None:
    """Raise DeviceLostError if the sensor's clock went back: it was power-cycled, and must be configured again.

    Later than half-way to its wrap-around, a clock that begins again seems to jump ahead (`TickClock.lead_ns`).
    """
    if time_us < last_us - RESTART_US or lead_ns > 1000 * RESTART_US:
        raise DeviceLostError(f'the sensor at {port} has restarted (its clock went back); check its power supply')


class Gaps:
    """Counts missing samples, from the sensor's own clock and the usual interval of its samples."""

    def __init__(self, period_ticks: float = 0.0) -> None:
        self.period_ticks = period_ticks
        self._last: int | None = None
        self._learnt: list[int] = []

    def missing(self, ticks: int) -> int:
        """Samples missing between the last call and this one.

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
