"""The guarded grasp in a closed loop with the simulated gripper, fed with forces that are late as a sensor's are."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from itertools import cycle, repeat

import pytest

from tactile_nodes.clock import NS_PER_S
from tactile_nodes.collection.press.guarded import Felt
from tactile_nodes.collection.press.guarded_grasp import NEAR_MM, FeltByHand, Grasp, GraspSettings, Opening
from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.conversions import header
from tactile_nodes.emulators.gripper import Gripper, GripperSettings, pull_along
from tactile_nodes.errors import DeviceFaultError
from tactile_nodes.messages import types
from tactile_nodes.sensing.grasp import grasp_margin
from tactile_nodes.sensors import load_hand
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.touch.gripping import Finger

TICK_NS = NS_PER_S // 200
FRAME_TICKS, LATE_TICKS = 3, 8  # 66 frames a second, 40 ms late
ASSUMED_FRICTION = 0.8
SETTINGS = GraspSettings(hold_s=12.0)


@pytest.fixture(scope='module')
def finger() -> Finger:
    return Finger(Gel(), contact_table(Gel()))


class Loop:
    """Gripper, object and grasp, tick by tick."""

    def __init__(
        self, finger: Finger, gripper: GripperSettings, settings: GraspSettings = SETTINGS, resolution_mm: float = 0.0
    ) -> None:
        self.gripper = Gripper(gripper, [finger, finger], 0)
        self.grasp = Grasp(settings, 0)
        self.forces_n: list[float] = []
        self.pull_n = gripper.pull_n
        self._finger = finger
        self._estimates: deque[FeltByHand] = deque()
        self._ticks = 0
        self._resolution_mm = resolution_mm
        self._reported = Opening(0, gripper.open_mm)
        self.commands_mm: list[float] = []
        self.mute = False
        self.flicker_mm: Iterator[float] = repeat(0.0)

    def _rounded(self, opening_mm: float) -> float:
        """As a gripper with this resolution reports an opening, and understands a command."""
        return round(opening_mm / self._resolution_mm) * self._resolution_mm if self._resolution_mm else opening_mm

    def run(self, seconds: float) -> None:
        felt = None
        for _ in range(round(seconds * 200)):
            self._ticks += 1
            now_ns = self._ticks * TICK_NS
            hold = self.gripper.advance(now_ns, self.pull_n)
            self.forces_n.append(hold.normal_n)
            if self._ticks % FRAME_TICKS == 0:
                shear_n = self._finger.stiffness_n_mm(hold.depth_mm[0]) * hold.drag_mm
                margin, _ = grasp_margin(hold.normal_n, 0.01, shear_n, 0.01, ASSUMED_FRICTION)
                self._estimates.append(FeltByHand(now_ns, hold.normal_n, hold.normal_n, margin))
            while self._estimates and self._estimates[0].stamp_ns <= now_ns - LATE_TICKS * TICK_NS:
                felt = self._estimates.popleft()
            if not self.mute:
                self._reported = Opening(now_ns, self._rounded(self.gripper.opening_mm) + next(self.flicker_mm))
            command_mm = self.grasp.command_mm(now_ns, self._reported, felt) if felt else None
            if command_mm is not None:
                self.commands_mm.append(command_mm)
                self.gripper.command(self._rounded(command_mm))
            if self.grasp.done:
                return


@pytest.mark.parametrize('width_mm', [25.0, 33.3, 45.0])
def test_object_of_any_width_is_held_with_the_wanted_force(finger: Finger, width_mm: float) -> None:
    loop = Loop(finger, GripperSettings(object_mm=width_mm))
    loop.run(40.0)
    assert loop.grasp.done
    assert loop.grasp.grasped.opening_mm < width_mm
    # Half a search step of 0.4 mm beyond the surface on each side is 0.05 N: never more than the target and its band.
    assert max(loop.forces_n) <= SETTINGS.target_n + SETTINGS.band_n
    assert loop.forces_n[-1] == pytest.approx(SETTINGS.target_n, abs=SETTINGS.band_n)


def test_pull_is_answered_by_holding_harder_so_that_nothing_slips(finger: Finger) -> None:
    loop = Loop(finger, GripperSettings(object_mm=30.0, friction=0.9, pull_n=0.6, pull_after_s=2.0, pull_n_s=0.2))
    loop.run(40.0)
    assert loop.grasp.done
    # 0.3 N on each side; with a friction of 0.8 a margin of 0.4 asks for 0.3 / (0.8 x 0.6) = 0.625 N.
    assert loop.forces_n[-1] == pytest.approx(0.625, abs=SETTINGS.band_n + 0.01)
    assert loop.grasp.grasped.least_margin > 0.25
    assert not loop.gripper.lost
    assert not loop.grasp.strained


def test_without_the_guard_the_same_pull_takes_the_object_away(finger: Finger) -> None:
    careless = replace(SETTINGS, margin=0.05, limit_n=0.46)  # may not press harder than some 0.4 N
    loop = Loop(finger, GripperSettings(object_mm=30.0, friction=0.6, pull_n=0.6, pull_after_s=2.0), careless)
    with pytest.raises(DeviceFaultError, match='the held object is gone'):
        loop.run(40.0)
    assert loop.gripper.lost


def test_pull_beyond_what_is_allowed_is_held_as_hard_as_allowed_and_reported(finger: Finger) -> None:
    loop = Loop(finger, GripperSettings(object_mm=30.0, friction=0.9, pull_n=1.2, pull_after_s=1.0))
    loop.run(40.0)
    assert loop.grasp.strained
    assert max(loop.forces_n) < SETTINGS.limit_n


def test_it_holds_no_less_hard_when_the_pull_ceases(finger: Finger) -> None:
    loop = Loop(finger, GripperSettings(object_mm=30.0, pull_n=0.6, pull_after_s=1.0), replace(SETTINGS, hold_s=30.0))
    loop.run(12.0)
    hard_n = loop.forces_n[-1]
    loop.pull_n = 0.0
    loop.run(6.0)
    assert loop.gripper.pulled_n == 0.0
    assert loop.forces_n[-1] == pytest.approx(hard_n, abs=1e-6)


def test_gripper_that_moves_in_coarse_steps_holds_and_answers_a_pull(finger: Finger) -> None:
    """A gripper of 85 mm with 8 bits: it never arrives exactly where it was commanded."""
    pulled = GripperSettings(object_mm=30.0, pull_n=0.4, pull_after_s=1.0)
    loop = Loop(finger, pulled, replace(SETTINGS, hold_s=15.0), resolution_mm=85 / 255)
    loop.run(60.0)
    assert loop.grasp.done
    assert not loop.gripper.lost
    # Its next step is at most 0.33 mm, which at 0.3 N/mm is 0.1 N.
    assert SETTINGS.target_n - SETTINGS.band_n <= loop.forces_n[-1] < SETTINGS.limit_n
    assert max(loop.forces_n) < SETTINGS.limit_n


def test_gripper_that_does_not_follow_is_reported_and_not_commanded_ever_further(finger: Finger) -> None:
    loop = Loop(finger, GripperSettings(object_mm=30.0))
    loop.gripper.command = lambda _: None  # type: ignore[method-assign]
    with pytest.raises(DeviceFaultError, match=r'does not come to rest near 48\.8 mm: it reports 50\.00 mm'):
        loop.run(60.0)
    assert min(loop.commands_mm) >= 50.0 - NEAR_MM - SETTINGS.search_mm


@pytest.mark.parametrize('holding', [False, True])
def test_gripper_that_reports_nothing_any_more_ends_the_grasp(finger: Finger, holding: bool) -> None:
    loop = Loop(finger, GripperSettings(object_mm=45.0))
    loop.run(5.0 if holding else 0.3)
    assert bool(loop.grasp.grasped.began_ns) == holding
    loop.mute = True
    with pytest.raises(DeviceFaultError, match=r'has not reported its opening for 100[0-5] ms, above 1000 ms'):
        loop.run(1.1)


@pytest.mark.parametrize('flicker_mm', [(0.33, 0.0), (0.4, 0.2)])
def test_gripper_that_does_not_come_to_rest_ends_the_grasp(finger: Finger, flicker_mm: tuple[float, ...]) -> None:
    loop = Loop(finger, GripperSettings(object_mm=45.0))
    loop.run(5.0)
    loop.flicker_mm = cycle(flicker_mm)
    with pytest.raises(DeviceFaultError, match=r'does not come to rest near 4\d\.\d mm: it reports 4\d\.\d\d mm'):
        loop.run(6.0)


def test_noise_of_the_reported_opening_is_no_motion(finger: Finger) -> None:
    loop = Loop(finger, GripperSettings(object_mm=45.0))
    loop.flicker_mm = cycle([0.0, 0.02, -0.02])
    loop.run(40.0)
    assert loop.grasp.done


def _felt(now_ns: int, force_n: float = 0.0, **more: float) -> FeltByHand:
    return FeltByHand(now_ns, force_n, force_n, **more)  # type: ignore[arg-type]


def test_it_moves_only_on_a_force_that_was_seen_after_the_last_step() -> None:
    grasp = Grasp(SETTINGS, 0)
    assert grasp.command_mm(10, Opening(10, 50.0), _felt(5)) == pytest.approx(50.0 - SETTINGS.search_mm)
    assert grasp.command_mm(20, Opening(20, 50.0), _felt(15)) is None  # it has not moved yet
    assert grasp.command_mm(30, Opening(30, 49.6), _felt(18)) is None  # it has, and that was seen before
    assert grasp.command_mm(40, Opening(40, 49.6), _felt(35)) == pytest.approx(49.2)


@pytest.mark.parametrize(
    ('felt', 'opening_mm', 'now_s', 'sentence'),
    [
        (_felt(0), 50.0, 1.2, r'the newest force is 1200 ms old, above 1000 ms'),
        (_felt(10**8), 50.0, 0.01, r'the newest force is stamped 90 ms in the future'),
        (_felt(10**9, 1.0), 50.0, 1.0, r'a finger presses with 1.00 N, above the limit of 0.9 N'),
        (_felt(10**9), 4.9, 1.0, r'no contact down to an opening of 4.9 mm'),
        (_felt(61 * 10**9), 50.0, 61.0, r'0.3 N was not reached within 60 s'),
    ],
)
def test_it_gives_up_with_a_sentence(felt: FeltByHand, opening_mm: float, now_s: float, sentence: str) -> None:
    now_ns = round(now_s * NS_PER_S)
    with pytest.raises(DeviceFaultError, match=sentence):
        Grasp(SETTINGS, 0).command_mm(now_ns, Opening(now_ns, opening_mm), felt)


def test_invalid_force_lets_it_wait() -> None:
    invalid = replace(_felt(5), status=types.ForceDistribution.STATUS_INVALID)
    assert Grasp(SETTINGS, 0).command_mm(10, Opening(10, 50.0), invalid) is None


def test_of_a_hand_the_oldest_picture_the_worst_status_and_the_least_margin_count() -> None:
    margins = [types.GraspMargin(margin=0.5, margin_sigma=0.2), types.GraspMargin(margin=0.4, margin_sigma=math.nan)]
    wrench = types.HandWrench(header=header(30, 'gripper'), margins=margins)
    fingers = {'left': Felt(20, 0.3, 0, 1), 'right': Felt(25, 0.4, 1, 4)}
    assert FeltByHand.of(wrench, fingers) == FeltByHand(20, 0.3, 0.4, pytest.approx(0.3), 1, 5)


@pytest.mark.parametrize('names', [('left', 'right'), ('right', 'left')])
def test_a_finger_that_measures_nothing_does_not_hide_what_the_other_feels(names: tuple[str, str]) -> None:
    felt = {'left': Felt(20, math.nan, types.ForceDistribution.STATUS_INVALID, 4), 'right': Felt(25, 5.0)}
    found = FeltByHand.of(types.HandWrench(header=header(30, 'gripper')), {name: felt[name] for name in names})
    assert (found.least_n, found.greatest_n, found.status) == (5.0, 5.0, types.ForceDistribution.STATUS_INVALID)
    with pytest.raises(DeviceFaultError, match=r'a finger presses with 5.00 N, above the limit of 0.9 N'):
        Grasp(SETTINGS, 0).command_mm(30, Opening(30, 50.0), found)


def test_settings_that_could_press_too_hard_are_refused() -> None:
    with pytest.raises(ValueError, match='limit_n - target_n must be larger than the force of one step'):
        GraspSettings(target_n=0.8, limit_n=0.9)


def test_both_fingers_of_the_hand_that_ships_are_pulled_the_same_way() -> None:
    left, right = load_hand('gripping_fingers').sensors
    assert pull_along(left) == pytest.approx((0.0, 1.0), abs=1e-9)
    assert pull_along(right) == pytest.approx((0.0, -1.0), abs=1e-9)
