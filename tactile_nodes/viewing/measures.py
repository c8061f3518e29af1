"""Statistics of the views: rates, latencies, drops, and errors of the estimates. Plain objects."""

from __future__ import annotations

import math
import statistics
from collections import OrderedDict, deque
from dataclasses import dataclass
from typing import Any

import numpy as np

NS_PER_S = 1_000_000_000
STAGES = ('acquire', 'flow', 'features', 'predict', 'transport', 'end to end')

OTHER_TIME_S = 60.0  # a force older than this is of a bag that is played, and has no latency


@dataclass(frozen=True)
class Percentiles:
    """Median and 99th percentile [s]; NaN without measurements."""

    p50: float
    p99: float


NOTHING = Percentiles(math.nan, math.nan)


def stage_times(stages: Any, end_to_end_s: float) -> tuple[float, ...]:
    """The seconds of each of `STAGES` for one frame.

    `stages` is the message's StageTimes. Transport is the rest of the total that is in no stage: all transfers between
    nodes, including the last one to the view.
    """
    measured = (stages.acquire, stages.flow, stages.features, stages.predict)
    stages_s = sum(seconds for seconds in measured if not math.isnan(seconds))
    end_to_end_s = math.nan if abs(end_to_end_s) > OTHER_TIME_S else end_to_end_s
    return (*measured, end_to_end_s - stages_s, end_to_end_s)


class Recent:
    """The frames of the last seconds: capture times, arrival times, and the duration of each stage."""

    def __init__(self, seconds: float) -> None:
        self._window_ns = round(seconds * NS_PER_S)
        self._frames: deque[tuple[int, int, tuple[float, ...]]] = deque()

    def add(self, arrival_ns: int, stamp_ns: int, times: tuple[float, ...]) -> None:
        self._frames.append((arrival_ns, stamp_ns, times))
        self.forget(arrival_ns)

    def forget(self, now_ns: int) -> None:
        while self._frames and self._frames[0][0] < now_ns - self._window_ns:
            self._frames.popleft()

    def rates_hz(self) -> tuple[float, float]:
        """Frames per second by arrival times and by stamps; NaN for fewer than two."""
        if len(self._frames) < 2:
            return math.nan, math.nan
        first, last = self._frames[0], self._frames[-1]
        return _rate(last[0] - first[0], len(self._frames)), _rate(last[1] - first[1], len(self._frames))

    def percentiles(self) -> dict[str, Percentiles]:
        if not self._frames:
            return dict.fromkeys(STAGES, NOTHING)
        columns = np.array([times for _, _, times in self._frames]).T
        return {stage: _percentiles(column) for stage, column in zip(STAGES, columns, strict=True)}


def _rate(span_ns: int, frames: int) -> float:
    return (frames - 1) * NS_PER_S / span_ns if span_ns > 0 else math.nan


def _percentiles(seconds: np.ndarray) -> Percentiles:
    measured = seconds[~np.isnan(seconds)]
    if not measured.size:
        return NOTHING
    p50, p99 = np.percentile(measured, [50, 99])
    return Percentiles(float(p50), float(p99))


class Histogram:
    """Percentiles of any number of durations in constant memory, accurate to half a percent.

    Bins are 1 % wide, from 1 µs to 100 s; a percentile is the middle of the bin that it falls into.
    """

    _WIDTH = math.log(1.01)
    _BINS = math.ceil(math.log(1e8) / _WIDTH)

    def __init__(self) -> None:
        self._counts = [0] * self._BINS
        self.total = 0

    def add(self, seconds: float) -> None:
        """Count a duration; NaN is not counted."""
        if math.isnan(seconds):
            return
        place = int(math.log(min(max(seconds, 1e-6), 100.0) / 1e-6) / self._WIDTH)
        self._counts[place] += 1
        self.total += 1

    def percentiles(self) -> Percentiles:
        return Percentiles(self._at(0.5), self._at(0.99)) if self.total else NOTHING

    def _at(self, share: float) -> float:
        wanted = math.ceil(share * self.total)
        counted = 0
        for place, number in enumerate(self._counts):
            counted += number
            if counted >= wanted:
                return 1e-6 * math.exp((place + 0.5) * self._WIDTH)
        return math.nan


class StampGaps:
    """Frames that were captured, or should have been, but have no force.

    The usual interval is the median of the recent ones; in an interval of more than 1.5 times that, frames are missing.
    Stamps that run ahead of the arrivals by more than 10 s, or back, are those of another stream, such as the next bag.
    """

    _ENOUGH = 10
    _AHEAD_NS = 10 * NS_PER_S

    def __init__(self) -> None:
        self.total = 0
        self._last_ns: tuple[int, int] | None = None
        self._intervals_ns: deque[int] = deque(maxlen=120)
        self._intervals = self._span_ns = 0

    @property
    def rate_hz(self) -> float:
        """Frames per second by their stamps, over the whole time; NaN for fewer than two."""
        return self._intervals * NS_PER_S / self._span_ns if self._intervals else math.nan

    def add(self, stamp_ns: int, arrival_ns: int) -> None:
        before_ns, self._last_ns = self._last_ns or (stamp_ns, arrival_ns), (stamp_ns, arrival_ns)
        interval_ns = stamp_ns - before_ns[0]
        if not 0 < interval_ns <= arrival_ns - before_ns[1] + self._AHEAD_NS:  # the first one, or another stream
            return
        self._intervals += 1
        self._span_ns += interval_ns
        if len(self._intervals_ns) >= self._ENOUGH:
            usual_ns = statistics.median(self._intervals_ns)
            if interval_ns > 1.5 * usual_ns:
                self.total += round(interval_ns / usual_ns) - 1
        self._intervals_ns.append(interval_ns)


def strongest(force: Any) -> int:
    """The bin of a ForceDistribution with the largest absolute force."""
    return int(np.abs(force.normal_force).argmax())


@dataclass(frozen=True)
class Pair:
    """An estimate and the truth of the same frame; both are ForceDistribution messages."""

    stamp_ns: int
    force: Any
    truth: Any

    @property
    def error_n(self) -> float:
        """Total force, estimated minus true [N]."""
        return float(self.force.total - self.truth.total)

    @property
    def distance_mm(self) -> float:
        """Distance between the true and the estimated contact [mm]; NaN unless both are in contact."""
        here, there = self.force.contact, self.truth.contact
        return math.hypot(here.x - there.x, here.y - there.y) * 1000

    @property
    def right_bin(self) -> bool | None:
        """Whether the largest bin is the true one; None without contact, or if the grids differ."""
        same_grid = (self.force.rows, self.force.cols) == (self.truth.rows, self.truth.cols)
        if not (self.truth.in_contact and same_grid and self.truth.normal_force.size):
            return None
        return strongest(self.force) == strongest(self.truth)


@dataclass(frozen=True)
class Scores:
    """Errors of the estimates, over all pairs whose estimate is not invalid."""

    pairs: int
    rmse_n: float
    contact_pairs: int
    right_bin_share: float


class Comparison:
    """Matches estimates and truths by their stamps, whichever comes first."""

    _KEPT = 256

    def __init__(self) -> None:
        self.last: Pair | None = None
        self._forces: OrderedDict[int, Any] = OrderedDict()
        self._truths: OrderedDict[int, Any] = OrderedDict()
        self._pairs = 0
        self._squares = 0.0
        self._bins: list[int] = [0, 0]  # wrong, right

    def add_force(self, stamp_ns: int, message: Any) -> None:
        self._keep(self._forces, stamp_ns, message)

    def add_truth(self, stamp_ns: int, message: Any) -> None:
        self._keep(self._truths, stamp_ns, message)

    def scores(self) -> Scores:
        """The errors so far; NaN where there is nothing to average."""
        contacts = sum(self._bins)
        rmse = math.sqrt(self._squares / self._pairs) if self._pairs else math.nan
        return Scores(self._pairs, rmse, contacts, self._bins[1] / contacts if contacts else math.nan)

    def _keep(self, place: OrderedDict[int, Any], stamp_ns: int, message: Any) -> None:
        place[stamp_ns] = message
        if len(place) > self._KEPT:
            place.popitem(last=False)
        if stamp_ns in self._forces and stamp_ns in self._truths:
            self._count(Pair(stamp_ns, self._forces.pop(stamp_ns), self._truths.pop(stamp_ns)))

    def _count(self, pair: Pair) -> None:
        if self.last is None or not 0 < self.last.stamp_ns - pair.stamp_ns < NS_PER_S:  # else it only came late
            self.last = pair
        if pair.force.status == pair.force.STATUS_INVALID or not math.isfinite(pair.error_n):
            return
        self._pairs += 1
        self._squares += pair.error_n**2
        if (right := pair.right_bin) is not None:
            self._bins[right] += 1
