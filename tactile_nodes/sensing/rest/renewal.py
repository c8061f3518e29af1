"""Automatic renewal of the rest image: while nothing touches, once the picture differs from the old rest image.

Changed light, a lens out of focus, lost markers and a shifted pixel grid after a knock change the scale of measured
motion. A new rest image corrects that. A touch is never mistaken for rest: motion reveals it, and an unbroken chain of
frames from one that was surely at rest excludes slow touches. `docs/stability.md` says which faults renewal corrects.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tactile_nodes.sensing.rest.reference import RestAccumulator
from tactile_nodes.shapes import UInt8

NS_PER_S = 1_000_000_000


@dataclass(frozen=True)
class RenewalOptions:
    """Options of the renewal. `frames` over at least `least_s` seconds are averaged.

    After a change of the picture without touch the rest image is renewed at once, but not within `apart_s` of the last
    renewal. This time doubles with each renewal, up to `after_s`, as flickering light has no rest image. Slow changes
    wait for `after_s`. The noise of few frames makes motion seem smaller (by a hundredth in a picture that lost
    contrast). So a renewed rest image is averaged again from the first `refined` frames that are surely at rest, even
    with touches between them.
    """

    frames: int = 4
    refined: tuple[int, ...] = (8, 16)
    least_s: float = 0.15
    apart_s: float = 2.0
    after_s: float = 60.0


@dataclass(frozen=True)
class Rested:
    """What is known of one frame: at rest by a strict check (`surely`), or only by a coarse one (`maybe`).

    `like`: the picture equals the rest image in all respects. `changed`: it differs in a way that no touch causes.
    """

    surely: bool
    maybe: bool
    like: bool
    changed: bool


class Renewal:
    """Collects frames at rest, and returns their mean when a new rest image is due."""

    def __init__(self, options: RenewalOptions | None = None) -> None:
        self._options = options or RenewalOptions()
        self._calm = False
        self._taken_ns = 0
        self._renewed_ns: int | None = None
        self._apart_s = 0.0
        self._straightening: object = None
        self._begin()
        self._offered, self._refining, self._again = 0, False, False
        self._finer = RestAccumulator()

    def taken(self, stamp_ns: int, *, renewed: bool) -> None:
        """Record that a rest image came into use, whose frames were at rest."""
        finer = renewed and self._again
        if not finer:
            self._apart_s = self._next_apart_s(stamp_ns) if renewed else 0.0
            self._renewed_ns = stamp_ns if renewed else None
        self._taken_ns, self._calm = stamp_ns, True
        self._refining = renewed and 0 < self._offered < self._options.refined[-1]
        if not finer:
            self._finer = RestAccumulator()
        self._offered, self._again = 0, False
        self._begin()

    def offer(
        self, straight: UInt8[np.ndarray, 'h w'], stamp_ns: int, rested: Rested, straightening: object = None
    ) -> UInt8[np.ndarray, 'h w'] | None:
        """Take a frame. Returns a new rest image, the mean of some frames, when one is due.

        Frames straightened by a different `straightening` are not averaged with each other.
        """
        self._calm = rested.surely or (self._calm and rested.maybe)
        if straightening != self._straightening:
            self._begin()
            self._straightening, self._finer = straightening, RestAccumulator()
        if rested.like or not self._fits(stamp_ns, rested):
            self._begin()
            return self._refined(straight, rested)
        if not self._frames.count:
            self._first_ns = stamp_ns
        self._frames.add(straight)
        if self._frames.count < self._options.frames or stamp_ns - self._first_ns < self._options.least_s * NS_PER_S:
            return None
        self._again = False
        finished = self._finished(self._frames)
        self._begin()
        return finished

    def _refined(self, straight: UInt8[np.ndarray, 'h w'], rested: Rested) -> UInt8[np.ndarray, 'h w'] | None:
        """The rest image in use, averaged from more frames. Called with frames that are like it."""
        if not self._refining or not rested.surely or rested.changed:
            return None
        self._finer.add(straight)
        if self._finer.count not in self._options.refined:
            return None
        self._refining, self._again = False, True
        return self._finished(self._finer)

    def _finished(self, frames: RestAccumulator) -> UInt8[np.ndarray, 'h w']:
        """The mean of the frames."""
        self._offered = frames.count
        return frames.image()

    def _fits(self, stamp_ns: int, rested: Rested) -> bool:
        """Whether this frame may go into a rest image."""
        since_ns = math.inf if self._renewed_ns is None else abs(stamp_ns - self._renewed_ns)
        if rested.changed:
            return self._calm and rested.maybe and since_ns >= self._apart_s * NS_PER_S
        return rested.surely and min(since_ns, stamp_ns - self._taken_ns) >= self._options.after_s * NS_PER_S

    def _next_apart_s(self, stamp_ns: int) -> float:
        """Least time to the next renewal: twice the last one, unless no renewal was needed for long."""
        options = self._options
        quiet_s = math.inf if self._renewed_ns is None else (stamp_ns - self._renewed_ns) / NS_PER_S
        if not 0 <= quiet_s < 2 * options.after_s:
            return options.apart_s
        return min(max(2 * self._apart_s, options.apart_s), options.after_s)

    def _begin(self) -> None:
        self._frames = RestAccumulator()
        self._first_ns = 0
