"""Move until a force is measured, and hold it: a control loop on the force topic that accounts for latency.

It takes one small step, then waits for a force whose image was taken after the machine came to rest, and only then
decides on the next step. So a long latency makes the loop slow, but never unstable. The step size limits the
overload: on the stiffest expected object, a step raises the force by step_mm * stiffness_n_mm.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from tactile_nodes.clock import NS_PER_S
from tactile_nodes.errors import DeviceFaultError
from tactile_nodes.messages import stamp_ns, types
from tactile_nodes.params import parameter
from tactile_nodes.sensing.judge.freshness import EARLY_S

NS_PER_MS = NS_PER_S // 1000
OK, INVALID = types.ForceDistribution.STATUS_OK, types.ForceDistribution.STATUS_INVALID


@dataclass(frozen=True)
class GuardSettings:
    """The target force, and when the approach gives up."""

    target_n: float = parameter(0.2, 'force to reach and to hold [N]', minimum=0.01)
    band_n: float = parameter(0.005, 'tolerance of the target force [N]', minimum=0.001)
    touch_n: float = parameter(
        0.03, 'below this force there is no contact, and steps have their full length [N]', minimum=0.001
    )
    limit_n: float = parameter(0.5, 'above this force the approach gives up [N]', minimum=0.02)
    hold_s: float = parameter(5.0, 'how long the force is held [s]', minimum=0.0)
    step_mm: float = parameter(0.02, 'longest step [mm]', minimum=0.001, maximum=0.2)
    stiffness_n_mm: float = parameter(
        1.0, 'largest expected stiffness, the rise of the force with depth [N/mm]', minimum=0.01
    )
    gain: float = parameter(0.7, 'fraction of the error that a step corrects', minimum=0.05, maximum=1.0)
    travel_mm: float = parameter(2.0, 'largest depth of the search for a force [mm]', minimum=0.01)
    stale_ms: float = parameter(100.0, 'a force with an older image ends the approach [ms]', minimum=1.0)
    seconds: float = parameter(60.0, 'time after which the approach gives up [s]', minimum=0.1)

    def __post_init__(self) -> None:
        if self.limit_n <= self.target_n + self.step_mm * self.stiffness_n_mm:
            raise ValueError(
                'limit_n - target_n must be larger than the force of one step, '
                f'{self.step_mm * self.stiffness_n_mm:g} N'
            )
        if not self.band_n <= self.touch_n < self.target_n:
            raise ValueError('band_n < touch_n < target_n must hold')


@dataclass(frozen=True)
class Felt:
    """The part of a force message that the loop needs: image time, force (N), validity."""

    stamp_ns: int
    force_n: float
    status: int = OK
    reasons: int = 0

    @classmethod
    def of(cls, force: types.ForceDistribution) -> Felt:
        return cls(stamp_ns(force.header.stamp), force.total, force.status, force.reasons)


@dataclass
class Hold:
    """The forces while the target is held, with their stamps: of every valid frame, not only of those in the band."""

    stamps_ns: list[int] = field(default_factory=list)
    forces_n: list[float] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        return (self.stamps_ns[-1] - self.stamps_ns[0]) / NS_PER_S if self.stamps_ns else 0.0


def require_fresh(force: str, now_ns: int, stamp_ns: int, stale_ms: float) -> None:
    """Raises DeviceFaultError if the newest force is older than `stale_ms`, or its age cannot be known."""
    if (age_ms := (now_ns - stamp_ns) / NS_PER_MS) > stale_ms:
        raise DeviceFaultError(
            f'the newest {force} is {age_ms:.0f} ms old, above {stale_ms:g} ms; check the sensor, and the load of this '
            'computer'
        )
    if age_ms < -EARLY_S * 1000:
        raise DeviceFaultError(
            f'the newest {force} is stamped {-age_ms:.0f} ms in the future, so its age is unknown; synchronize the '
            'clocks of this computer and that of the camera'
        )


class Guarded:
    """Decides on each step; gets forces and times as arguments.

    Args:
        settings: target and limits.
        start_ns: start of the approach, with the machine at rest.
    """

    def __init__(self, settings: GuardSettings, start_ns: int) -> None:
        self._settings = settings
        self._start_ns = self._rest_ns = start_ns
        self._last_ns = 0
        self._travelled_mm = 0.0
        self.steps = 0
        self.greatest_n = 0.0
        self.hold = Hold()

    @property
    def done(self) -> bool:
        """Whether the force was held for the requested time."""
        return bool(self.hold.stamps_ns) and self.hold.seconds >= self._settings.hold_s

    def rested(self, now_ns: int) -> None:
        """The last step is complete: only later images show its effect."""
        self._rest_ns = now_ns

    def step_mm(self, now_ns: int, felt: Felt | None) -> float:
        """The next step; positive is into the gel, 0.0: no step (now).

        Raises:
            DeviceFaultError: the approach must end, with the tip away from what it touches.
        """
        self._check(now_ns, felt)
        assert felt is not None
        if felt.stamp_ns == self._last_ns:
            return 0.0
        self._last_ns = felt.stamp_ns
        self._note(felt)
        if felt.status != OK or felt.stamp_ns < self._rest_ns:
            return 0.0
        return self._counted(self._wanted(felt.force_n))

    def _check(self, now_ns: int, felt: Felt | None) -> None:
        s = self._settings
        require_fresh('force', now_ns, self._start_ns if felt is None else felt.stamp_ns, s.stale_ms)
        if felt is None:
            raise DeviceFaultError('there is no force yet; start the sensor first')
        if felt.status == INVALID or not math.isfinite(felt.force_n):
            raise DeviceFaultError(f'the force is invalid for reasons {felt.reasons}; see ForceDistribution.msg')
        if felt.force_n > s.limit_n:
            raise DeviceFaultError(f'the force is {felt.force_n:.3f} N, above the limit of {s.limit_n:g} N')
        if now_ns - self._start_ns > s.seconds * NS_PER_S:
            raise DeviceFaultError(f'{s.target_n:g} N was not reached and held within {s.seconds:g} s')

    def _note(self, felt: Felt) -> None:
        """The hold starts with the first force in the band after a step. From then on every valid force counts."""
        self.greatest_n = max(self.greatest_n, felt.force_n)
        settled = felt.status == OK and felt.stamp_ns >= self._rest_ns
        if self.hold.stamps_ns or (settled and abs(felt.force_n - self._settings.target_n) <= self._settings.band_n):
            self.hold.stamps_ns.append(felt.stamp_ns)
            self.hold.forces_n.append(felt.force_n)

    def _wanted(self, force_n: float) -> float:
        s = self._settings
        if force_n < s.touch_n and not self.hold.stamps_ns:
            return s.step_mm
        error_n = s.target_n - force_n
        if abs(error_n) <= s.band_n:
            return 0.0
        return max(-s.step_mm, min(s.step_mm, s.gain * error_n / s.stiffness_n_mm))

    def _counted(self, step_mm: float) -> float:
        self._travelled_mm += step_mm
        self.steps += step_mm != 0.0
        if self._travelled_mm > self._settings.travel_mm + 1e-9:
            raise DeviceFaultError(
                f'{self._settings.target_n:g} N was not reached within {self._settings.travel_mm:g} mm'
            )
        return step_mm


Feel = Callable[[], Felt | None]
"""Returns the newest force; None before the first."""
