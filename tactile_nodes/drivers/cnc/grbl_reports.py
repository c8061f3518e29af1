"""Status reports of Grbl: requested one at a time, and detected as missing if they do not come."""

from __future__ import annotations

from collections.abc import Callable

from tactile_nodes.clock import NS_PER_S
from tactile_nodes.drivers.cnc.contract import Place
from tactile_nodes.drivers.cnc.grbl_words import Report, parse_report
from tactile_nodes.drivers.cnc.link import Silence

MOVING_S = 0.1  # between two requests during motion
SILENT_S = 0.3  # with MOVING_S and the listener's period, silence during motion is detected within 0.5 s


class Reports:
    """Requested and received reports. Used under the link's lock.

    Args:
        ask: sends the request; returns its stamp.
        period_s: between two requests at rest.
    """

    def __init__(self, ask: Callable[[], int], period_s: float) -> None:
        self._ask = ask
        self._period_s = period_s
        self._offset: Place | None = None
        self._owed_ns = 0
        self._silence = Silence()
        self.requested_ns = 0
        self.open = False
        self.factor = 1.0  # mm per unit of the reports
        self.last: Report | None = None
        self.stamp_ns = self.uncertainty_ns = 0

    @property
    def position(self) -> Place | None:
        """Machine coordinates in the last report."""
        report = self.last
        if report is None:
            return None
        if report.machine is not None or report.work is None or self._offset is None:
            return report.machine
        work, offset = report.work, self._offset
        return (work[0] + offset[0], work[1] + offset[1], work[2] + offset[2])

    @property
    def silent(self) -> bool:
        """Whether a report is overdue."""
        return self.open and self._silence.is_over(SILENT_S)

    def request(self) -> None:
        """Request a report."""
        self.requested_ns = self._ask()
        if not self.open:
            self.open, self._owed_ns = True, self.requested_ns

    def listened(self, now_ns: int) -> None:
        """Note that everything that had arrived by now was read."""
        self._silence.look(self._owed_ns if self.open else None, now_ns)

    def excuse(self, now_ns: int) -> None:
        """Start the time limit of an open request again."""
        self._owed_ns = now_ns

    def is_due(self, now_ns: int, moving: bool) -> bool:
        """Whether a request is due. An open one is repeated only after `SILENT_S`: sooner would not help."""
        since_s = (now_ns - self.requested_ns) / NS_PER_S
        period_s = min(self._period_s, MOVING_S) if moving else self._period_s
        return since_s >= (max(period_s, SILENT_S) if self.open else period_s)

    def take(self, line: str, arrival_ns: int) -> bool:
        """Store a report that has arrived; False: it is damaged."""
        report = parse_report(line, self.factor)
        if report is None:
            return False
        self._offset = report.offset or self._offset
        self.last, self.open = report, False
        self.uncertainty_ns = max(0, arrival_ns - self.requested_ns) // 2
        self.stamp_ns = arrival_ns - self.uncertainty_ns
        return True
