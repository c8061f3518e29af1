"""What holds of every sample, whatever sensor it comes from: numbers, never the same ones for long, and not old."""

from __future__ import annotations

import math
from collections.abc import Sequence

from tactile_nodes.drivers.force_torque.contract import AXES, Flag, Sample, Wrench

PERIODS = 3
NS_PER_MS = 1_000_000


class SampleCheck:
    """Finds measured axes that stand still or are no number.

    What measures has noise, so equal readings in a row are rare. Noise whose standard deviation is a share s of the
    step in which the sensor counts stays within one step with the probability p = erf(1 / (s √8)) at most: 0.68 for
    s = 0.5, 0.26 for s = 1.5, 0.02 for s = 20. An axis stands still for n samples with pⁿ, six at once with p⁶ⁿ.
    Counted are the repetitions of all axes together; as many as `same_values`, 20, for each axis are a fault: 20
    samples where all repeat, 120 where one of six does. With s = 0.5 that happens to a sound sensor of six axes in one
    of 3e11 samples (0.68¹²⁰, by the 2e8 ways to share 120 repetitions among six), with s = 1.5 to one of a single axis
    in one of 4e11 (0.26²⁰): ten years at 1000 Hz. Six counts at 1e5 per newton, where 5 mN are 500 steps, and the
    24-bit converter of a load cell, whose noise is 20 steps and more, stay far from it. A single axis that is rounded
    more coarsely needs a greater `same_values`.

    Args:
        axes: which components of the wrench are measured.
        same_values: repetitions for each axis that are a fault; 0: never.
    """

    def __init__(self, axes: Sequence[str] = AXES, same_values: int = 0) -> None:
        self._measured = tuple(AXES.index(axis) for axis in axes)
        self._limit = same_values * len(self._measured)
        self._last: Sequence[float] = (math.nan,) * len(self._measured)
        self._repeated = [0] * len(self._measured)

    def flags(self, wrench: Wrench) -> int:
        """What is wrong with the numbers of the next sample, as `Flag`."""
        values = [wrench[axis] for axis in self._measured]
        pairs = zip(self._repeated, values, self._last, strict=True)
        self._repeated = [count + 1 if value == last else 0 for count, value, last in pairs]
        self._last = values
        flags = Flag.STALLED if 0 < self._limit <= sum(self._repeated) else Flag(0)
        return int(flags if all(map(math.isfinite, values)) else flags | Flag.NOT_A_NUMBER)


def permitted_ms(silence_ms: float, expected_hz: float) -> float:
    """The greatest age of the newest measurement: three periods of the rate that is expected, if they are longer.

    50 ms at 1000 Hz, 300 ms at 10 Hz. The rate that is seen would not do: a sensor that slows down would earn itself
    ever more silence.
    """
    return max(silence_ms, 1000 * PERIODS / expected_hz if expected_hz > 0 else 0.0)


def too_old(newest: Sample | None, since_ns: int, now_ns: int, limit_ms: float) -> str:
    """What is wrong with the age of the newest sample, to follow the sensor's name; empty: nothing.

    A sample counts from when it was measured, by the sensor's own clock, not from when it arrived: so a sensor that is
    silent and one whose samples wait somewhere on their way are found after the same time.

    Args:
        newest: None: none has come yet.
        since_ns: it has its full time from here.
        now_ns: the time.
        limit_ms: as `permitted_ms`.
    """
    measured_ns, arrived_ns = (newest.stamp_ns, newest.arrival_ns) if newest is not None else (since_ns, since_ns)
    if now_ns - max(measured_ns, since_ns) <= limit_ms * NS_PER_MS:
        return ''
    age_ms, silent_ms = (now_ns - measured_ns) / NS_PER_MS, (now_ns - arrived_ns) / NS_PER_MS
    if silent_ms <= limit_ms:
        return f'brings samples that were measured {age_ms:.0f} ms ago; relieve this computer, its line or its network'
    return f'has been silent for {silent_ms:.0f} ms; check its power and its cable'
