"""From a noisy number to a stable level: the median over seconds, with hysteresis."""

from __future__ import annotations

import math
from collections import deque
from enum import IntEnum

import numpy as np

NS_PER_S = 1_000_000_000
RELEASE = 0.7
"""A level ends when the number falls below this share of the limit that raised it."""
WINDOW_S, LEAST_S, LEAST_VALUES = 6.0, 3.0, 3
"""Window of the median, and the least time span and number of values before it is used."""
FEWEST, OLDEST_S = 4, 30.0
"""If evidence is rare, as on a gel that is pressed often, the window keeps so many values up to this age."""

CLEARED = 0.35
"""A `plain` number below this share of the ageing limit clears the alarm at once."""


class Level(IntEnum):
    """How far a calibration is to be trusted."""

    VALID = 0
    AGEING = 1
    INVALID = 2
    UNKNOWN = 3


class Alarm:
    """The level of one number that is 0 without a fault and grows with it.

    With limits of 0.03 and 0.1 a median of 0.05 is ageing and becomes valid again below 0.021. A single value, however
    large, changes nothing: half of the window must agree. Without new evidence the level stays. `plain`: the number is
    never small by chance (a missing picture is never found), so here one value below 0.0105 clears the alarm.
    """

    def __init__(self, ageing: float, invalid: float = math.inf, *, plain: bool = False) -> None:
        self.limits = ageing, invalid
        self._plain = plain
        self.level = Level.VALID
        self.value = math.nan
        self._values: deque[tuple[int, float]] = deque()

    def feed(self, stamp_ns: int, value: float) -> None:
        """Take the number at a stamp. A stamp before the last one restarts the window."""
        if self._values and stamp_ns < self._values[-1][0]:
            self._values.clear()
        if self._plain and value < CLEARED * self.limits[0]:
            self._values.clear()
            self.set(value)
        self._values.append((stamp_ns, value))
        while self._outdated(stamp_ns):
            self._values.popleft()
        span_s = (stamp_ns - self._values[0][0]) / NS_PER_S
        if len(self._values) >= LEAST_VALUES and span_s >= LEAST_S:
            self.set(float(np.median([each for _, each in self._values])))

    @property
    def suspects(self) -> bool:
        """Whether the last value alone is beyond the ageing limit, or the level is above valid."""
        return self.level > Level.VALID or (bool(self._values) and self._values[-1][1] >= self.limits[0])

    def set(self, value: float) -> None:
        """Take a number that needs no median, such as the mean of many."""
        self.value = value
        held = (0.0, *(RELEASE * limit for limit in self.limits))
        risen = self._level_by((0.0, *self.limits))
        kept = min(self.level, self._level_by(held))
        self.level = max(risen, kept)

    def _outdated(self, stamp_ns: int) -> bool:
        """Whether the oldest value no longer counts."""
        age_s = (stamp_ns - self._values[0][0]) / NS_PER_S
        return age_s > OLDEST_S or (age_s > WINDOW_S and len(self._values) > FEWEST)

    def clear(self) -> None:
        """Forget everything, as the reference of the number has changed."""
        self._values.clear()
        self.level, self.value = Level.VALID, math.nan

    def _level_by(self, limits: tuple[float, ...]) -> Level:
        return max(level for level, limit in zip(Level, limits, strict=False) if self.value >= limit or level == 0)
