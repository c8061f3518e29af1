"""A plan that the machine cannot do is refused before anything moves, and the sentence names its presses."""

from __future__ import annotations

from pathlib import Path

import pytest
from rehearsing import SAFE_Z_MM, SETTINGS, Run, changed

from tactile_nodes.collection.plan.plan import PlanSettings, Point
from tactile_nodes.collection.press.surface import HERTZ, Loading, Surface
from tactile_nodes.collection.press.workspace import check_approach, check_workspace, forceful, named
from tactile_nodes.drivers.cnc.contract import Envelope
from tactile_nodes.errors import ConfigurationError

MIDDLE = {'gel_x_mm': -60.0, 'gel_y_mm': -60.0, 'top_mm': -29.8, 'bottom_mm': -31.5, 'reach_mm': 10.0}
BOX = Envelope((-120.0, -120.0, -60.0), (0.0, 0.0, 0.0))  # the gel is in the middle of it


def test_presses_outside_the_workspace_are_refused_before_anything_moves(tmp_path: Path) -> None:
    """Three columns 61 mm apart reach from x -121 to 1 mm; the workspace from -120 to 0."""
    plan = PlanSettings(columns=3, rows=1, pitch_mm=61.0, depths_mm=(0.5, 1.0))
    with pytest.raises(
        ConfigurationError,
        match=r'outside the workspace of the machine \(x -120 to 0 mm, .*: press 1 at x -61, y 0 mm, 0\.5 mm deep, '
        r'press 2 at x -61, y 0 mm, 1 mm deep, press 5 at x 61, .*, press 6 at x 61, y 0 mm, 1 mm deep$',
    ):
        Run(tmp_path, changed(surface=MIDDLE), plan)


def test_presses_at_the_rim_of_the_workspace_are_not_refused(tmp_path: Path) -> None:
    plan = PlanSettings(columns=2, rows=1, pitch_mm=120.0, depths_mm=(0.5,))
    assert Run(tmp_path, changed(surface=MIDDLE), plan).plan.box_mm == (-60.0, 0.0, 60.0, 0.0)


def test_presses_below_the_workspace_are_refused_before_anything_moves() -> None:
    """From the height where the search starts, -29.8 mm, 1.5 mm lead to -31.3."""
    points, low = [Point(1, 0.0, 0.0, 1.0), Point(2, 0.0, 0.0, 1.5)], (-120.0, -120.0, -31.0)
    settings = changed(surface={**MIDDLE, 'bottom_mm': -31.0})
    with pytest.raises(ConfigurationError, match=r'z -31 to 0 mm.*: press 2 at x 0, y 0 mm, 1\.5 mm deep$'):
        check_workspace(points, settings, Envelope(low, BOX.highest_mm))


def test_presses_that_the_surface_found_puts_below_the_workspace_are_refused_before_the_first_press() -> None:
    points, box = [Point(1, 0.0, 0.0, 1.0), Point(2, 10.0, 0.0, 1.0)], Envelope((-120.0, -120.0, -31.1), BOX.highest_mm)
    settings = changed(surface={**MIDDLE, 'bottom_mm': -31.0})
    check_workspace(points, settings, box)
    check_workspace(points, settings, box, Surface(-30.0))
    with pytest.raises(ConfigurationError, match=r'mm\)[^:]*: press 2 at x 10, '):
        check_workspace(points, settings, box, Surface(-30.0, slope_x=-0.02))  # 0.2 mm lower at press 2


@pytest.mark.parametrize(
    'settings',
    [
        changed(surface={**MIDDLE, 'bottom_mm': -60.1}),
        changed(surface={**MIDDLE, 'reach_mm': 60.1}),
        changed(surface=MIDDLE, anchor={'every': 50, 'x_mm': 59.6}),  # half a millimetre beside it is pressed as well
    ],
)
def test_a_search_or_an_anchor_outside_the_workspace_is_refused(settings: object) -> None:
    with pytest.raises(ConfigurationError, match=r'surface search .* or the anchor lies outside the workspace'):
        check_workspace([Point(1, 0.0, 0.0, 1.0)], settings, BOX)  # type: ignore[arg-type]


def test_an_approach_outside_the_workspace_is_refused() -> None:
    """2 mm down from -29.8 mm is -31.8 mm."""
    check_approach(60.0, 0.0, 2.0, changed(surface=MIDDLE), BOX)
    low = Envelope((-120.0, -120.0, -31.7), BOX.highest_mm)
    for x_mm, box in ((60.1, BOX), (0.0, low)):
        with pytest.raises(ConfigurationError, match=rf'x_mm {x_mm:g} and y_mm 0, 2 mm down .* leaves the workspace'):
            check_approach(x_mm, 0.0, 2.0, changed(surface=MIDDLE), box)


def test_presses_that_are_too_deep_are_named(tmp_path: Path) -> None:
    """Each second of twelve is 1.5 mm deep; five are named."""
    plan = PlanSettings(columns=3, rows=2, pitch_mm=4.0, depths_mm=(0.5, 1.5))
    with pytest.raises(ConfigurationError, match=r'allows 1 mm; .*: press 2 at x -4, .*, press 10 at .* and 1 more$'):
        Run(tmp_path, changed(limits={'depth_mm': 1.0}), plan)


def test_presses_that_will_be_too_strong_are_told_before_the_first(tmp_path: Path) -> None:
    """The force is known from the search for the surface on: 1 (N^2/3)/mm give 1 N at 1 mm, and 1.84 N at 1.5 mm."""
    surface = Surface(-30.0, softest=Loading(-30.0, 1.0, HERTZ))
    points = [Point(1, 0.0, 0.0, 0.99), Point(2, 1.0, 0.0, 1.5)]
    assert list(forceful(points, changed(limits={'force_n': 1.0}), surface)) == points[1:]
    assert not forceful(points, SETTINGS, surface)  # 3 N
    assert named(points[1:]) == 'press 2 at x 1, y 0 mm, 1.5 mm deep'
    run = Run(tmp_path, changed(limits={'force_n': 0.5, 'rejects_in_a_row': 20}))
    run.campaign.run()
    first = next(
        number for number, line in enumerate(run.printed) if 'expected to exceed limits.force_n, 0.5 N' in line
    )
    assert 'limits.force_n, 0.5 N: 4 (press ' in run.printed[first]
    assert not any('set aside' in line for line in run.printed[:first])
    assert run.height_mm == pytest.approx(SAFE_Z_MM, abs=0.01)
