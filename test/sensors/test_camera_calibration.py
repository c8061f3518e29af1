"""Calibrations as OpenCV and ROS write them become cameras of descriptions."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.sensing.geometry import FisheyeCamera
from tactile_nodes.sensors import load_sensor

ROS = """\
image_width: 800
image_height: 600
camera_name: narrow
camera_matrix:
  rows: 3
  cols: 3
  data: [700.5, 0.0, 401.25, 0.0, 702.25, 299.5, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.1, 0.02, 0.001, -0.002, 0.0]
"""
ECHOED = """\
header:
  stamp: {sec: 1, nanosec: 2}
height: 480
width: 640
distortion_model: equidistant
d:
- 0.01
- -0.02
- 0.0
- 0.0
k: [300.0, 0.0, 320.5, 0.0, 303.0, 239.0, 0.0, 0.0, 1.0]
---
"""


def written(folder: Path, calibration: str, more: str = '', image: str = '{crop: 440}') -> Path:
    (folder / 'camera.yaml').write_text(calibration)
    (folder / 'mine.yaml').write_text(f'image: {image}\ncamera: {{calibration: camera.yaml{more}}}\n')
    return folder / 'mine.yaml'


def test_a_file_of_ros_says_lens_and_size(tmp_path: Path) -> None:
    sensor = load_sensor(written(tmp_path, ROS))
    assert (sensor.image.width, sensor.image.height) == (800, 600)
    assert sensor.camera.model == 'pinhole'
    assert sensor.camera.matrix == ((700.5, 0, 401.25), (0, 702.25, 299.5), (0, 0, 1))
    assert sensor.camera.lens == (-0.1, 0.02, 0.001, -0.002, 0.0)


def test_a_message_of_ros_printed_to_a_file_does_too(tmp_path: Path) -> None:
    camera = load_sensor(written(tmp_path, ECHOED)).camera
    assert camera.distortion_model == 'equidistant'
    assert camera.matrix == ((300.0, 0, 320.5), (0, 303.0, 239.0), (0, 0, 1))
    assert camera.lens == (0.01, -0.02, 0.0, 0.0)


def test_a_file_that_opencv_wrote_is_read_with_its_four_coefficients(tmp_path: Path) -> None:
    file = cv2.FileStorage(str(tmp_path / 'camera.yml'), cv2.FILE_STORAGE_WRITE)
    file.write('image_width', 640)
    file.write('image_height', 480)
    file.write('camera_matrix', np.array([[500.0, 0, 310], [0, 505.0, 250], [0, 0, 1]]))
    file.write('distortion_coefficients', np.array([[0.05, -0.01, 0.001, 0.002]]))
    file.release()
    sensor = load_sensor(written(tmp_path, (tmp_path / 'camera.yml').read_text()))
    assert sensor.camera.model == 'pinhole'
    assert sensor.camera.matrix == ((500.0, 0, 310.0), (0, 505.0, 250.0), (0, 0, 1))
    assert sensor.camera.lens == (0.05, -0.01, 0.001, 0.002, 0.0)


def test_a_file_of_opencv_that_an_editor_has_saved_is_read(tmp_path: Path) -> None:
    """With a byte order mark before the first line, which is not YAML."""
    matrix = '!!opencv-matrix {rows: 3, cols: 3, dt: d, data: [500.0, 0.0, 310.0, 0.0, 505.0, 250.0, 0.0, 0.0, 1.0]}'
    lens = '!!opencv-matrix {rows: 1, cols: 4, dt: d, data: [0.05, -0.01, 0.001, 0.002]}'
    size = 'image_width: 640\nimage_height: 480\n'
    text = f'\ufeff%YAML:1.0\n---\n{size}camera_matrix: {matrix}\ndistortion_coefficients: {lens}\n'
    assert load_sensor(written(tmp_path, text)).camera.matrix == ((500.0, 0, 310.0), (0, 505.0, 250.0), (0, 0, 1))


def test_a_fisheye_of_opencv_sees_as_opencv_says() -> None:
    """Against cv2.fisheye.projectPoints; and each pixel's ray leads back to it."""
    points = np.random.default_rng(1).uniform((-2, -2, 1), (2, 2, 2), (50, 3))
    matrix, lens = np.array([[300.0, 0, 320.5], [0, 303.0, 239.0], [0, 0, 1]]), (0.02, -0.01, 0.002, -0.0005)
    camera = FisheyeCamera(640, 480, 300.0, (320.5, 239.0), lens, 1.01)
    expected, _ = cv2.fisheye.projectPoints(points[:, None], np.zeros(3), np.zeros(3), matrix, np.array(lens))
    np.testing.assert_allclose(camera.project(points), expected[:, 0], atol=1e-9)
    rays = points / np.linalg.norm(points, axis=1, keepdims=True)
    np.testing.assert_allclose(camera.unproject(camera.project(points)), rays, atol=1e-9)


ROWS = """\
camera_matrix: {rows: 3, cols: 3, data: [700.5, 0.0, 319.5, 0.0, 702.25, 239.5, 0.0, 0.0, 1.0]}
distortion_coefficients: {rows: 4, cols: 1, data: [0.01, -0.002, 0.0003, 0.0]}
"""
"""As cv2.fisheye.calibrate has it, written by cv2.FileStorage."""


def test_four_rows_of_one_number_are_the_lens_that_somebody_says(tmp_path: Path) -> None:
    for lens in ('fisheye', 'pinhole'):
        assert load_sensor(written(tmp_path, ROWS, f', model: {lens}')).camera.model == lens
    for lens, model in (('equidistant', 'fisheye'), ('plumb_bob', 'pinhole')):
        assert load_sensor(written(tmp_path, f'{ROWS}distortion_model: {lens}\n')).camera.model == model


def test_a_message_of_a_camera_that_sends_whole_pictures_says_so_in_several_ways(tmp_path: Path) -> None:
    roi = 'roi: {x_offset: 0, y_offset: 0, height: 480, width: 640, do_rectify: false}'
    whole = ECHOED.replace('---', f'binning_x: 1\nbinning_y: 0\n{roi}\n---')
    assert load_sensor(written(tmp_path, whole)).camera.focal_px_per_rad == 300.0


@pytest.mark.parametrize(
    ('calibration', 'more', 'said'),
    [
        ('camera_matrix: 7\n', '', 'no camera_matrix'),
        ('<?xml version="1.0"?><opencv_storage/>', '', 'not a YAML file of OpenCV or camera_info'),
        (ROS.replace('plumb_bob', 'pinhole_eq'), '', "distortion_model 'pinhole_eq' must be one of plumb_bob"),
        (ROS.replace('-0.002, 0.0]', '-0.002, 0.0, 0.1, 0.0, 0.0]'), '', 'distortion has 8 numbers'),
        (ROS.replace('700.5', 'nan'), '', 'not finite'),
        (ROS.replace('700.5', 'one'), '', 'an entry that is not a number'),
        (ROWS, '', '4 rows of one number, as OpenCV.s fisheye .* add the line distortion_model: equidistant'),
        (ROS.replace('distortion_model: plumb_bob\n', ''), ', model: fisheye', '5 numbers, but OpenCV.s fisheye has 4'),
        (ECHOED.replace('---', 'binning_x: 2\nbinning_y: 0\n---'), '', 'its images are binned'),
        (ECHOED.replace('---', 'roi: {x_offset: 80, width: 480}\n---'), '', 'its images are cropped'),
        (ROS, ', model: fisheye', 'its lens is a pinhole, but the description says camera.model: fisheye'),
        (ROS, ', focal_px: [600.0, 600.0]', r"mine.yaml:2: 'camera.focal_px' is \[600.0, 600.0\], but the calibration"),
        (ROS.replace('-0.1, 0.02', '-9.0, 0.0'), '', 'folds the image over before its corner'),
        (ROS.replace('401.25', '901.25'), '', r'centre_px \(901.25, 299.5\) lies outside the 800x600 image'),
    ],
)
def test_a_calibration_that_contradicts_is_refused(tmp_path: Path, calibration: str, more: str, said: str) -> None:
    with pytest.raises(ConfigurationError, match=said):
        load_sensor(written(tmp_path, calibration, more))


def test_a_lens_is_checked_up_to_the_corner_farthest_from_its_axis(tmp_path: Path) -> None:
    """r (1 - 0.3 r²) is at most 0.703, 422 px of 600, at r = 1.05. From 339.5 px the farthest corner is hypot(340, 240)
    = 416 px away, from 359.5 px 433 px."""
    image = 'image: {width: 640, height: 480, crop: 640, crop_height: 480}'
    camera = 'camera: {model: pinhole, focal_px: [600.0, 600.0], distortion: [-0.3, 0.0, 0.0, 0.0, 0.0]'
    file = tmp_path / 'mine.yaml'
    file.write_text(f'{image}\n{camera}, centre_px: [339.5, 239.5]}}\n')
    assert load_sensor(file).camera.centre_px == (339.5, 239.5)
    file.write_text(f'{image}\n{camera}, centre_px: [359.5, 239.5]}}\n')
    with pytest.raises(ConfigurationError, match='folds the image over before its corner'):
        load_sensor(file)


def test_a_calibration_of_pictures_of_another_size_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"mine.yaml:1: 'image.width' is 640, .* says 800; remove one"):
        load_sensor(written(tmp_path, ROS, image='{width: 640, crop: 440}'))


def test_a_calibration_that_is_not_there_is_reported_by_its_name(tmp_path: Path) -> None:
    (tmp_path / 'mine.yaml').write_text('camera: {calibration: none.yaml}\n')
    with pytest.raises(ConfigurationError, match=r'cannot read the calibration .*none\.yaml'):
        load_sensor(tmp_path / 'mine.yaml')
