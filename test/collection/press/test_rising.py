"""The force on the way down, against what the gel gave when its surface was felt."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest
from rehearsing import GEL_Z_MM, SAFE_Z_MM, Run, changed

from tactile_nodes.collection.press.rising import rising
from tactile_nodes.collection.press.surface import HERTZ, Loading, Surface, softest
from tactile_nodes.collection.wrench import Tare
from tactile_nodes.drivers.force_torque.contract import Sample, Wrench
from tactile_nodes.emulators.world import World
from tactile_nodes.errors import DeviceFaultError

GEL = Surface(-30.0, softest=Loading(-30.0, 0.5, HERTZ))  # 0.354 N at 1 mm
ZERO = Tare((0.0,) * 6, (0.0,) * 6, 100, 0)
SETTINGS = changed(surface={'flat_mm': 0.05, 'least_n': 0.02}, limits={'least_share': 0.5})
SLOW = changed(motion={'press_mm_min': 60.0})


def complaint(depth_mm: float, force_n: float, surface: Surface = GEL, tare: Tare = ZERO) -> str:
    sample = Sample((0.0, 0.0, force_n, 0.0, 0.0, 0.0), 0, 0, 0, 0, 0, 0, 0, ())
    return rising(surface, tare, SETTINGS, 0.0, 0.0)((0.0, 0.0, -30.0 - depth_mm), [sample] * 4)


def test_half_of_what_the_softest_corner_gave_is_enough_and_less_is_not() -> None:
    """At 1.05 mm, of which 0.05 may be above the surface: half of 0.354 N, less 0.02 N for no touch, is 0.157 N."""
    assert complaint(1.05, 0.160) == ''
    assert 'the force is 0.15 N at 1.05 mm, but the gel gave 0.35 N' in complaint(1.05, 0.154)
    # Five sigma of the mean of four samples of 0.02 N are 0.05 N.
    noisy = Tare(ZERO.wrench, (0.0, 0.0, 0.02, 0.0, 0.0, 0.0), 100, 0)
    assert complaint(1.05, 0.110, tare=noisy) == ''
    assert complaint(1.05, 0.104, tare=noisy)


def test_too_much_force_none_above_the_surface_and_none_of_a_gel_that_was_not_felt_are_no_complaint() -> None:
    assert complaint(1.0, 3.0) == complaint(-0.5, 0.0) == complaint(0.04, 0.0) == ''
    assert complaint(2.0, 0.0, Surface(-30.0)) == ''


class Liar(World):
    """A world whose sensor measures something else from a depth of 0.3 mm on, with all the noise of a sound one."""

    tells: Callable[[float], float] | None = None

    def wrench_at(self, time_ns: int) -> Wrench:
        depth_mm = self.press_at(time_ns).depth_mm
        true = super().wrench_at(time_ns)
        if self.tells is None or depth_mm < 0.3:
            return true
        return (0.0, 0.0, self.tells(true[2]), 0.0, 0.0, 0.0)


@pytest.mark.parametrize('tells', [lambda _: 0.074, lambda true: 0.3 * true], ids=['force of 0.3 mm', 'a third'])
def test_press_whose_force_does_not_rise_stops_early_and_ends_the_run(tmp_path: Path, tells: Callable) -> None:
    """The third press is 1.5 mm deep. Half of what is expected at 0.6 mm is more than the force of 0.3 mm."""
    run = Run(tmp_path, SLOW, rate_hz=100.0)
    run.world.__class__ = Liar
    deepest = [0.0]

    def begin() -> None:
        run.world.tells = tells  # type: ignore[attr-defined]
        run.rig.clock.every(
            0.01, lambda: deepest.append(max(deepest.pop(), run.world.press_at(run.rig.clock.now_ns()).depth_mm))
        )

    run.at(1, begin)
    with pytest.raises(
        DeviceFaultError, match=r'is the sensor correct, .* Is there gel at \(-?[0-9.]+, -?[0-9.]+\) mm'
    ):
        run.campaign.run()
    assert deepest[0] < 0.95
    assert run.height_mm == pytest.approx(SAFE_Z_MM, abs=0.01)


def test_z_that_does_not_follow_its_motor_ends_the_run_on_the_way_down(tmp_path: Path) -> None:
    run = Run(tmp_path, SLOW)
    run.at(1, run.in_the_gel(lambda: run.world.stick(2, run.rig.clock.now_ns())))
    with pytest.raises(DeviceFaultError, match='N remain although the machine reports the tip up'):
        run.campaign.run()
    assert 'in the surface search: is the sensor correct, does z move' in run.published[-1].reason
    assert math.isclose(run.height_mm, GEL_Z_MM - 0.31, abs_tol=0.02)


def test_corners_that_differ_by_more_than_half_are_reported_and_not_taken_for_a_soft_gel() -> None:
    """A sensor that reported a part of the force at one corner would make every other force enough."""
    lines = [Loading(-30.0, 0.5, HERTZ), Loading(-30.0, 0.48, HERTZ)]
    assert softest(lines, 0.5).slope == 0.48
    with pytest.raises(DeviceFaultError, match=r'0\.09 N at 1 mm .* 0\.35 N another time'):
        softest([*lines, Loading(-30.0, 0.2, HERTZ)], 0.5)


def test_surface_that_is_not_felt_where_it_was_just_before_ends_the_search(tmp_path: Path) -> None:
    """The first search goes to 0.6 mm; the second stops where half of 0.11 N of it are not felt, not at the bottom."""
    run = Run(tmp_path)
    run.world.__class__ = Liar
    deepest = [0.0]

    def look() -> None:
        depth_mm = run.world.press_at(run.rig.clock.now_ns()).depth_mm
        if run.world.tells is not None:  # type: ignore[attr-defined]
            deepest[0] = max(deepest[0], depth_mm)
        elif deepest and depth_mm < 0.25 < reached[0]:  # drawn back after the first search
            run.world.tells = lambda _: 0.0  # type: ignore[attr-defined]
        reached[0] = max(reached[0], depth_mm)

    reached = [0.0]
    run.rig.clock.every(0.01, look)
    with pytest.raises(DeviceFaultError, match='but the gel gave'):
        run.campaign.run()
    assert deepest[0] < 0.5
    assert run.height_mm == pytest.approx(SAFE_Z_MM, abs=0.01)


def test_a_surface_that_is_not_felt_at_another_corner_ends_the_search_where_it_would_be_on_a_tilted_gel(
    tmp_path: Path,
) -> None:
    """With a bottom 2.6 mm below the gel; 20 mm farther a gel tilted by 0.05 (surface.tilt) lies 1 mm lower at most."""
    run = Run(tmp_path, changed(surface={'bottom_mm': -12.6}))
    corner: list[tuple[float, float]] = []
    deepest = [0.0]

    def look() -> None:
        now_ns = run.rig.clock.now_ns()
        x, y, _ = run.world.motor_at(now_ns)
        depth_mm = run.world.press_at(now_ns).depth_mm
        if depth_mm > 0.2 and not corner:
            corner.append((x, y))
        if corner and math.dist(corner[0], (x, y)) > 5:
            run.world.wrench_at = lambda _: (0.0,) * 6  # type: ignore[method-assign]
            deepest[0] = max(deepest[0], depth_mm)

    run.rig.clock.every(0.01, look)
    with pytest.raises(DeviceFaultError, match='but the gel gave'):
        run.campaign.run()
    assert 0.5 < deepest[0] < 1.5
