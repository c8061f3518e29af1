"""Checks of every sample, for any sensor: valid numbers, not frozen, not old."""

from __future__ import annotations

import math
from collections.abc import Sequence

from tactile_nodes.drivers.force_torque.contract import AXES, Flag, Sample, Wrench

PERIODS = 3
NS_PER_MS = 1_000_000


class SampleCheck:
    """Finds measured axes that are frozen or not a number.

    A measurement has noise, so equal readings in a row are rare. If the standard deviation of the noise is a share s of
    the sensor's resolution step, a reading stays within one step with a probability of at most p = erf(1 / (s √8)):
    0.68 for s = 0.5, 0.26 for s = 1.5, 0.02 for s = 20. The check counts repetitions of all axes together;
    `same_values` (20) per axis are a fault: 20 samples if all axes repeat, 120 if one of six does. With s = 0.5 that
    happens to a working sensor with six axes in one of 3e11 samples (0.68¹²⁰, times the 2e8 ways to share 120
    repetitions among six); with s = 1.5 to one with a single axis in one of 4e11 (0.26²⁰).

    Args:
        axes: which components of the wrench are measured.
        same_values: repetitions per axis that count as a fault; 0: never.
    """

    def __init__(self, axes: Sequence[str] = AXES, same_values: int = 0) -> None:
        self._measured = tuple(AXES.index(axis) for axis in axes)
        self._limit = same_values * len(self._measured)
        self._last: Sequence[float] = (math.nan,) * len(self._measured)
        self._repeated = [0] * len(self._measured)

    def flags(self, wrench: Wrench) -> int:
        """Faults in the numbers of the next sample, as `Flag`."""
        values = [wrench[axis] for axis in self._measured]
        pairs = zip(self._repeated, values, self._last, strict=True)
        self._repeated = [count + 1 if value == last else 0 for count, value, last in pairs]
        self._last = values
        stalled = 0 < self._limit <= sum(self._repeated)
        finite = all(map(math.isfinite, values))
        return (int(Flag.STALLED) if stalled else 0) | (0 if finite else int(Flag.NOT_A_NUMBER))


def permitted_ms(silence_ms: float, expected_hz: float) -> float:
    """The largest allowed age of the newest measurement: `silence_ms`, or three expected periods if that is longer.

    50 ms at 1000 Hz, 300 ms at 10 Hz. The observed rate must not be used: a sensor that slows down would be allowed
    ever longer silence.
    """
    return max(silence_ms, 1000 * PERIODS / expected_hz if expected_hz > 0 else 0.0)


def too_old(newest: Sample | None, since_ns: int, now_ns: int, limit_ms: float) -> str:
    """A message on the age of the newest sample, to follow the sensor's name; empty if it is fine.

    The age counts from the time of measurement, by the sensor's own clock, not from arrival. So a silent sensor and
    delayed samples are both detected after the same time.

    Args:
        newest: None: there was none yet.
        since_ns: start of the time limit.
        now_ns: the time.
        limit_ms: from `permitted_ms`.
    """
    measured_ns, arrived_ns = (newest.stamp_ns, newest.arrival_ns) if newest is not None else (since_ns, since_ns)
    if now_ns - max(measured_ns, since_ns) <= limit_ms * NS_PER_MS:
        return ''
    age_ms, silent_ms = (now_ns - measured_ns) / NS_PER_MS, (now_ns - arrived_ns) / NS_PER_MS
    if silent_ms <= limit_ms:
        return f'delivers samples that are {age_ms:.0f} ms old; reduce the load of this computer, its line or network'
    return f'has been silent for {silent_ms:.0f} ms; check its power and its cable'
