"""The drift monitor, fed by hand and by a simulated gel: what it says, when, and what it does not say."""

from __future__ import annotations

import copy
import dataclasses
import math
from functools import cache

import numpy as np
import pytest

from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.sensing.geometry import centre_crop
from tactile_nodes.sensing.judge.drift import DriftMonitor, Limits
from tactile_nodes.sensing.judge.drift_alarm import Level
from tactile_nodes.sensing.judge.drift_verdict import Reason
from tactile_nodes.sensing.picture.change import PictureChange
from tactile_nodes.sensing.rest.reference import average
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Optics, Press

S = 1_000_000_000
NOTHING = PictureChange(1.0, 1.0, (0.0, 0.0), 0.0, 0.0, 0.001, 0.001, 0.006)
GEL = Gel()
RATE_HZ = 30
PRESSED = (Press(4.0, -3.0, 1.5),)


class Seen:
    """What a camera sees of a gel, cut."""

    def __init__(self, gel: Gel) -> None:
        self._optics = Optics(gel, contact_table(GEL))

    def picture(self, presses: tuple[Press, ...] = (), seed: int = 1) -> np.ndarray:
        return np.ascontiguousarray(centre_crop(self._optics.render(presses, seed)))

    def rest(self) -> np.ndarray:
        return average([self.picture(seed=number) for number in range(8)])


@cache
def changed(**properties: object) -> Seen:
    return Seen(dataclasses.replace(GEL, **properties))  # type: ignore[arg-type]


def knocked(px: float) -> Seen:
    """By how much the middle of the picture moves."""
    return changed(camera_tilt_deg=(0.0, math.degrees(px / GEL.focal_px_per_rad)))


@pytest.fixture(scope='module')
def plain() -> Seen:
    return Seen(GEL)


@pytest.fixture(scope='module')
def rest(plain: Seen) -> np.ndarray:
    return plain.rest()


@pytest.fixture(scope='module')
def made(rest: np.ndarray) -> DriftMonitor:
    """One that knows the calibration's rest image, and has the same now."""
    monitor = DriftMonitor()
    monitor.use_calibration(rest)
    monitor.rest(rest)
    return monitor


@pytest.fixture
def monitor(made: DriftMonitor) -> DriftMonitor:
    """The same for each test, as if it were new."""
    return copy.deepcopy(made)


def watched(
    monitor: DriftMonitor, pictures: list[np.ndarray], begin_s: float = 0.0, for_s: float = 5.0
) -> DriftMonitor:
    """Pictures in turn, one every half second."""
    for number in range(round(2 * for_s)):
        monitor.frame(round((begin_s + number / 2) * S), pictures[number % len(pictures)])
    return monitor


def held(monitor: DriftMonitor, seen: PictureChange, begin_s: int) -> tuple[Level, Reason]:
    """Level and reasons after ten seconds of one change of the picture, told every half second."""
    for number in range(20):
        monitor.change(begin_s * S + number * S // 2, seen)
    return monitor.verdict.level, monitor.verdict.reasons


def test_before_the_rest_image_nothing_is_known() -> None:
    assert DriftMonitor().verdict.level == Level.UNKNOWN


def test_an_untouched_gel_is_valid(monitor: DriftMonitor, plain: Seen) -> None:
    verdict = watched(monitor, [plain.picture(seed=7)]).verdict
    assert (verdict.level, verdict.reasons, verdict.text) == (Level.VALID, Reason(0), 'valid')
    assert verdict.quiet_ns == round(4.5 * S)


def test_a_press_that_is_held_is_no_drift(monitor: DriftMonitor, plain: Seen) -> None:
    verdict = watched(monitor, [plain.picture(PRESSED)], for_s=20).verdict
    assert verdict.level == Level.VALID
    assert verdict.quiet_ns is None


@pytest.mark.parametrize(('px', 'level'), [(0.01, Level.VALID), (0.05, Level.AGEING), (0.3, Level.INVALID)])
def test_a_knock_is_as_grave_as_the_false_force_that_it_makes(monitor: DriftMonitor, px: float, level: Level) -> None:
    verdict = watched(monitor, [knocked(px).picture()]).verdict
    assert verdict.level == level
    assert (Reason.PICTURE_MOVED in verdict.reasons) == (level > Level.VALID)
    assert verdict.moved_px == pytest.approx(px, rel=0.1, abs=0.002)


def test_bands_that_roll_over_the_picture_are_no_drift(monitor: DriftMonitor, plain: Seen) -> None:
    for number in range(12):
        bands = 30 * np.sin(np.arange(440) / 9.5 + 2.3 * number)
        picture = np.clip(plain.picture(seed=number) + bands[:, None], 0, 255).astype(np.uint8)
        monitor.frame(number * S, picture)
    assert monitor.verdict.level == Level.VALID


def test_a_knock_is_seen_while_something_presses(monitor: DriftMonitor) -> None:
    verdict = watched(monitor, [knocked(2.0).picture(PRESSED)]).verdict
    assert verdict.reasons == Reason.PICTURE_MOVED
    assert 'capture the rest image again' in verdict.text


def test_a_held_touch_that_moves_all_of_a_thick_gel_is_no_knock(monitor: DriftMonitor) -> None:
    """A ball of 5 mm with 1.4 N on 25x19 mm of a gel of 4 mm; later the camera goes as far, beside a light touch."""
    touch = dataclasses.replace(NOTHING, middle_px=0.2, size_px=0.2, left_px=1.9)
    assert held(monitor, touch, begin_s=0) == (Level.VALID, Reason(0))
    knock = dataclasses.replace(touch, left_px=0.3)
    assert held(monitor, knock, begin_s=10) == (Level.INVALID, Reason.PICTURE_MOVED)


def test_a_new_rest_image_ends_the_false_forces_and_says_how_far_off_it_lies(monitor: DriftMonitor) -> None:
    seen = knocked(2.0)
    watched(monitor, [seen.picture()])
    monitor.rest(seen.rest())
    verdict = watched(monitor, [seen.picture(seed=9)], begin_s=20).verdict
    assert (verdict.level, verdict.reasons) == (Level.AGEING, Reason.MOVED_SINCE_CALIBRATION)
    assert verdict.since_calibration is not None
    assert verdict.since_calibration.size_px == pytest.approx(2.0, rel=0.05)


@pytest.mark.parametrize(('depth_mm', 'level'), [(0.1, Level.VALID), (0.6, Level.AGEING), (1.5, Level.INVALID)])
def test_a_rest_image_with_a_touch_in_it_is_reported(
    monitor: DriftMonitor, plain: Seen, depth_mm: float, level: Level
) -> None:
    monitor.rest(plain.picture((Press(4.0, -3.0, depth_mm),)))
    verdict = monitor.verdict
    assert verdict.level == level
    assert verdict.reasons == (Reason.DENTED_REST if level else Reason(0))


def test_a_light_that_fades_is_no_matter_for_patches_until_little_is_left(monitor: DriftMonitor) -> None:
    half, fifth, tenth = (changed(light_gain=gain).picture() for gain in (0.5, 0.2, 0.1))
    assert watched(monitor, [half]).verdict.level == Level.VALID
    verdict = watched(monitor, [fifth], begin_s=20).verdict
    assert (verdict.level, verdict.reasons) == (Level.AGEING, Reason.LIGHT)
    assert '20%' in verdict.text
    assert watched(monitor, [tenth], begin_s=40).verdict.level == Level.INVALID


def test_dense_search_takes_light_for_motion_so_it_is_graver_there(rest: np.ndarray) -> None:
    monitor = DriftMonitor(Limits.of_flow('dis'))
    monitor.rest(rest)
    assert watched(monitor, [changed(light_gain=0.7).picture()]).verdict.level == Level.INVALID


def test_a_tilted_camera_bends_the_picture_and_dents_nothing(monitor: DriftMonitor) -> None:
    """By 0.14 degrees about each axis it looks 1 px aside, and the rim goes by a fifth less than the middle."""
    monitor.rest(changed(camera_tilt_deg=(0.14, 0.14)).rest())
    assert monitor.verdict.reasons == Reason.MOVED_SINCE_CALIBRATION
    assert monitor.verdict.since_calibration is not None
    assert monitor.verdict.since_calibration.left_px < 0.1


def test_another_gel_is_called_one_at_once(monitor: DriftMonitor) -> None:
    monitor.rest(changed(seed=5).rest())
    verdict = monitor.verdict
    assert (verdict.level, verdict.reasons) == (Level.INVALID, Reason.OTHER_GEL)
    assert 'differ from those of the calibration' in verdict.text


def test_a_gel_changed_while_sensing_is_reported_against_the_rest_image(monitor: DriftMonitor) -> None:
    verdict = watched(monitor, [changed(seed=5).picture()]).verdict
    assert (verdict.level, verdict.reasons) == (Level.INVALID, Reason.OTHER_GEL)
    assert 'differ from those of the rest image' in verdict.text


def test_a_covered_lens_is_no_other_gel(monitor: DriftMonitor, plain: Seen) -> None:
    covered = plain.picture()
    covered[:, :110] = 3
    verdict = watched(monitor, [covered]).verdict
    assert (verdict.level, verdict.reasons) == (Level.INVALID, Reason.LOST_REGIONS)


def test_dots_that_a_touch_takes_out_of_sight_are_not_lost(rest: np.ndarray) -> None:
    """A finger on a GelSight Mini hides three in ten patches for seconds; dots gone at rest are gone."""
    monitor = DriftMonitor(Limits.of_flow('dots'))
    monitor.rest(rest)
    pressed = dataclasses.replace(NOTHING, found=0.7, left_px=5.0, middle_px=2.0, size_px=2.0)
    assert held(monitor, pressed, begin_s=0) == (Level.VALID, Reason(0))
    gone = dataclasses.replace(NOTHING, found=0.7)
    assert held(monitor, gone, begin_s=10) == (Level.INVALID, Reason.LOST_REGIONS)


def test_a_stiffer_gel_gives_the_same_picture_to_the_last_bit() -> None:
    """So no camera can see it: in a layer that is pressed to a depth, the modulus scales the force alone."""
    stiff = dataclasses.replace(GEL, shear_modulus_mpa=1.5 * GEL.shear_modulus_mpa)
    one, other = (Optics(gel, contact_table(gel)).render(PRESSED, 3) for gel in (GEL, stiff))
    np.testing.assert_array_equal(one, other)
    ratio = contact_table(stiff).force_at(1.5) / contact_table(GEL).force_at(1.5)
    assert ratio == pytest.approx(1.5)


def touched(
    monitor: DriftMonitor, gain: float, contacts: int, begin_s: float = 0.0, unlike: float = 0.3
) -> DriftMonitor:
    """Presses of 1 N every 2 s, read with a gain by the gel and truly by another sensor."""
    for step in range(contacts * 2 * RATE_HZ):
        at_s = begin_s + step / RATE_HZ
        force_n = max(0.0, math.sin(math.pi * step / RATE_HZ))
        monitor.independent_force(round(at_s * S), (5.0, 0.0, 1.0 - force_n))
        monitor.force(round(at_s * S), gain * force_n, unlike, in_contact=force_n > 0.03)
    return monitor


@pytest.mark.parametrize(('gain', 'level'), [(0.97, Level.VALID), (0.9, Level.AGEING), (0.8, Level.INVALID)])
def test_an_independent_force_sees_that_a_gel_has_stiffened(monitor: DriftMonitor, gain: float, level: Level) -> None:
    verdict = touched(monitor, gain, 12).verdict
    assert verdict.level == level
    assert verdict.ratio is not None
    assert verdict.ratio.ratio == pytest.approx(gain, rel=0.005)
    assert (Reason.FORCE_RATIO in verdict.reasons) == (level > Level.VALID)


def test_a_new_calibration_forgets_what_the_old_one_read(monitor: DriftMonitor, rest: np.ndarray) -> None:
    touched(monitor, 0.8, 12)
    monitor.use_calibration(rest)
    assert (monitor.verdict.level, monitor.verdict.ratio) == (Level.VALID, None)


def test_a_known_weight_sees_it_too(monitor: DriftMonitor) -> None:
    """200 g weigh 1.961 N; a gel that has become a quarter harder reads 1.569 N."""
    for step in range(180):
        monitor.force(step * S // 60, 1.569, 0.2, in_contact=True)
    assert 'reads 1.569 N of 1.961 N' in monitor.weigh(200.0)
    assert (monitor.verdict.level, monitor.verdict.reasons) == (Level.INVALID, Reason.FORCE_RATIO)


def test_a_weight_that_does_not_lie_there_is_asked_for(monitor: DriftMonitor) -> None:
    with pytest.raises(ConfigurationError, match='the load on the gel was not steady'):
        monitor.weigh(200.0)


def test_contacts_that_are_unlike_one_after_the_other_are_reported_once_they_are_many(monitor: DriftMonitor) -> None:
    assert touched(monitor, 1.0, 19, unlike=2.0).verdict.level == Level.VALID
    verdict = touched(monitor, 1.0, 6, begin_s=60, unlike=2.0).verdict
    assert (verdict.level, verdict.reasons) == (Level.AGEING, Reason.UNLIKE_CONTACTS)


def test_a_knocked_camera_does_not_count_as_unlike_contacts_too(monitor: DriftMonitor) -> None:
    watched(monitor, [knocked(1.0).picture()])
    assert touched(monitor, 3.0, 30, begin_s=10, unlike=50.0).verdict.reasons == Reason.PICTURE_MOVED


def test_while_something_seems_wrong_it_looks_four_times_as_often(monitor: DriftMonitor, plain: Seen) -> None:
    untouched, moved = plain.picture(), knocked(0.3).picture()

    def looked_s(picture: np.ndarray, begin_s: float) -> list[float]:
        found = []
        for number in range(61):
            at_s = begin_s + 0.1 * number
            if monitor.is_due(round(at_s * S), 2.0):
                monitor.frame(round(at_s * S), picture)
                found.append(round(at_s - begin_s, 1))
        return found

    assert looked_s(untouched, 100.0) == [0.0, 2.0, 4.0, 6.0]
    assert looked_s(moved, 108.0) == [0.0, *(round(0.5 * number, 1) for number in range(1, 13))]
    assert monitor.verdict.level is Level.INVALID
    # The fault is over: one look tells, and the next may wait again.
    assert looked_s(untouched, 114.5) == [0.0, 2.0, 4.0, 6.0]
    assert monitor.verdict.level is Level.VALID


def test_dead_pixels_are_found_however_late_the_gel_is_let_go(monitor: DriftMonitor, plain: Seen) -> None:
    stuck = np.random.default_rng(3).random(plain.picture().shape) < 0.05

    def seen(presses: tuple[Press, ...], seed: int) -> np.ndarray:
        return np.where(stuck, np.uint8(255), plain.picture(presses, seed))

    for number in range(10):
        monitor.frame(number * S // 2, seen(PRESSED, number))
    assert monitor.verdict.reasons == Reason.LOST_REGIONS
    monitor.frame(10 * S, seen((), 30))
    assert monitor.verdict.level is Level.VALID
    monitor.frame(11 * S, seen(PRESSED, 31))  # and while it is pressed again
    assert monitor.verdict.level is Level.VALID
