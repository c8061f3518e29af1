"""Whether a frame is fresh, judged by its stamp and its age."""

from __future__ import annotations

from zlib import crc32

import numpy as np

from tactile_nodes.sensing.judge.drift_alarm import NS_PER_S
from tactile_nodes.shapes import UInt8

EARLY_S = 0.05
"""How far a stamp may lie in the future."""

IN_ORDER = 3
"""After so many frames in order, stamps that jumped back are accepted: the clock was set."""


class Freshness:
    """Detects frames that are too old, out of order, or duplicates.

    With `stale_after_s` of 0.1 a frame 0.11 s old is stale. Of the stamps 1, 3, 2, 4 s the third frame is stale, of
    1, 1 s the second. If all have the same image, those of 1, 1.06 and 1.12 s leave the third one stale.
    """

    def __init__(self, stale_after_s: float) -> None:
        self._stale_after_s = stale_after_s
        self._newest_ns: int | None = None
        self._last_ns: int | None = None
        self._in_order = self._shown = self._shown_ns = 0

    def stale(self, stamp_ns: int, age_s: float, image: UInt8[np.ndarray, 'h w'] | None = None) -> bool:
        """Whether the next frame is stale. An age of NaN is unknown and not judged, nor is an image of None."""
        late = age_s > self._stale_after_s or age_s < -EARLY_S
        repeated = image is not None and self._repeated(image, stamp_ns)
        return self._behind(stamp_ns) or late or repeated

    def _repeated(self, image: UInt8[np.ndarray, 'h w'], stamp_ns: int) -> bool:
        """Whether this very image, noise and all, was first shown too long ago (one row in 16 is compared)."""
        shown = crc32(image[::16].tobytes())
        if shown != self._shown:
            self._shown, self._shown_ns = shown, stamp_ns
        return stamp_ns - self._shown_ns > self._stale_after_s * NS_PER_S

    def _behind(self, stamp_ns: int) -> bool:
        self._in_order = self._in_order + 1 if self._last_ns is None or stamp_ns > self._last_ns else 0
        self._last_ns = stamp_ns
        if self._newest_ns is not None and stamp_ns <= self._newest_ns and self._in_order < IN_ORDER:
            return True
        self._newest_ns = stamp_ns
        return False
