"""The loop of the guarded approach, fed by hand, and against a spring whose force is reported late."""

from __future__ import annotations

import dataclasses
from collections import deque

import numpy as np
import pytest

from tactile_nodes.collection.press.guarded import Felt, Guarded, GuardSettings
from tactile_nodes.errors import DeviceFaultError
from tactile_nodes.messages import types

MS = 1_000_000
FORCE = types.ForceDistribution
SETTINGS = GuardSettings()


def guarded(**changed: float) -> Guarded:
    return Guarded(dataclasses.replace(SETTINGS, **changed), 0)


@pytest.mark.parametrize(
    ('felt', 'now_ms', 'step_mm'),
    [
        pytest.param(Felt(10 * MS, 0.0), 20, 0.02, id='a whole step where nothing is felt'),
        pytest.param(Felt(10 * MS, 0.0), 110, 0.02, id='also by a force exactly as old as allowed'),
        # 0.01 N are missing; at 1 N/mm 0.7 of that are 0.007 mm.
        pytest.param(Felt(10 * MS, 0.19), 20, 0.007, id='near the target its share of the error'),
        pytest.param(Felt(10 * MS, 0.204), 20, 0.0, id='none in the band'),
        pytest.param(Felt(10 * MS, 0.25), 20, -0.02, id='up, above the target'),
        pytest.param(Felt(10 * MS, 0.1, FORCE.STATUS_DEGRADED), 20, 0.0, id='none on a degraded force'),
    ],
)
def test_the_first_step_depends_on_the_force(felt: Felt, now_ms: int, step_mm: float) -> None:
    assert guarded().step_mm(now_ms * MS, felt) == pytest.approx(step_mm)


def test_no_step_is_taken_on_a_force_seen_before_the_last_step_ended() -> None:
    tested = guarded()
    tested.step_mm(20 * MS, Felt(10 * MS, 0.0))
    tested.rested(40 * MS)
    assert tested.step_mm(60 * MS, Felt(39 * MS, 0.0)) == 0.0
    assert tested.step_mm(80 * MS, Felt(41 * MS, 0.0)) == 0.02


def test_one_force_gives_one_step() -> None:
    tested = guarded()
    assert tested.step_mm(20 * MS, Felt(10 * MS, 0.0)) == 0.02
    assert tested.step_mm(25 * MS, Felt(10 * MS, 0.0)) == 0.0


@pytest.mark.parametrize(
    ('felt', 'now_ns', 'reason'),
    [
        (Felt(10 * MS, 0.1, FORCE.STATUS_INVALID, FORCE.REASON_DARK_IMAGE), 20 * MS, 'invalid for reasons 2'),
        (Felt(10 * MS, float('nan')), 20 * MS, 'invalid'),
        (Felt(10 * MS, 0.51), 20 * MS, r'0\.510 N, above the limit of 0\.5 N'),
        (Felt(10 * MS, 0.51, FORCE.STATUS_DEGRADED), 20 * MS, 'above the limit'),
        (Felt(10 * MS, 0.1), 111 * MS, '101 ms old, above 100 ms'),
        (Felt(80 * MS, 0.1), 20 * MS, '60 ms in the future'),
        (None, 20 * MS, 'no force yet'),
    ],
)
def test_it_gives_up_when_the_force_is_invalid_old_early_large_or_missing(
    felt: Felt | None, now_ns: int, reason: str
) -> None:
    with pytest.raises(DeviceFaultError, match=reason):
        guarded().step_mm(now_ns, felt)


def test_it_gives_up_when_nothing_is_met() -> None:
    tested = guarded(travel_mm=0.03)
    tested.step_mm(20 * MS, Felt(10 * MS, 0.0))
    with pytest.raises(DeviceFaultError, match=r'not reached within 0\.03 mm'):
        tested.step_mm(40 * MS, Felt(30 * MS, 0.0))


def test_it_gives_up_after_its_time() -> None:
    with pytest.raises(DeviceFaultError, match='within 60 s'):
        guarded().step_mm(60_001 * MS, Felt(60_000 * MS, 0.1))


def test_the_hold_begins_with_the_first_force_in_the_band_and_keeps_the_bad_ones() -> None:
    tested = guarded(hold_s=0.05)
    for stamp_ms, force_n in ((10, 0.1), (30, 0.2), (50, 0.23), (80, 0.2)):
        tested.step_mm(stamp_ms * MS + MS, Felt(stamp_ms * MS, force_n))
    assert tested.hold.forces_n == [0.2, 0.23, 0.2]
    assert tested.done


@pytest.mark.parametrize('wrong', [{'limit_n': 0.21}, {'touch_n': 0.3}])
def test_settings_that_could_not_hold_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match='must'):
        guarded(**wrong)


@pytest.mark.parametrize('delay_frames', [1, 2])
@pytest.mark.parametrize('stiffness_n_mm', [0.2, 1.0])
def test_a_spring_is_held_without_overshoot_however_late_its_force_is_reported(
    stiffness_n_mm: float, delay_frames: int
) -> None:
    """A frame every 33 ms, reported one or two frames later, of a spring that is met after 0.3 mm."""
    tested, depth_mm, now_ns = guarded(), -0.3, 0
    reported = deque([Felt(0, 0.0)] * delay_frames)
    forces = []
    while not tested.done:
        now_ns += 33 * MS
        forces.append(max(0.0, depth_mm) * stiffness_n_mm)
        reported.append(Felt(now_ns, forces[-1]))
        step_mm = tested.step_mm(now_ns, reported.popleft())
        if step_mm:
            depth_mm += step_mm
            tested.rested(now_ns + 20 * MS)
    assert max(forces) <= SETTINGS.target_n + SETTINGS.band_n
    assert np.mean(tested.hold.forces_n) == pytest.approx(SETTINGS.target_n, abs=SETTINGS.band_n)
