from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_nodes.errors import ImageError
from tactile_nodes.sensing.geometry import (
    BinGrid,
    Crop,
    FisheyeCamera,
    PinholeCamera,
    camera_motions,
    centre_crop,
    grey,
    middle_part,
)


@pytest.mark.parametrize(
    ('x_mm', 'y_mm', 'index'), [(0.0, 0.0, 40), (15.9, -15.9, 8), (-15.9, 15.9, 72), (99.0, 99.0, 80), (-99.0, 0.0, 36)]
)
def test_bins_count_columns_along_x_first_and_the_outermost_ones_hold_what_lies_beyond(
    x_mm: float, y_mm: float, index: int
):
    assert BinGrid().bin_of(x_mm, y_mm) == index


def test_centres_of_bins_lie_in_their_bins_the_first_half_a_bin_from_the_corner():
    grid = BinGrid()
    assert [grid.bin_of(x, y) for x, y in grid.centres_mm.reshape(-1, 2).tolist()] == list(range(81))
    np.testing.assert_allclose(grid.centres_mm[0, 0], [-16 + 32 / 18, -16 + 32 / 18])
    np.testing.assert_allclose(grid.centres_mm[4, 4], [0, 0], atol=1e-12)


@pytest.mark.parametrize('x_mm', [0.0, -16.0], ids=['middle of a bin', 'rim of the surface'])
def test_the_next_border_is_half_a_bin_away_and_the_rim_is_none(x_mm: float):
    assert BinGrid().border_distance_mm(x_mm, 0.0) == pytest.approx(32 / 18)


@pytest.mark.parametrize(
    ('point', 'pixel'),
    [((1.0, 0, 1), (320 + 75 * np.pi, 240)), ((0.0, 0, 7), (320, 240)), ((0.0, 2, 0), (320, 240 + 150 * np.pi))],
    ids=['at 45 degrees', 'on the axis', 'sideways'],
)
def test_a_fisheye_sees_a_ray_its_focal_length_times_the_angle_from_the_centre(
    point: tuple[float, ...], pixel: tuple[float, float]
):
    camera = FisheyeCamera(focal_px_per_rad=300.0, centre_px=(320.0, 240.0))
    np.testing.assert_allclose(camera.project(np.array([point])), [pixel], atol=1e-9)


@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(0.2, 3))
def test_unproject_reverses_project(x: float, y: float, z: float):
    camera = FisheyeCamera()
    point = np.array([[x, y, z]])
    ray = camera.unproject(camera.project(point))
    np.testing.assert_allclose(ray, point / np.linalg.norm(point), atol=1e-9)


@pytest.mark.parametrize('theta', [1.0, 1.35, 1.4])
def test_unproject_reverses_a_fisheye_that_widens_its_rim_and_folds_beyond_it(theta: float):
    """An angle of 1.4 is seen at 1.86, and the distorted angle falls from 1.6 on."""
    camera = FisheyeCamera(focal_px_per_rad=111.0, distortion=(0.165, 0.073, -0.035, -0.001))
    point = np.array([[np.sin(theta), 0.0, np.cos(theta)]])
    np.testing.assert_allclose(camera.unproject(camera.project(point)), point, atol=1e-9)


def test_a_pinhole_sees_45_degrees_at_its_focal_length_and_farther_by_what_the_lens_adds():
    """1 + k1 r² of it, at r = 1."""
    right, below = np.array([[2.0, 0, 2]]), np.array([[0.0, 3, 3]])
    plain = PinholeCamera(focal_px=(300.0, 310.0), centre_px=(320.0, 240.0))
    np.testing.assert_allclose(plain.project(right), [[620, 240]])
    np.testing.assert_allclose(plain.project(below), [[320, 550]])
    barrel = PinholeCamera(focal_px=(300.0, 310.0), centre_px=(320.0, 240.0), distortion=(-0.1, 0.0, 0.0, 0.0, 0.0))
    np.testing.assert_allclose(barrel.project(right), [[590, 240]])


def test_a_lens_that_is_out_of_line_shifts_along_and_across():
    """p1 of 0.01 at (1, 1): x by 2 p1 x y = 0.02, y by p1 (r² + 2 y²) = 0.04."""
    camera = PinholeCamera(focal_px=(100.0, 100.0), centre_px=(0.0, 0.0), distortion=(0.0, 0.0, 0.01, 0.0, 0.0))
    np.testing.assert_allclose(camera.project(np.array([[1.0, 1, 1]])), [[102, 104]])


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
def test_unproject_reverses_the_lens_of_a_pinhole(x: float, y: float):
    camera = PinholeCamera(distortion=(-0.2, 0.05, 0.001, -0.002, 0.01))
    point = np.array([[x, y, 1.0]])
    ray = camera.unproject(camera.project(point))
    np.testing.assert_allclose(ray, point / np.linalg.norm(point), atol=1e-7)


def test_of_a_picture_the_part_that_a_model_reads_is_taken_from_the_middle():
    image = np.arange(48 * 64, dtype=np.uint32).astype(np.uint8).reshape(48, 64)
    np.testing.assert_array_equal(middle_part(image, 0, (64, 40)), image[4:44])
    with pytest.raises(ImageError, match='cannot cut 80x40'):
        middle_part(image, 0, (80, 40))
    np.testing.assert_array_equal(middle_part(image, 0, (44, 44)), image[2:46, 10:54])


def test_the_paper_cuts_440_pixels_from_the_middle_of_640x480():
    assert Crop.centred(640, 480) == Crop(100, 20, 440, 440)


def test_a_crop_is_a_view_of_the_image():
    image = np.zeros((480, 640), np.uint8)
    centre_crop(image)[0, 0] = 7
    assert image[20, 100] == 7


def test_an_image_smaller_than_the_crop_is_refused():
    with pytest.raises(ImageError, match='cannot cut 440x440 pixels from an image of 320x240'):
        centre_crop(np.zeros((240, 320), np.uint8))


def test_a_crop_outside_the_image_is_refused():
    with pytest.raises(ImageError, match='does not lie within'):
        Crop(500, 0, 440, 440).apply(np.zeros((480, 640), np.uint8))


@pytest.mark.parametrize(('order', 'blue'), [('bgr', 0), ('rgb', 2)])
def test_green_weighs_most_in_grey_and_blue_least(order: str, blue: int):
    image = np.zeros((1, 2, 3), np.uint8)
    image[0, 0, 1] = image[0, 1, blue] = 255
    assert grey(image, order).tolist() == [[150, 29]]  # 0.587 and 0.114 of 255


def test_a_grey_image_stays_as_it_is():
    image = np.zeros((2, 2), np.uint8)
    assert grey(image) is image


def test_an_image_of_floats_is_refused():
    with pytest.raises(ImageError, match='8 bit'):
        grey(np.zeros((2, 2, 3), np.float32))


@pytest.mark.parametrize(('rows', 'cols', 'aspect'), [(3, 4, 4 / 3), (4, 3, 3 / 4), (5, 2, 4 / 3)])
def test_as_a_camera_rolls_every_point_moves_across_its_way_from_the_middle(rows: int, cols: int, aspect: float):
    """By as much as it is away, in pixels, also in a picture that is not square."""
    width_px, height_px = 240.0 * aspect, 240.0
    row, col = np.mgrid[:rows, :cols].reshape(2, -1)
    away_px = np.array([(col + 0.5) * width_px / cols - width_px / 2, (row + 0.5) * height_px / rows - height_px / 2])
    half_px = max(width_px, height_px) / 2
    _, _, rolled, nearer = camera_motions(rows, cols, aspect).transpose(2, 1, 0)
    assert rolled * half_px == pytest.approx(np.array([-away_px[1], away_px[0]]))
    assert nearer * half_px == pytest.approx(away_px)
