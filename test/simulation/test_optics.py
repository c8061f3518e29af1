from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.mechanics import ContactTable
from tactile_nodes.simulation.optics import NoiseBank, Optics, Press, mix, place_markers
from tactile_nodes.simulation.scene import Scene

DEEP = Press(3.0, -2.0, 2.0)


def centroid(image: np.ndarray) -> np.ndarray:
    y, x = np.mgrid[: image.shape[0], : image.shape[1]]
    return np.array([(image * x).sum(), (image * y).sum()]) / image.sum()


def lone(table: ContactTable, **properties: object) -> Optics:
    """One marker on black, evenly lit."""
    return Optics(Gel(marker_count=1, background_grey=0.0, vignetting=0.0, **properties), table)


def test_a_dots_centroid_moves_exactly_as_its_marker_does(table: ContactTable):
    """One marker, moved in steps of a tenth of a pixel across a whole pixel, each way."""
    optics, start = lone(table), np.array([[300.0, 200.0]], np.float32)
    for step in np.arange(0.0, 1.0, 0.1):
        place = start + np.array([step, -step], np.float32)
        np.testing.assert_allclose(centroid(optics._draw(place)), place[0], atol=2e-3)


def test_a_dot_keeps_its_light_wherever_it_lies_on_the_pixels(table: ContactTable):
    optics = lone(table)
    light = [optics._draw(np.array([[300 + s, 200 - s]], np.float32)).sum() for s in (0.0, 0.25, 0.5, 0.75)]
    np.testing.assert_allclose(light, light[0], rtol=1e-5)


def test_markers_far_outside_the_image_are_not_drawn(table: ContactTable):
    optics = Optics(Gel(marker_count=2, background_grey=0.0), table)
    outside = np.array([[-50.0, 100.0], [647.0, 487.0]], np.float32)
    assert optics._draw(outside).sum() == 0


@pytest.mark.parametrize(('x', 'y', 'seen'), [(-0.5, 240.5, 1 / 2), (639.5, 240.5, 1 / 2), (639.5, 479.5, 1 / 4)])
def test_a_marker_at_the_border_of_the_image_is_cut_by_it(table: ContactTable, x: float, y: float, seen: float):
    optics = lone(table)
    whole, cut = (optics._draw(np.array([each], np.float32)).sum() for each in ([300.5, 240.5], [x, y]))
    assert cut == pytest.approx(seen * whole, rel=1e-3)


def test_markers_fill_88_percent_of_the_crops_regions(scene: Scene):
    cells = np.floor((scene.optics.project(()) - [100, 20]) / 11).astype(int)
    cells = cells[((cells >= 0) & (cells < 40)).all(axis=1)]
    assert len(np.unique(cells, axis=0)) / 1600 == pytest.approx(0.88, abs=0.005)


def test_markers_lie_in_the_soft_gel_only(gel: Gel):
    places, diameters = place_markers(gel)
    assert places[:, 2].min() >= -6.0
    assert places[:, 2].max() <= -1.5
    assert np.abs(places[:, :2]).max() <= 16.0
    assert 0.150 <= diameters.min() < diameters.max() <= 0.180


def test_another_seed_makes_another_gel(table: ContactTable, gel: Gel):
    one, two = (Optics(each, table).radiance(()) for each in (gel, dataclasses.replace(gel, seed=2)))
    assert np.abs(one - two).mean() > 1


def test_a_tip_above_the_gel_changes_nothing(scene: Scene):
    np.testing.assert_array_equal(scene.optics.radiance((Press(0.0, 0.0, -0.1),)), scene.optics.radiance(()))


def test_a_first_touch_changes_almost_nothing(scene: Scene):
    rest, touched = scene.optics.radiance(()), scene.optics.radiance((Press(0.0, 0.0, 0.001),))
    assert np.abs(rest - touched).max() < 0.5


def test_the_field_of_a_press_is_symmetric_about_its_axis(scene: Scene):
    moved = scene.optics.displacement_mm((DEEP,))
    offset = scene.optics.markers_mm[:, :2] - [DEEP.x_mm, DEEP.y_mm]
    sideways = offset[:, 0] * moved[:, 1] - offset[:, 1] * moved[:, 0]
    assert np.abs(sideways).max() < 1e-5


def test_two_presses_add_up(scene: Scene):
    other = Press(-6.0, 5.0, 1.0)
    together = scene.optics.displacement_mm((DEEP, other))
    apart = scene.optics.displacement_mm((DEEP,)) + scene.optics.displacement_mm((other,))
    np.testing.assert_allclose(together, apart, atol=1e-6)


def test_markers_move_by_pixels_at_two_millimetres_and_by_a_tenth_at_a_quarter(scene: Scene):
    """The published scale of the sensor: up to a few pixels when deep, far below one when light."""
    rest = scene.optics.project(())
    deep, light = (np.hypot(*(scene.optics.project((Press(0.0, 0.0, depth),)) - rest).T).max() for depth in (2.0, 0.25))
    assert 1.5 < deep < 5
    assert 0.1 < light < 0.4


def test_noise_has_the_variance_that_the_gel_says():
    gel = Gel(read_noise_grey=2.0, shot_noise_grey=0.1)
    frame = NoiseBank(gel).expose(np.full((480, 640), 100.0, np.float32), 5).astype(float)
    assert frame.var() == pytest.approx(4 + 0.1 * 100 + 1 / 12, rel=0.02)  # 1/12 from rounding
    assert frame.mean() == pytest.approx(100, abs=0.05)


def test_noise_differs_from_frame_to_frame(scene: Scene):
    radiance = scene.optics.radiance(())
    unclipped = radiance < 200
    one, two = ((scene.optics.render((), seed) - radiance)[unclipped] for seed in (1, 2))
    # What rounding does is the same in all frames; it is a tenth of the noise at most.
    assert abs(np.corrcoef(one, two)[0, 1]) < 0.01


def test_splitmix_is_splitmix():
    assert mix(0) == 0xE220A8397B1DCDAF  # first output of the published generator for seed 0


def test_a_smear_has_its_middle_where_the_marker_was_on_average(table: ContactTable):
    optics = lone(table)
    x, y, _ = optics.markers_mm[0]
    moments = tuple((Press(float(x) + 1.5, float(y), depth),) for depth in (1.0, 2.0))
    places = np.array([optics.project(each)[0] for each in moments])
    assert np.hypot(*(places[1] - places[0])) > 0.1
    np.testing.assert_allclose(centroid(optics._smeared(moments)), places.mean(axis=0), atol=2e-3)


def test_a_smear_is_the_mean_of_its_moments(table: ContactTable, scene: Scene):
    moments = ((DEEP,), (dataclasses.replace(DEEP, depth_mm=1.9),))
    mean = np.mean([scene.optics.radiance(each) for each in moments], axis=0)
    assert np.abs(scene.optics._smeared(moments) - mean).max() < 0.1  # of 150 grey levels


def test_a_smear_of_dark_markers_is_the_mean_of_its_moments_too(table: ContactTable):
    optics = Optics(Gel(marker_count=500, background_grey=140.0, marker_grey=-100.0), table)
    moments = tuple((Press(0.0, 0.0, depth),) for depth in (1.0, 1.1))
    mean = (optics.radiance(moments[0]) + optics.radiance(moments[1])) / 2
    assert np.abs(optics._smeared(moments) - mean).max() < 0.1  # of 140 grey levels


def test_jpeg_changes_an_image_a_little_and_always_alike(scene: Scene, table: ContactTable):
    sent = [Optics(dataclasses.replace(scene.gel, jpeg_quality=90), table).render((DEEP,), 7) for _ in range(2)]
    np.testing.assert_array_equal(*sent)
    error = sent[0].astype(float) - scene.optics.render((DEEP,), 7)
    assert 0.3 < error.std() < 4


def test_a_camera_rolled_by_a_right_angle_sees_the_right_above(table: ContactTable):
    x, y = lone(table).project(())[0] - [319.5, 239.5]
    np.testing.assert_allclose(lone(table, camera_roll_deg=90.0).project(())[0] - [319.5, 239.5], [y, -x], atol=1e-3)


def test_a_camera_tilted_about_x_shifts_an_equidistant_image_by_focal_length_times_angle(table: ContactTable):
    """A marker over the camera's pupil, seen 2 degrees beside the optical axis."""
    gel = Gel(marker_count=1)
    x, y, _ = place_markers(gel)[0][0]
    shifted = lone(table, camera_shift_mm=(float(x), float(y)), camera_tilt_deg=(2.0, 0.0))
    np.testing.assert_allclose(shifted.project(())[0], [319.5, 239.5 + 290 * np.radians(2.0)], atol=1e-2)


def test_a_shifted_camera_sees_what_is_over_it_in_the_middle(table: ContactTable):
    x, y, _ = place_markers(Gel(marker_count=1))[0][0]
    np.testing.assert_allclose(
        lone(table, camera_shift_mm=(float(x), float(y))).project(())[0], [319.5, 239.5], atol=1e-3
    )


def test_light_from_the_right_is_brighter_there(table: ContactTable):
    lit = Optics(Gel(marker_count=1, vignetting=0.0, light_slope=(0.2, 0.0), light_gain=0.5), table).radiance(())
    edge, middle = lit[10, 639] / 14, lit[10, 319:321].mean() / 14
    assert edge == pytest.approx(0.5 * (1 + 0.2 * 319.5 / 320), rel=1e-4)
    assert middle == pytest.approx(0.5, rel=1e-4)


def test_a_press_moves_the_gel_by_its_own_indenters_table(table: ContactTable, finite_table: ContactTable):
    optics = Optics(Gel(), table, {'ball': finite_table})
    other = Optics(Gel(), finite_table)
    np.testing.assert_array_equal(
        optics.displacement_mm((dataclasses.replace(DEEP, indenter='ball'),)), other.displacement_mm((DEEP,))
    )


def test_an_indenter_without_a_table_is_refused_by_name(scene: Scene):
    with pytest.raises(ConfigurationError, match='spoon'):
        scene.optics.displacement_mm((Press(0.0, 0.0, 1.0, 'spoon'),))


def test_a_dragged_tip_takes_the_gel_with_it(scene: Scene):
    pressed = scene.optics.displacement_mm((DEEP,))
    dragged = scene.optics.displacement_mm((dataclasses.replace(DEEP, shift_mm=(0.3, 0.0)),)) - pressed
    near = np.linalg.norm(scene.optics.markers_mm - [3.0, -2.0, -1.5], axis=1) < 1
    assert dragged[near, 0].min() > 0.005
    assert np.abs(dragged[:, 1]).max() < np.abs(dragged[:, 0]).max() / 2
