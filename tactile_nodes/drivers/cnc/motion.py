"""The possible positions of the tip: on the commanded path, at no more than the commanded feed.

A line to a controller without checksums may arrive damaged, and a controller may restart unnoticed; both show in its
reports. So every report is compared with the path. A position beside the path, but reachable at the feed since the last
report, means that the tip strays: its position is known. A position that is not reachable may be a damaged report the
first time. Twice in a row it means that the controller has lost its position.
"""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass
from enum import Enum

from tactile_nodes.clock import NS_PER_S
from tactile_nodes.drivers.cnc.contract import Place

NEAR_MM = 0.05  # steps, rounding to three decimals (two on Marlin), and 0.02 mm of tolerance of the target
HASTE = 1.5  # times the feed: no working controller reports more, and a straying tip is not faster


class Verdict(Enum):
    """The meaning of a reported position."""

    EXPECTED = 'on the path'
    STRAYED = 'beside the path, but reachable'
    HASTY = 'too fast'
    DOUBTFUL = 'not reachable, reported once'
    LOST = 'not reachable, reported again'


@dataclass(frozen=True)
class _Leg:
    start: Place
    target: Place
    feed_mm_s: float

    def is_near(self, place: Place) -> bool:
        return _distance_to(place, self.start, self.target) <= NEAR_MM


class Motion:
    """The commanded legs that may not be done yet; used by the commanding and the listening thread.

    Args:
        follows: reports give the position of the tip; else, as for a Marlin, they may give its target.

    Attributes:
        moving: motion was requested that is not known to be done.
        jogging: this motion consists of jogs.
        doubted: the last report was doubtful.
        doubtful: the position in the last doubtful report, also if another thread has had a good one since; or None.
        lowest_mm: how low the tip may be, if the expected position was lost; None: it was not, or not known before.
    """

    def __init__(self, follows: bool = True) -> None:
        self.moving = self.jogging = self.doubted = False
        self.doubtful: Place | None = None
        self.lowest_mm: float | None = None
        self._low_mm = math.inf  # the lowest height since the last rest
        self._follows = follows
        self._lock = threading.Lock()
        self._legs: list[_Leg] = []
        self._last_report: tuple[Place, int] | None = None

    @property
    def is_known(self) -> bool:
        """Whether the expected position is known."""
        return bool(self._legs)

    def rest(self, place: Place, now_ns: int) -> None:
        """Note that the tip rests here."""
        with self._lock:
            self._legs = [_Leg(place, place, 0.0)]
            self._last_report = (place, now_ns)
            self.doubted, self.lowest_mm, self._low_mm = False, None, place[2]

    def forget(self) -> None:
        """Expect no position any more."""
        with self._lock:
            self._legs, self._last_report, self.doubted, self.lowest_mm = [], None, False, None

    def lose(self) -> None:
        """Expect no position any more, but remember how low the tip may be."""
        with self._lock:
            if self._legs:
                self.lowest_mm = self._low_mm
            self._legs, self._last_report, self.doubted = [], None, False

    def add(self, start: Place, target: Place, feed_mm_min: float) -> None:
        """Add a leg from `start`, before it is sent: the tip may go there although no response comes."""
        with self._lock:
            self._legs.append(_Leg(start, target, feed_mm_min / 60))
            self._low_mm = min(self._low_mm, target[2])

    def judge(self, place: Place, by_ns: int, feed_mm_min: float = 0.0) -> Verdict:
        """The meaning of a position reported at `by_ns`; only for a known path."""
        with self._lock:
            on = next((number for number, leg in enumerate(self._legs) if leg.is_near(place)), None)
            if on is None and not self._can_have_gone(place, by_ns):
                again, self.doubted, self.doubtful = self.doubted, True, place
                return Verdict.LOST if again else Verdict.DOUBTFUL
            self._last_report, self.doubted = (place, by_ns), False
            if on is None:
                return Verdict.STRAYED
            if self.moving and feed_mm_min / 60 > HASTE * self._fastest_mm_s():
                return Verdict.HASTY
            if self._follows:
                del self._legs[:on]
            return Verdict.EXPECTED

    def _fastest_mm_s(self) -> float:
        return max(leg.feed_mm_s for leg in self._legs)

    def _can_have_gone(self, place: Place, by_ns: int) -> bool:
        if self._last_report is None:
            return False
        last_place, since_ns = self._last_report
        farthest_mm = HASTE * self._fastest_mm_s() * (by_ns - since_ns) / NS_PER_S
        return math.dist(last_place, place) <= farthest_mm + NEAR_MM


def _between(a: Place, b: Place, share: float) -> Place:
    x, y, z = (one + share * (other - one) for one, other in zip(a, b, strict=True))
    return (x, y, z)


def _distance_to(place: Place, a: Place, b: Place) -> float:
    """Distance from a place to the line segment from `a` to `b`."""
    length = math.dist(a, b)
    if not length:
        return math.dist(place, a)
    along = sum((p - s) * (e - s) for p, s, e in zip(place, a, b, strict=True)) / length**2
    return math.dist(place, _between(a, b, min(1.0, max(0.0, along))))
