"""Close two fingers on an object until a force is measured, and hold it. If it is pulled, the grip is tightened.

As `guarded`: one small step, then a force whose images were taken after the gripper came to rest, then the next step.
While the object is held, the slip margin sets the force: with the friction from the hand's file, a margin m at a force
N becomes the wanted margin w at N (1 - m) / (1 - w). The force is never lowered again, because the object may be pulled
again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from tactile_nodes.clock import NS_PER_S
from tactile_nodes.collection.press.guarded import INVALID, NS_PER_MS, OK, Felt, require_fresh
from tactile_nodes.errors import DeviceFaultError
from tactile_nodes.messages import stamp_ns, types
from tactile_nodes.params import parameter

THERE_MM = 0.01
STILL_MM = 0.05  # noise of a reported opening
STILL_NS = NS_PER_S // 5  # also for a gripper to start moving after a command
NEAR_MM = 1.0  # resolution, play and scale of real grippers
RESTLESS_NS = 3 * NS_PER_S


@dataclass(frozen=True)
class GraspSettings:
    """Target force and slip margin, and when the grasp gives up."""

    target_n: float = parameter(0.3, 'force of each finger to reach and to hold [N]', minimum=0.01)
    band_n: float = parameter(0.02, 'tolerance of the target force [N]', minimum=0.001)
    touch_n: float = parameter(0.03, 'below this force there is no contact, and steps are long [N]', minimum=0.001)
    limit_n: float = parameter(0.9, 'largest force of a finger [N]', minimum=0.02)
    margin: float = parameter(
        0.4, 'slip margin to keep while holding (1: no shear, 0: slips)', minimum=0.05, maximum=0.95
    )
    hold_s: float = parameter(15.0, 'time to hold [s]', minimum=0.0)
    search_mm: float = parameter(0.4, 'closing step before contact [mm]', minimum=0.01)
    step_mm: float = parameter(0.1, 'longest closing step after contact [mm]', minimum=0.001)
    stiffness_n_mm: float = parameter(
        0.3, 'largest expected stiffness, the rise of the force with closing [N/mm]', minimum=0.01
    )
    gain: float = parameter(0.7, 'fraction of the error that a step corrects', minimum=0.05, maximum=1.0)
    least_mm: float = parameter(5.0, 'opening at which there is no object to grip [mm]', minimum=0.0)
    stale_ms: float = parameter(
        1000.0,
        'the gripper moves only on a newer force; if the force or the reported opening is older, the grasp ends [ms]',
        minimum=1.0,
    )
    seconds: float = parameter(60.0, 'time after which the grasp gives up if nothing is held [s]', minimum=0.1)

    def __post_init__(self) -> None:
        if self.limit_n <= self.target_n + self.search_mm * self.stiffness_n_mm:
            raise ValueError(
                'limit_n - target_n must be larger than the force of one step of search_mm, '
                f'{self.search_mm * self.stiffness_n_mm:g} N'
            )
        if not self.band_n <= self.touch_n < self.target_n:
            raise ValueError('band_n < touch_n < target_n must hold')


class Opening(NamedTuple):
    """The opening that the gripper reported last, and when the report arrived."""

    arrival_ns: int
    mm: float


@dataclass(frozen=True)
class FeltByHand:
    """What the loop needs of all fingers: image time, forces (N), smallest slip margin."""

    stamp_ns: int
    least_n: float
    greatest_n: float
    margin: float = math.nan
    status: int = OK
    reasons: int = 0

    @classmethod
    def of(cls, wrench: types.HandWrench, fingers: Mapping[str, Felt]) -> FeltByHand:
        """The last messages of the hand and of each finger; the oldest image counts.

        The margin is lowered by one standard deviation, to be safe; NaN if no finger reports one. A finger whose force
        is NaN (no measurement now) does not affect the others.
        """
        forces = [each.force_n for each in fingers.values() if math.isfinite(each.force_n)]
        margins = [
            each.margin - (each.margin_sigma if math.isfinite(each.margin_sigma) else 0.0)
            for each in wrench.margins if math.isfinite(each.margin)
        ]  # fmt: skip
        oldest_ns = min(stamp_ns(wrench.header.stamp), *(each.stamp_ns for each in fingers.values()))
        status = max(each.status for each in fingers.values())
        reasons = 0
        for each in fingers.values():
            reasons |= each.reasons
        return cls(
            oldest_ns,
            min(forces, default=math.nan),
            max(forces, default=math.nan),
            min(margins, default=math.nan),
            status,
            reasons,
        )


@dataclass
class Grasped:
    """A hold: the opening at which both fingers measured contact, and the forces from then on."""

    opening_mm: float = math.nan
    began_ns: int = 0
    ended_ns: int = 0
    first_n: float = math.nan
    last_n: float = math.nan
    greatest_n: float = 0.0
    least_margin: float = math.inf
    steps: int = 0

    @property
    def seconds(self) -> float:
        return (self.ended_ns - self.began_ns) / NS_PER_S if self.began_ns else 0.0

    def __str__(self) -> str:
        margin = f'{self.least_margin:.2f}' if math.isfinite(self.least_margin) else 'unknown'
        return (
            f'held for {self.seconds:.1f} s, contact at an opening of {self.opening_mm:.1f} mm: {self.first_n:.2f} N '
            f'at first, {self.last_n:.2f} N at the end, {self.greatest_n:.2f} N at most; least slip margin {margin}; '
            f'{self.steps} steps'
        )


class Grasp:
    """Decides on each command; gets forces, openings and times as arguments.

    Args:
        settings: target and limits.
        start_ns: start of the grasp.
    """

    def __init__(self, settings: GraspSettings, start_ns: int) -> None:
        self._settings = settings
        self._start_ns = self._rest_ns = self._rested_ns = start_ns
        self._last_ns = self._commanded_ns = 0
        self._command_mm = math.nan
        self._still = Opening(start_ns, math.nan)
        self._target_n = settings.target_n
        self._most_n = settings.limit_n - settings.step_mm * settings.stiffness_n_mm - 3 * settings.band_n
        self._margin = math.inf
        self.grasped = Grasped()

    @property
    def done(self) -> bool:
        """Whether it was held for the requested time."""
        return bool(self.grasped.began_ns) and self.grasped.seconds >= self._settings.hold_s

    @property
    def strained(self) -> bool:
        """Whether the force is at its limit and the margin is smaller than wanted."""
        return self._margin < self._settings.margin and self._target_n >= self._most_n

    def command_mm(self, now_ns: int, opening: Opening, felt: FeltByHand | None) -> float | None:
        """The next command to the gripper; None: no new command.

        Raises:
            DeviceFaultError: the grasp must end; the object stays held until the gripper gets another command.
        """
        if math.isnan(self._command_mm):
            self._command_mm, self._still = opening.mm, opening
        self._check(now_ns, opening, felt)
        if not self._rests(opening):
            self._rest_ns = now_ns
        if now_ns - self._rest_ns >= STILL_NS:
            self._rested_ns = now_ns
        elif now_ns - self._rested_ns > RESTLESS_NS:
            raise DeviceFaultError(
                f'the gripper does not come to rest near {self._command_mm:.1f} mm: it reports {opening.mm:.2f} mm; '
                'check that it follows gripper_command, and the noise of its reports'
            )
        if felt is None or felt.stamp_ns <= max(self._rest_ns, self._last_ns):
            return None
        self._last_ns, self._rested_ns = felt.stamp_ns, now_ns
        self._note(felt, opening.mm)
        closing_mm = self._closing_mm(felt) if felt.status == OK else 0.0
        if closing_mm == 0:
            return None
        self.grasped.steps += 1
        self._command_mm -= closing_mm
        self._rest_ns = self._commanded_ns = now_ns
        return self._command_mm

    def _rests(self, opening: Opening) -> bool:
        """Whether the gripper rests where it was commanded, or has stopped as near to it as its resolution allows."""
        if abs(opening.mm - self._still.mm) > STILL_MM:
            self._still = opening
        gap_mm = abs(opening.mm - self._command_mm)
        if gap_mm <= THERE_MM:
            return opening.arrival_ns > self._commanded_ns
        still_ns = opening.arrival_ns - max(self._still.arrival_ns, self._commanded_ns)
        return gap_mm <= NEAR_MM and still_ns >= STILL_NS

    def _check(self, now_ns: int, opening: Opening, felt: FeltByHand | None) -> None:
        s = self._settings
        if (silent_ms := (now_ns - opening.arrival_ns) / NS_PER_MS) > s.stale_ms:
            raise DeviceFaultError(
                f'the gripper has not reported its opening for {silent_ms:.0f} ms, above {s.stale_ms:g} ms; check its '
                'driver, which publishes joint_states'
            )
        force = 'valid force' if felt is not None and felt.status == INVALID else 'force'
        require_fresh(force, now_ns, self._start_ns if felt is None else felt.stamp_ns, s.stale_ms)
        if felt is not None and felt.greatest_n > s.limit_n:
            raise DeviceFaultError(f'a finger presses with {felt.greatest_n:.2f} N, above the limit of {s.limit_n:g} N')
        if opening.mm <= s.least_mm:
            raise DeviceFaultError(f'no contact down to an opening of {opening.mm:.1f} mm')
        if not self.grasped.began_ns and now_ns - self._start_ns > s.seconds * NS_PER_S:
            raise DeviceFaultError(f'{s.target_n:g} N was not reached within {s.seconds:g} s')
        if self.grasped.began_ns and felt is not None and felt.status == OK and felt.greatest_n < s.touch_n:
            raise DeviceFaultError('the held object is gone')

    def _note(self, felt: FeltByHand, opening_mm: float) -> None:
        """The hold starts with the first force at the target."""
        found, force_n = self.grasped, felt.least_n
        if felt.status != OK:
            return
        if not found.began_ns and force_n >= self._target_n - self._settings.band_n:
            found.began_ns, found.first_n, found.opening_mm = felt.stamp_ns, force_n, opening_mm
        if found.began_ns:
            found.ended_ns, found.last_n = felt.stamp_ns, force_n
            found.greatest_n = max(found.greatest_n, felt.greatest_n)
            if math.isfinite(felt.margin):
                self._margin = felt.margin
                found.least_margin = min(found.least_margin, felt.margin)
                self._target_n = self._needed_target_n(felt)

    def _needed_target_n(self, felt: FeltByHand) -> float:
        """The force that gives the wanted margin, never less than before and at most the limit."""
        needed_n = felt.least_n * (1.0 - felt.margin) / (1.0 - self._settings.margin)
        return max(self._target_n, min(needed_n, self._most_n))

    def _closing_mm(self, felt: FeltByHand) -> float:
        s = self._settings
        if felt.least_n < s.touch_n and felt.greatest_n < s.touch_n:
            return s.search_mm
        error_n = self._target_n - felt.least_n
        if abs(error_n) <= s.band_n or (error_n < 0 and self.grasped.began_ns):
            return 0.0
        return max(-s.step_mm, min(s.step_mm, s.gain * error_n / s.stiffness_n_mm))
