"""An axis that sticks or loses steps shows in the gel: the image of a press at the anchor is no longer the same."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rehearsing import ALL, SAFE_Z_MM, TABLE, Dots, Run, changed, reject

from tactile_nodes.collection.press.cycle import Record
from tactile_nodes.collection.readings import frame_of
from tactile_nodes.collection.run.anchors import follows, imprint, shift_px
from tactile_nodes.errors import ConfigurationError, DeviceFaultError
from tactile_nodes.simulation.optics import Press

EVERY = 3
SETTINGS = changed(anchor={'every': EVERY})


def image_of(dots: Dots, x_mm: float, y_mm: float, depth_mm: float) -> np.ndarray:
    return dots.see(Press(x_mm, y_mm, depth_mm))


@pytest.fixture(scope='module')
def dots() -> Dots:
    return Dots()


@pytest.mark.parametrize(('x_mm', 'y_mm'), [(0.0, 0.0), (0.1, 0.0), (0.0, -0.2), (0.3, 0.2)])
def test_images_of_two_presses_tell_how_far_they_are_apart(dots: Dots, x_mm: float, y_mm: float) -> None:
    rest = image_of(dots, 0.0, 0.0, 0.0)
    first, second = (imprint(rest, image_of(dots, *place, 1.0)) for place in ((0.0, 0.0), (x_mm, y_mm)))
    wanted = (x_mm * Dots.PX_PER_MM, y_mm * Dots.PX_PER_MM)
    # Dense flow makes up to a quarter too much of it here; a run measures that when it sets out its anchor.
    assert shift_px(first, second) == pytest.approx(wanted, abs=0.15 + 0.25 * max(map(abs, wanted)))


def test_deeper_press_is_not_one_beside_it(dots: Dots) -> None:
    rest = image_of(dots, 0.0, 0.0, 0.0)
    first, second = (imprint(rest, image_of(dots, 0.0, 0.0, depth_mm)) for depth_mm in (1.0, 1.2))
    assert shift_px(first, second) == pytest.approx((0.0, 0.0), abs=0.15)


def test_image_that_follows_both_axes_tells_how(dots: Dots) -> None:
    turned = np.array([[0.0, -5.0], [5.0, 0.0]])  # a camera that is mounted a quarter turned
    assert (follows(turned, 0.5, 160) == turned).all()


@pytest.mark.parametrize(('axis', 'px_per_mm'), [('x', [[0.1, 0.0], [0.0, 5.0]]), ('y', [[5.0, 0.0], [0.0, 0.1]])])
def test_axis_that_the_image_does_not_follow_is_named(axis: str, px_per_mm: list[list[float]]) -> None:
    with pytest.raises(DeviceFaultError, match=f'does not follow the {axis} axis'):
        follows(np.array(px_per_mm), 0.5, 160)


def test_axes_that_move_the_image_the_same_way_are_refused() -> None:
    with pytest.raises(DeviceFaultError, match='the same direction'):
        follows(np.array([[5.0, 4.9], [0.0, 0.5]]), 0.5, 160)


def test_sound_run_is_anchored_to_its_end(tmp_path: Path, dots: Dots) -> None:
    run = Run(tmp_path, SETTINGS, dots=dots)
    run.campaign.run()
    assert sorted(run.recorded) == ALL
    assert not run.journal.unconfirmed()
    assert not run.suspects


def test_axis_that_sticks_makes_the_presses_since_the_last_anchor_suspect(tmp_path: Path, dots: Dots) -> None:
    first = Run(tmp_path, SETTINGS, dots=dots)
    first.at(EVERY + 1, lambda: first.world.stick(0, first.rig.clock.now_ns()))
    with pytest.raises(DeviceFaultError, match=r'all presses since the last good anchor \(3\) are suspect'):
        first.campaign.run()
    late = [(record.point.press, record.attempt) for record in first.published[EVERY:]]
    assert first.suspects == late
    assert first.journal.done == first.campaign.progress.done == EVERY
    assert first.height_mm == pytest.approx(SAFE_Z_MM, abs=0.01)
    first.journal.close()
    second = Run(tmp_path, SETTINGS, dots=dots)
    second.campaign.run()
    trusted = [record.point.press for record in first.published[:EVERY]]
    assert sorted(trusted + second.recorded) == ALL
    assert {record.attempt for record in second.published} == {1, 2}


def lose(run: Run, axis: int, way_mm: float) -> Callable[[], None]:
    """The axis sticks from then on for so much of its way."""

    def stick() -> None:
        begun = run.world.motor_at(run.rig.clock.now_ns())[axis]
        over: list[bool] = []
        run.world.stick(axis, run.rig.clock.now_ns())

        def look() -> None:
            now_ns = run.rig.clock.now_ns()
            if not over and abs(run.world.motor_at(now_ns)[axis] - begun) >= way_mm:
                over.append(True)
                run.world.stick(axis, now_ns, stuck=False)

        run.rig.clock.every(0.005, look)

    return stick


@pytest.mark.parametrize('axis', [0, 1, 2])
def test_steps_that_were_lost_once_are_noticed_and_counted(tmp_path: Path, dots: Dots, axis: int) -> None:
    run = Run(tmp_path, SETTINGS, dots=dots)
    run.at(2, lose(run, axis, 0.3))
    with pytest.raises(DeviceFaultError, match='the anchor is displaced') as caught:
        run.campaign.run()
    found = re.search(r'x ([-+.0-9]+), y ([-+.0-9]+), z ([-+.0-9]+) mm', str(caught.value))
    assert found is not None
    now_ns = run.rig.clock.now_ns()
    lost = [tip - motor for tip, motor in zip(run.world.tip_at(now_ns), run.world.motor_at(now_ns), strict=True)]
    assert [float(each) for each in found.groups()] == pytest.approx(lost, abs=0.1)


@pytest.mark.parametrize(('axis', 'name'), [(0, 'x'), (1, 'y')])
def test_axis_that_is_stuck_from_the_start_ends_the_run_before_the_first_press(
    tmp_path: Path, dots: Dots, axis: int, name: str
) -> None:
    run = Run(tmp_path, SETTINGS, dots=dots)

    def stick() -> None:
        if 'pressing the anchor' in run.printed:
            run.world.stick(axis, run.rig.clock.now_ns())

    run.rig.clock.every(0.1, stick)
    with pytest.raises(DeviceFaultError, match=f'does not follow the {name} axis'):
        run.campaign.run()
    assert not run.published


def interrupted(folder: Path, dots: Dots, stick: bool) -> Run:
    run = Run(folder, SETTINGS, dots=dots)
    if stick:
        run.at(EVERY + 1, lambda: run.world.stick(0, run.rig.clock.now_ns()))
    run.at(EVERY + 2, lambda: setattr(run.rig.hands, 'asked_to_stop', True))
    run.campaign.run()
    run.journal.close()
    return run


def test_what_an_interrupted_run_left_counts_when_its_last_press_comes_out_the_same(tmp_path: Path, dots: Dots) -> None:
    first = interrupted(tmp_path, dots, stick=False)
    second = Run(tmp_path, SETTINGS, dots=dots)
    second.earlier = first.published
    second.campaign.run()
    assert not second.suspects
    assert sorted(first.recorded + second.recorded) == ALL


def cropped(record: Record) -> Record:
    """As if somebody had cropped the images differently then: none can be compared with those of now."""
    rest, frames = (
        [frame_of(frame.stamp_ns, frame.image[:128, :128]) for frame in kind] for kind in (record.rest, record.frames)
    )
    return dataclasses.replace(record, rest=rest, frames=frames)


@pytest.mark.parametrize('of_another_size', [False, True], ids=['its last press was elsewhere', 'other images'])
def test_what_an_interrupted_run_left_is_done_again_when_its_last_press_comes_out_otherwise(
    tmp_path: Path, dots: Dots, of_another_size: bool
) -> None:
    first = interrupted(tmp_path, dots, stick=not of_another_size)
    second = Run(tmp_path, SETTINGS, dots=dots)
    second.earlier = [cropped(each) for each in first.published] if of_another_size else first.published
    second.campaign.run()
    assert len(second.suspects) == 2
    assert sorted(first.recorded[:EVERY] + second.recorded) == ALL


def test_what_an_interrupted_run_left_is_done_again_when_its_last_press_is_too_strong_now(
    tmp_path: Path, dots: Dots
) -> None:
    """Somebody has lowered the limit meanwhile. That press is tried once, to compare it, and then set aside."""
    first = interrupted(tmp_path, dots, stick=False)
    last = next(each.point for each in reversed(first.published) if each.point.depth_mm > 1)
    second = Run(tmp_path, changed(anchor={'every': EVERY}, limits={'force_n': TABLE.force_at(1.2)}), dots=dots)
    second.earlier = first.published
    assert second.campaign.run().startswith('the plan is done except for presses that were set aside')
    assert len(second.suspects) == 2
    assert last.press in second.journal.aside
    assert last.press not in {each.point.press for each in second.published}
    assert not any(each.reason for each in second.published if each.point.depth_mm < 1)


def test_what_an_interrupted_run_left_is_done_again_when_its_last_press_can_no_longer_be_made(
    tmp_path: Path, dots: Dots, monkeypatch: pytest.MonkeyPatch
) -> None:
    """There is a bubble in the gel at that place now. The other places are pressed all the same."""
    first = interrupted(tmp_path, dots, stick=False)
    last = next(each.point for each in reversed(first.published) if each.point.depth_mm > 1)
    reject(monkeypatch, lambda point: point[1:] == last[1:], 'not steady')
    second = Run(tmp_path, SETTINGS, dots=dots)
    second.earlier = first.published
    assert second.campaign.run().startswith('the plan is done except for presses that were set aside or rejected')
    assert len(second.suspects) == 2
    assert sorted(first.recorded[:EVERY] + second.recorded) == [press for press in ALL if press != last.press]


def test_a_run_that_ends_with_presses_that_fail_each_time_is_anchored_to_its_end(
    tmp_path: Path, dots: Dots, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Four places lie beyond the rim of the gel: they are left at the end, and fail one after another."""
    first = Run(tmp_path, changed(anchor={'every': EVERY}, limits={'rejects_in_a_row': 4}), dots=dots)
    bad = {point.press for point in first.campaign._order[1::2]}
    reject(monkeypatch, lambda point: point.press in bad, 'not steady')
    with pytest.raises(DeviceFaultError, match='4 presses in a row were rejected, the last because not steady'):
        first.campaign.run()
    assert sorted(first.recorded) == [press for press in ALL if press not in bad]
    assert not first.journal.unconfirmed()
    assert first.journal.patterns == 2  # at the start and at the end
    assert first.height_mm == pytest.approx(SAFE_Z_MM, abs=0.01)


def test_anchor_deeper_than_the_limit_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r'anchor\.depth_mm'):
        Run(tmp_path, changed(anchor={'every': 5, 'depth_mm': 2.5}))
