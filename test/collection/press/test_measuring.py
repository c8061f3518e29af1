"""From readings to labels: frames, means, steadiness, and the surface."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tactile_nodes.collection.actions import Look, Observation, SetTare, Switch
from tactile_nodes.collection.plan.plan import Point
from tactile_nodes.collection.press.cycle import Ground, Record, RejectedError, _settle, _window, unsteady
from tactile_nodes.collection.press.rest import zero
from tactile_nodes.collection.press.surface import Surface, loading_line, plane
from tactile_nodes.collection.readings import change, frame_of
from tactile_nodes.collection.settings import CollectionSettings, MountingSettings
from tactile_nodes.collection.wrench import Tare, on_gel, pressing_n, slope, tare_of
from tactile_nodes.drivers.cnc.contract import Switched
from tactile_nodes.drivers.force_torque.contract import Sample
from tactile_nodes.errors import DeviceFaultError

MS = 1_000_000
SETTINGS = CollectionSettings()
ZERO = Tare((0.0,) * 6, (0.0,) * 6, 100, 0)
UPSIDE_DOWN = MountingSettings(upside_down=True)


def sample(at_ms: int, fz: float) -> Sample:
    return Sample((0.0, 0.0, fz, 0.0, 0.0, 0.0), at_ms * MS, at_ms * MS, 0, at_ms, 0, 0, 0, ())


def test_flat_punch_is_drawn_back_along_a_straight_line() -> None:
    line = loading_line([(-0.1, 0.2), (-0.2, 0.4)], power=1.0)
    assert (line.touch_mm, line.slope, line.force_n(0.3)) == pytest.approx((0.0, 2.0, 0.6))


def test_force_on_the_gel_is_the_reverse_of_what_the_sensor_feels_about_the_middle_of_the_surface() -> None:
    read = np.array([[0.0, 0.0, 1.0, 0.0, 0.0, 0.0]])
    (found,) = on_gel(read, ZERO, MountingSettings(), (10.0, 0.0, -1.0))
    assert found == pytest.approx([0.0, 0.0, -1.0, 0.0, 0.01, 0.0])


def test_pressing_is_negative_on_a_sensor_upside_down_and_known_by_one_of_a_single_axis() -> None:
    assert pressing_n(np.array([[0.0, 0.0, -1.0, 0.0, 0.0, 0.0]]), ZERO, UPSIDE_DOWN) == pytest.approx([1.0])
    nan = math.nan
    read = np.array([[nan, nan, 1.5, nan, nan, nan]])
    assert pressing_n(read, Tare((nan, nan, 0.5, nan, nan, nan), (nan,) * 6, 9, 0), MountingSettings()) == 1.0


def test_tare_is_mean_and_deviation() -> None:
    tare = tare_of([sample(0, 1.0), sample(1, 3.0)])
    assert (tare.wrench[2], tare.deviation[2], tare.samples) == (2.0, 1.0, 2)


def test_slope_is_that_of_the_line() -> None:
    assert slope([0, 1000 * MS, 2000 * MS], np.array([1.0, 3.0, 5.0])) == pytest.approx(2.0)


def test_change_of_a_few_pixels_in_one_block_is_seen() -> None:
    still = np.full((64, 64), 100, np.uint8)
    moved = still.copy()
    moved[20:24, 20:24] = 164  # 16 pixels of a block of 256, by 64 levels: 4 levels of its mean
    assert change(frame_of(0, still), frame_of(1, moved)) == pytest.approx(4.0)


@pytest.mark.parametrize(('rate_n_s', 'steady'), [(0.05, True), (0.5, False)])
def test_force_is_steady_below_its_rate(rate_n_s: float, steady: bool) -> None:
    samples = [sample(ms, 1.0 + rate_n_s * ms / 1000) for ms in range(0, 1000, 5)]
    frames = [frame_of(ms * MS, np.zeros((32, 32), np.uint8)) for ms in range(0, 1000, 30)]
    assert (not unsteady(samples, frames, ZERO, 0.0, SETTINGS)) is steady


def test_nothing_is_steady_before_it_has_rested_long_enough() -> None:
    """It has rested since 0.9 s, and must have been steady for 0.2 s."""
    settling = _settle(Record(Point(1, 0.0, 0.0, 1.0), 1, ZERO), Ground(Surface(-30.0), -5.0, ZERO, 0.0), SETTINGS)
    samples = tuple(sample(ms, 1.0) for ms in range(0, 2000, 5))
    frames = tuple(frame_of(ms * MS, np.zeros((32, 32), np.uint8)) for ms in range(0, 2000, 30))
    next(settling)
    assert settling.send(Observation(1000 * MS, 900 * MS, (0.0, 0.0, -31.0), samples, frames)) == Look(0.02, 800 * MS)
    with pytest.raises(StopIteration):
        settling.send(Observation(1100 * MS, 1000 * MS, (0.0, 0.0, -31.0), samples, frames))


def test_image_that_still_moves_is_not_steady() -> None:
    samples = [sample(ms, 1.0) for ms in range(0, 1000, 5)]
    frames = [frame_of(ms * MS, np.full((32, 32), ms // 100, np.uint8)) for ms in range(0, 1000, 30)]
    assert 'image' in unsteady(samples, frames, ZERO, 0.1, SETTINGS)


def test_touch_of_a_hertzian_sphere_is_where_its_force_begins() -> None:
    loading = [(-30.0 - depth, 2.0 * depth**1.5) for depth in (0.1, 0.2, 0.3, 0.4)]
    line = loading_line(loading)
    assert line.touch_mm == pytest.approx(-30.0)
    assert line.force_n(1.0) == pytest.approx(2.0)
    assert line.force_n(-0.1) == 0.0


def test_force_that_does_not_grow_is_no_touch() -> None:
    with pytest.raises(DeviceFaultError, match='does not grow'):
        loading_line([(-30.0, 0.2), (-30.1, 0.1), (-30.2, 0.05)])


def test_plane_through_three_corners() -> None:
    surface = plane([(-10.0, -10.0, -30.1), (10.0, -10.0, -29.9), (10.0, 10.0, -29.9)], SETTINGS)
    assert surface.height_mm(0.0, 0.0) == pytest.approx(-30.0)
    assert (surface.slope_x, surface.slope_y) == pytest.approx((0.01, 0.0))


def test_corner_off_the_plane_is_refused() -> None:
    places = [(-10.0, -10.0, -30.0), (10.0, -10.0, -30.0), (10.0, 10.0, -30.0), (-10.0, 10.0, -29.7)]
    with pytest.raises(DeviceFaultError, match='not flat'):
        plane(places, SETTINGS)


def test_tip_is_as_deep_along_the_normal_as_asked() -> None:
    surface = Surface(-30.0, 0.3, 0.4)  # slope 0.5: the normal is sqrt(1.25) steeper than the vertical
    assert surface.tip_mm(0.0, 0.0, 1.0) == pytest.approx(-30.0 - math.sqrt(1.25))
    assert surface.depth_mm(2.0, 1.0, surface.tip_mm(2.0, 1.0, 0.7)) == pytest.approx(0.7)


def test_zero_is_taken_once_a_sensor_that_paused_sends_again() -> None:
    taking = zero(SETTINGS)
    next(taking)
    taking.send(Observation(500 * MS, 0, (0.0, 0.0, 0.0)))  # half a second without a sample
    action = taking.send(Observation(1000 * MS, 500 * MS, (0.0, 0.0, 0.0), (sample(900, 2.0), sample(950, 4.0))))
    assert isinstance(action, SetTare)
    assert action.tare.wrench[2] == 3.0


def test_line_goes_low_again_when_a_window_is_rejected() -> None:
    """Else the next press raises a line that is high already, and clocks are fitted to an edge that never was."""
    window = _window(Record(Point(1, 0.0, 0.0, 1.0), 1), Ground(Surface(-30.0), -5.0, ZERO, 0.0), SETTINGS)
    assert next(window) == Switch(True)
    action = window.send(Observation(0, 0, (0.0, 0.0, 0.0), switched=Switched(True, 0, 0)))
    for tenth in range(100):  # without an image or a sample
        if isinstance(action, Look):
            action = window.send(Observation(tenth * 100 * MS, 0, (0.0, 0.0, 0.0)))
    assert action == Switch(False)
    with pytest.raises(RejectedError, match=r'too few images \(0\) or force samples \(0\)'):
        window.send(Observation(10_000 * MS, 0, (0.0, 0.0, 0.0), switched=Switched(False, 0, 0)))
