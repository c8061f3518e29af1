"""Where the tip may be: on the way that it was sent, at no more than the feed that it was sent with.

A line to a controller without checksums may arrive damaged, and a controller may restart unseen; both show in what it
reports. So every report is compared with the path. What lies beside it, but within what the feed allows since the last
report, is a tip that goes elsewhere: its place is known. What lies further off is no place that it can have gone to:
once, that may be a damaged report; twice in a row, the controller has lost its place.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from enum import Enum

from tactile_nodes.clock import NS_PER_S
from tactile_nodes.drivers.cnc.contract import Place
from tactile_nodes.drivers.cnc.envelope import distance_mm

NEAR_MM = 0.05  # steps, three decimals (two on Marlin), and the 0.02 mm by which an arrival may differ
HASTE = 1.5  # times the feed: more is told by no healthy controller, and a tip that strays goes no faster


class Verdict(Enum):
    """What a reported place says."""

    EXPECTED = 'on the path'
    STRAYED = 'beside the path, where the tip can have gone'
    HASTY = 'too fast'
    DOUBTFUL = 'where the tip cannot have gone, said once'
    LOST = 'where the tip cannot have gone, said again'


@dataclass(frozen=True)
class _Leg:
    start: Place
    target: Place
    feed_mm_s: float

    def is_near(self, place: Place) -> bool:
        return _distance_to(place, self.start, self.target) <= NEAR_MM


class Motion:
    """The legs that were sent and are not surely done; fed by who commands, asked by who listens, from any thread.

    Args:
        follows: reports tell where the tip is; else, as by a Marlin, they may tell where it is sent.

    Attributes:
        moving: something was asked for that is not known to be done.
        jogging: by jogs.
        doubted: the last report was doubtful.
    """

    def __init__(self, follows: bool = True) -> None:
        self.moving = self.jogging = self.doubted = False
        self._follows = follows
        self._lock = threading.Lock()
        self._legs: list[_Leg] = []
        self._seen: tuple[Place, int] | None = None

    @property
    def is_known(self) -> bool:
        """Whether it is known where the tip has to be."""
        return bool(self._legs)

    def rest(self, place: Place, now_ns: int) -> None:
        """The tip rests here."""
        with self._lock:
            self._legs = [_Leg(place, place, 0.0)]
            self._seen = (place, now_ns)
            self.doubted = False

    def forget(self) -> None:
        """Nothing is expected any more."""
        with self._lock:
            self._legs, self._seen, self.doubted = [], None, False

    def add(self, start: Place, target: Place, feed_mm_min: float) -> None:
        """The tip is sent on from `start`, where the last leg ends."""
        with self._lock:
            self._legs.append(_Leg(start, target, feed_mm_min / 60))

    def take_back(self) -> None:
        """The last leg was not sent after all."""
        with self._lock:
            if len(self._legs) > 1:
                self._legs.pop()

    def judge(self, place: Place, by_ns: int, feed_mm_min: float = 0.0) -> Verdict:
        """What a report says that came at `by_ns`; only of a known path."""
        with self._lock:
            on = next((number for number, leg in enumerate(self._legs) if leg.is_near(place)), None)
            if on is None and not self._can_have_gone(place, by_ns):
                again, self.doubted = self.doubted, True
                return Verdict.LOST if again else Verdict.DOUBTFUL
            self._seen, self.doubted = (place, by_ns), False
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
        if self._seen is None:
            return False
        seen, since_ns = self._seen
        farthest_mm = HASTE * self._fastest_mm_s() * (by_ns - since_ns) / NS_PER_S
        return distance_mm(seen, place) <= farthest_mm + NEAR_MM


def _between(a: Place, b: Place, share: float) -> Place:
    x, y, z = (one + share * (other - one) for one, other in zip(a, b, strict=True))
    return (x, y, z)


def _distance_to(place: Place, a: Place, b: Place) -> float:
    """From a place to the nearest of the straight line from `a` to `b`."""
    length = distance_mm(a, b)
    if not length:
        return distance_mm(place, a)
    along = sum((p - s) * (e - s) for p, s, e in zip(place, a, b, strict=True)) / length**2
    return distance_mm(place, _between(a, b, min(1.0, max(0.0, along))))
