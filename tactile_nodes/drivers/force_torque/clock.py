"""Measurement times from the sensor's own counter and the arrival times of samples.

A sample arrives late by a constant, plus delays of the network, the USB adapter and the scheduler, which are never
negative. So arrival times plotted over the counter lie above a straight line, and touch it when there was no delay: the
lower envelope. Its slope is the drift of the sensor's crystal. (Moon, Skelly, Towsley, "Estimation and removal of clock
skew from network delay measurements", 1999.)

If the true rate of a counter is not the announced one, the line departs from the arrivals evenly from the first
second on. While the arrivals show that, samples are stamped on arrival instead, and this is reported. Delays that grow
later, or suddenly, are different: something holds the samples back, and their stamps show since when. A clock keeps its
rate: after half a minute, a slope that departs from the known one by more than a clock can wander is also such a delay,
however slowly it grows. A counter that jumps ahead of the line starts a new line, because no sample arrives before it
was measured.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from tactile_nodes.clock import NS_PER_S
from tactile_nodes.drivers.force_torque.contract import Flag
from tactile_nodes.sensing.sync.envelope import lower_line

COUNTER_BITS = 32  # after which every sensor's counter wraps
BLOCK_NS = 250_000_000
WINDOW_BLOCKS = 480  # two minutes: long compared with jitter, short compared with the warm-up of a crystal
SLOPE_AFTER_BLOCKS = 40  # ten seconds, after which drift exceeds the jitter
KNOWN_AFTER_BLOCKS = 120  # half a minute
WANDERS = 0.1  # share of `most_drift`: 50 ppm for a crystal, 1000 for a ceramic resonator; heat hardly causes more
RECENT_BLOCKS = 8
MOST_DRIFT = 500e-6
EARLY_BLOCKS = 8
EDGE_BLOCKS = 4  # a second: the smallest delay in it is small unless the host is blocked
JITTER_NS = 10e6
JUMP_NS = 20e6
EVEN = 0.15  # fraction of the growth: tolerance of the value at half time
EARLY_JITTER_NS = 200e6
NO_LEAPS = [0.0, 0.0, 0.0]  # of three pauses of the host
SETTLED_AFTER = 8  # samples
SETTLED_AFTER_NS = 100_000_000
SETTLED_AT_LAST_NS = 500_000_000  # by the host's clock, if the counter hardly moves


class TickClock:
    """Converts counter readings to stamps on the host's time base.

    Args:
        rate_hz: nominal ticks per second.
        delay_ns: constant time from measurement to arrival, subtracted from every stamp.
        most_drift: largest relative deviation from the nominal rate. A crystal deviates by up to 100 ppm, a ceramic
            resonator by up to 5000 ppm.

    Attributes:
        settled: whether there were enough samples for good stamps; stays true.
    """

    def __init__(self, rate_hz: float, delay_ns: int = 0, most_drift: float = MOST_DRIFT) -> None:
        self._ns_per_tick = NS_PER_S / rate_hz
        self._modulus = 1 << COUNTER_BITS
        self._delay_ns = delay_ns
        self._most_drift = most_drift
        self._keeps_time = self._is_timed = True
        self._x = self._y = 0.0
        self._leaps = NO_LEAPS
        self._first_ns = self._arrived_ns = 0
        self.settled = False
        self._ticks: int | None = None
        self._origin = (0, 0)
        self._count = 0
        self._blocks: deque[tuple[float, float]] = deque(maxlen=WINDOW_BLOCKS)
        self._block: tuple[float, float] | None = None
        self._block_ends = 0.0
        self._line = (0.0, 0.0)
        self._known_slope: float | None = None
        self._stamp_ns = 0

    @property
    def drift_ppm(self) -> float:
        """Drift of the sensor's clock against the host's, as observed so far; positive: too fast."""
        return -self._line[1] * 1e6

    @property
    def complaint(self) -> str:
        """A message about the stamps for a person; empty: none."""
        return (
            '' if self._keeps_time else 'its counter does not keep the announced rate: samples are stamped on arrival'
        )

    @property
    def flags(self) -> int:
        """Properties of a stamp, as `Flag`."""
        return int(Flag(0) if self._is_timed else Flag.UNTIMED)

    @property
    def drift_text(self) -> str:
        return f'{self.drift_ppm:+.0f} ppm' if self._keeps_time else 'unknown: stamped on arrival'

    def unwrapped(self, reading: int) -> int:
        """The reading without wrap-around; for a late sample, the smaller number.

        After 2³² - 1, a reading of 1 is 2³² + 1.
        """
        if self._ticks is None:
            self._ticks = reading
            return reading
        ahead = (reading - self._ticks) % self._modulus
        if ahead >= self._modulus // 2:
            return self._ticks - (self._modulus - ahead)
        self._ticks += ahead
        return self._ticks

    def lead_ns(self, ticks: int, arrival_ns: int) -> float:
        """How far the counter is ahead of the line; 0 if unknown. Only a counter that jumped or began again is."""
        if not self.settled or not self._keeps_time:
            return 0.0
        x, y = self._place(ticks, arrival_ns)
        return self._line[0] + self._line[1] * x - y

    def stamp(self, ticks: int, arrival_ns: int) -> int:
        """Measurement time of the sample with these ticks (unwrapped); strictly increasing.

        Of samples with one arrival, each that is stamped on it is a nanosecond later than the one before.
        """
        if self._count == 0:
            self._first_ns = arrival_ns
            self._begin(ticks, arrival_ns)
        x, y = self._place(ticks, arrival_ns)
        if self._is_ahead(x, y):
            self._begin(ticks, arrival_ns)
            x, y = 0.0, 0.0
        self._count += 1
        self._arrived_ns = arrival_ns - self._first_ns
        self._observe(x, y)
        late = min(y, self._line[0] + self._line[1] * x) if self._keeps_time else y
        line_ns = self._origin[1] + round(x + late) - self._delay_ns
        self._stamp_ns = max(self._stamp_ns + 1, line_ns)
        self._is_timed = self._keeps_time and self._stamp_ns - line_ns < JUMP_NS
        self.settled = self.settled or self._has_seen_enough()
        return self._stamp_ns

    def _has_seen_enough(self) -> bool:
        long_enough = min(self._elapsed_ns(), self._arrived_ns) >= SETTLED_AFTER_NS
        return self._count >= SETTLED_AFTER and (long_enough or self._arrived_ns >= SETTLED_AT_LAST_NS)

    def _observe(self, x: float, y: float) -> None:
        if len(self._blocks) < EARLY_BLOCKS and x > self._x:  # a counter that stands still does not show its rate
            self._leaps = sorted([*self._leaps, y - self._y])[1:]
            # A wrong rate makes samples later and later; a pause of the host makes them late at once.
            self._keeps_time = abs(y) < EARLY_JITTER_NS or -x / 2 < y < x or 0 < y < 2 * sum(self._leaps)
        self._x, self._y = x, y
        if self._block is None or x >= self._block_ends:
            self._end_block()
            self._block, self._block_ends = (x, y), x + BLOCK_NS
            self._refit()
        elif y < self._block[1]:
            self._block = (x, y)
            self._line = (min(self._line[0], y - self._line[1] * x), self._line[1])

    def _is_ahead(self, x: float, y: float) -> bool:
        """Whether the counter has jumped, or the first samples were delayed."""
        if not self.settled:
            return y < -JUMP_NS
        return self._keeps_time and y < self._line[0] + self._line[1] * x - JUMP_NS

    def _begin(self, ticks: int, arrival_ns: int) -> None:
        """Start a new line here."""
        self._origin = (ticks, arrival_ns)
        self._blocks.clear()
        self._block, self._line = None, (0.0, 0.0)
        self._x = self._y = 0.0
        self._leaps = NO_LEAPS
        self._keeps_time = True

    def _place(self, ticks: int, arrival_ns: int) -> tuple[float, float]:
        """The counter since the origin in ns, and the delay of the arrival."""
        x = (ticks - self._origin[0]) * self._ns_per_tick
        return x, arrival_ns - self._origin[1] - x

    def _end_block(self) -> None:
        if self._block is not None:
            self._blocks.append(self._block)

    def _refit(self) -> None:
        points = [*self._blocks, *([self._block] if self._block else [])]
        if len(self._blocks) >= EARLY_BLOCKS:
            self._keeps_time = self._kept(points)
        if not self._keeps_time:
            return
        if len(self._blocks) < SLOPE_AFTER_BLOCKS:
            self._line = (self._recent(points), 0.0)
            return
        x, y = np.array(points).T
        known_slope, steepest = (0.0, 1.0) if self._known_slope is None else (self._known_slope, WANDERS)
        at, slope = lower_line(x, y - known_slope * x, steepest * self._most_drift)
        self._line = (at, known_slope + slope)
        if self._known_slope is None and len(self._blocks) >= KNOWN_AFTER_BLOCKS:
            self._known_slope = self._line[1]

    def _recent(self, points: list[tuple[float, float]]) -> float:
        """The smallest recent delay, but no more than the smallest of all plus the largest drift since then."""
        x, y = min(points, key=lambda point: point[1])
        return min(*(y for _, y in points[-RECENT_BLOCKS:]), y + self._most_drift * max(0.0, points[-1][0] - x))

    def _kept(self, points: list[tuple[float, float]]) -> bool:
        """Whether the smallest delays do not grow evenly by more than the drift allows."""
        middle = (len(points) - EDGE_BLOCKS) // 2
        edges = (points[:EDGE_BLOCKS], points[middle : middle + EDGE_BLOCKS], points[-EDGE_BLOCKS:])
        first, half, last = (min(edge, key=lambda point: point[1]) for edge in edges)
        growth, span = last[1] - first[1], last[0] - first[0]
        if abs(growth) <= 2 * self._most_drift * abs(span) + JITTER_NS:
            return True
        even = first[1] + growth * (half[0] - first[0]) / span
        return abs(half[1] - even) > EVEN * abs(growth)

    def _elapsed_ns(self) -> float:
        return 0.0 if self._ticks is None else (self._ticks - self._origin[0]) * self._ns_per_tick
