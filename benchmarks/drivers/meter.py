"""Measures a driver: the age of its data at delivery, the losses, and the cost.

Nothing here grows with the length of a run, so growth of the process comes from the driver.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
import psutil

from benchmarks.harness.workers import processor_s
from tactile_nodes.clock import NS_PER_S, Clock

SHORTEST_NS = 1_000.0
STEP = 1.01
BINS = 1 + math.ceil(math.log(100 * NS_PER_S / SHORTEST_NS) / math.log(STEP))
WARM_UP_SHARE = 0.05
LONGEST_WARM_UP_S = 10.0


class Durations:
    """A histogram of durations from 1 µs to 100 s, in bins 1 % wide; the maximum is exact."""

    def __init__(self) -> None:
        self._bins = np.zeros(BINS, np.int64)
        self._worst_ns = 0.0

    def add(self, durations_ns: Sequence[int] | np.ndarray) -> None:
        """Add durations."""
        values = np.asarray(durations_ns, float)
        if values.size:
            places = np.log(np.maximum(values, SHORTEST_NS) / SHORTEST_NS) / math.log(STEP)
            np.add.at(self._bins, np.minimum(places.astype(int), BINS - 1), 1)
            self._worst_ns = max(self._worst_ns, float(values.max()))

    def summary_ms(self) -> dict[str, float]:
        """Median, p99 and maximum in milliseconds; empty without durations."""
        upto = np.cumsum(self._bins)
        if upto[-1] == 0:
            return {}
        at = {f'p{level}': int(np.searchsorted(upto, level / 100 * upto[-1])) for level in (50, 99)}
        found = {name: SHORTEST_NS * STEP ** (place + 0.5) for name, place in at.items()}
        return {name: value / 1e6 for name, value in {**found, 'worst': self._worst_ns}.items()}


class Meter:
    """Counts and times of one run, without its warm-up.

    Args:
        clock: the host's clock, also used for the emulators' stamps.
        seconds: duration of the measurement.
    """

    def __init__(self, clock: Clock, seconds: float) -> None:
        self.clock = clock
        self.latency = Durations()
        self.stamp_error = Durations()
        self.extra: dict[str, Any] = {}
        self._counts: Counter[str] = Counter()
        self._process = psutil.Process()
        self._seconds = seconds
        self._begin_ns = 0
        self._cpu_s = 0.0
        self._memory: list[float] = []
        self.measuring = False

    def going_on(self) -> bool:
        """Whether to continue. The first call starts the run; call this many times a second."""
        if self._begin_ns == 0:
            warm_up_s = min(LONGEST_WARM_UP_S, WARM_UP_SHARE * self._seconds)
            self._begin_ns = self.clock.now_ns() + round(warm_up_s * NS_PER_S)
        passed_s = (self.clock.now_ns() - self._begin_ns) / NS_PER_S
        if passed_s >= 0 and not self.measuring:  # from now on, however late: a busy machine may hold up a warm-up
            self.measuring, self._cpu_s = True, processor_s(self._process)
            self._begin_ns, passed_s = self.clock.now_ns(), 0.0
        if self.measuring and passed_s >= len(self._memory) * self._seconds / 100:
            self._memory.append(self._process.memory_info().rss / 2**20)
        return passed_s < self._seconds

    def count(self, what: str, number: int = 1) -> None:
        """Add to a counter."""
        if self.measuring:
            self._counts[what] += number

    def handed_over(
        self, ages_ns: Sequence[int] | np.ndarray, stamp_errors_ns: Sequence[int] | np.ndarray = ()
    ) -> None:
        """Add data delivered by the driver: their ages, and the errors of their stamps if known."""
        if self.measuring:
            self.latency.add(ages_ns)
            self.stamp_error.add(np.abs(stamp_errors_ns))
            self._counts['received'] += len(ages_ns)

    def result(self) -> dict[str, Any]:
        """All measurements as plain data."""
        passed_s = (self.clock.now_ns() - self._begin_ns) / NS_PER_S
        half = len(self._memory) // 2
        return {
            'seconds': round(passed_s, 1),
            'per_s': self._counts['received'] / passed_s,
            'latency_ms': self.latency.summary_ms(),
            'stamp_error_ms': self.stamp_error.summary_ms(),
            **{what: self._counts[what] for what in ('received', 'lost', 'reordered', 'doubled')},
            'cpu_share': (processor_s(self._process) - self._cpu_s) / passed_s,
            'memory_mb': {
                'begin': self._memory[0],
                'half': self._memory[half],
                'end': self._memory[-1],
                'most': max(self._memory),
            },
            **self.extra,
        }


class Order:
    """Counts lost, doubled and reordered items by their sequence numbers.

    1, 2, 4, 4, 3 has one lost, one doubled and one reordered, which is the lost one.
    """

    def __init__(self, meter: Meter) -> None:
        self._meter = meter
        self._last: int | None = None

    def follow(self, numbers: Sequence[int] | np.ndarray) -> None:
        """Add the next numbers, in the order of delivery."""
        for number in numbers:
            step = 1 if self._last is None else int(number) - self._last
            self._meter.count('lost', max(0, step - 1))
            self._meter.count('doubled', step == 0)
            self._meter.count('reordered', step < 0)
            self._last = int(number) if step > 0 or self._last is None else self._last
