"""Motion of a machine: straight lines with speed and acceleration, as functions of time.

Every block starts and ends at rest, so a path of many short blocks takes longer here than on the machine. A real Grbl
joins blocks at speed where their directions allow, but an indentation plan stops at every point anyway.
"""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass
from functools import cached_property

Vector = tuple[float, float, float]

S = 1e9  # nanoseconds in a second
KEPT_SEGMENTS = 20_000


def plus(a: Vector, b: Vector, factor: float = 1.0) -> Vector:
    """a + factor b."""
    return (a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2])


def length(a: Vector) -> float:
    """Euclidean length."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


def limited(unit: Vector, limits: Vector) -> float:
    """The largest value along a direction, for a quantity with a limit on each axis."""
    return min((limit / abs(part) for part, limit in zip(unit, limits, strict=True) if part), default=math.inf)


@dataclass(frozen=True)
class Trapezoid:
    """A move from rest to rest: accelerate, cruise, decelerate. 10 mm at 10 mm/s with 100 mm/s² takes 1.1 s."""

    length_mm: float
    feed_mm_s: float
    acceleration: float

    @cached_property
    def peak(self) -> float:
        """The greatest speed reached, which is lower on a short line."""
        return min(self.feed_mm_s, math.sqrt(self.acceleration * self.length_mm))

    @cached_property
    def duration_s(self) -> float:
        peak = self.peak
        return self.length_mm / peak + peak / self.acceleration if peak > 0 else 0.0

    def distance(self, time_s: float) -> float:
        if time_s <= 0:
            return 0.0
        left_s = self.duration_s - time_s
        if left_s <= 0:
            return self.length_mm
        ramp_s = self.peak / self.acceleration
        if time_s < ramp_s:
            return self.acceleration * time_s**2 / 2
        if left_s < ramp_s:
            return self.length_mm - self.acceleration * left_s**2 / 2
        return self.peak * (time_s - ramp_s / 2)

    def speed(self, time_s: float) -> float:
        left_s = self.duration_s - time_s
        if time_s <= 0 or left_s <= 0:
            return 0.0
        return min(self.peak, self.acceleration * time_s, self.acceleration * left_s)


@dataclass(frozen=True)
class Braking:
    """Deceleration from a speed to rest: 10 mm/s with 100 mm/s² takes 0.1 s and 0.5 mm."""

    from_mm_s: float
    deceleration: float

    @property
    def duration_s(self) -> float:
        return self.from_mm_s / self.deceleration

    def distance(self, time_s: float) -> float:
        t = min(max(time_s, 0.0), self.duration_s)
        return self.from_mm_s * t - self.deceleration * t * t / 2

    def speed(self, time_s: float) -> float:
        return max(0.0, self.from_mm_s - self.deceleration * time_s) if time_s >= 0 else 0.0


@dataclass(frozen=True)
class Segment:
    """One straight line, with its start time."""

    start_ns: int
    origin: Vector
    unit: Vector
    shape: Trapezoid | Braking | Until

    @property
    def end_ns(self) -> int:
        return self.start_ns + math.ceil(self.shape.duration_s * S)

    def position(self, time_ns: int) -> Vector:
        return plus(self.origin, self.unit, self.shape.distance((time_ns - self.start_ns) / S))

    def speed(self, time_ns: int) -> float:
        """The speed at a time in mm/s."""
        return self.shape.speed((time_ns - self.start_ns) / S)


def line(start_ns: int, origin: Vector, target: Vector, feed_mm_s: float, acceleration: Vector) -> Segment:
    """A straight line from rest to rest at a feed."""
    way = plus(target, origin, -1.0)
    total = length(way)
    unit = plus((0.0, 0.0, 0.0), way, 1 / total) if total > 0 else (0.0, 0.0, 0.0)
    most = limited(unit, acceleration) if total > 0 else 1.0
    return Segment(start_ns, origin, unit, Trapezoid(total, feed_mm_s, most))


class Timeline:
    """The position of a point at any time: successive lines, with rest between them."""

    def __init__(self, start: Vector) -> None:
        self._start = start
        self._segments: list[Segment] = []
        self._starts: list[int] = []

    @property
    def end(self) -> Vector:
        return self._segments[-1].position(self.end_ns) if self._segments else self._start

    @property
    def end_ns(self) -> int:
        """The time at which it comes to rest; 0 if it never moved."""
        return self._segments[-1].end_ns if self._segments else 0

    def append(self, segment: Segment) -> None:
        """Add a line. It must start at the end of the last one, after its motion has come to rest."""
        self._segments.append(segment)
        self._starts.append(segment.start_ns)
        if len(self._segments) > KEPT_SEGMENTS:
            half = KEPT_SEGMENTS // 2
            self._start = self._segments[half - 1].position(self._segments[half - 1].end_ns)
            del self._segments[:half], self._starts[:half]

    def position(self, time_ns: int) -> Vector:
        segment = self._segment(time_ns)
        return segment.position(time_ns) if segment is not None else self._start

    def speed(self, time_ns: int) -> float:
        """The speed at a time in mm/s."""
        segment = self._segment(time_ns)
        return segment.speed(time_ns) if segment is not None else 0.0

    def brake(self, time_ns: int, deceleration: float | None = None) -> int:
        """Stop on the current line, at once if no deceleration is given; drop later lines. Returns the time of rest."""
        segment = self._segment(time_ns)
        if segment is None or segment.end_ns <= time_ns:
            self._forget_after(time_ns)
            return time_ns
        speed, place = segment.speed(time_ns), segment.position(time_ns)
        if deceleration is None:
            stop = Segment(time_ns, place, segment.unit, Trapezoid(0.0, 1.0, 1.0))
        else:
            stop = Segment(time_ns, place, segment.unit, Braking(speed, deceleration))
        self._forget_after(time_ns)
        self._segments[-1] = Segment(segment.start_ns, segment.origin, segment.unit, Until(segment, time_ns))
        self.append(stop)
        return stop.end_ns

    def _forget_after(self, time_ns: int) -> None:
        kept = bisect.bisect_right(self._starts, time_ns)
        del self._segments[kept:], self._starts[kept:]

    def _segment(self, time_ns: int) -> Segment | None:
        index = bisect.bisect_right(self._starts, time_ns) - 1
        return self._segments[index] if index >= 0 else None


class Until:
    """A line that is cut off before its end by the next one."""

    def __init__(self, segment: Segment, time_ns: int) -> None:
        self._shape = segment.shape
        self.duration_s = (time_ns - segment.start_ns) / S

    def distance(self, time_s: float) -> float:
        return self._shape.distance(min(time_s, self.duration_s))

    def speed(self, time_s: float) -> float:
        return self._shape.speed(time_s) if time_s < self.duration_s else 0.0
