"""What a description calls covered is covered in pictures, and in no region that is used."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.sensing.elasticity.regions import Regions
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.picture.registration import Registered
from tactile_nodes.sensors import MaskSettings, load_sensor
from tactile_nodes.sensors.covering import polygons_of

SMALL = 'image: {width: 320, height: 240, crop: 320, crop_height: 240}\ncamera: {centre_px: [159.5, 119.5]}\n'


def described(folder: Path, mask: str) -> Path:
    (folder / 'mine.yaml').write_text(f'{SMALL}mask: {mask}\n')
    return folder / 'mine.yaml'


def test_a_rectangle_covers_the_pixels_that_its_corners_name(tmp_path: Path) -> None:
    covered = load_sensor(described(tmp_path, '{polygons_px: ["0,0 99,0 99,239 0,239"]}')).covered
    assert covered.shape == (240, 320)
    assert covered[:, :100].all()
    assert not covered[:, 100:].any()


def test_a_mask_is_cut_as_pictures_are(tmp_path: Path) -> None:
    """440x440 from the middle of 640x480: columns from 100 on."""
    (tmp_path / 'mine.yaml').write_text('mask: {polygons_px: ["0,0 149,0 149,479 0,479"]}\n')
    covered = load_sensor(tmp_path / 'mine.yaml').covered
    assert covered.shape == (440, 440)
    assert covered[:, :50].all()
    assert not covered[:, 50:].any()


def test_a_picture_of_a_ring_is_the_same_in_polygons() -> None:
    """Covered outside of a circle, but for a strip: a hole, and a part within the hole."""
    covered = np.ones((240, 320), bool)
    y, x = np.mgrid[:240, :320]
    covered[np.hypot(x - 160, y - 120) < 100] = False
    covered[118:122, 150:170] = True
    again = MaskSettings(polygons_of(covered)).covers(320, 240)
    rim = cv2.morphologyEx(covered.astype(np.uint8), cv2.MORPH_GRADIENT, np.ones((5, 5), np.uint8)) > 0
    assert (again == covered)[~rim].all()
    assert (again != covered).mean() < 0.01


def test_a_picture_beside_the_description_is_black_where_it_covers(tmp_path: Path) -> None:
    drawn = np.full((240, 320), 255, np.uint8)
    drawn[:, 280:] = 0
    cv2.imwrite(str(tmp_path / 'covered.png'), drawn)
    covered = load_sensor(described(tmp_path, '{file: covered.png}')).covered
    np.testing.assert_array_equal(covered, drawn == 0)


def test_regions_whose_window_is_covered_are_not_used(tmp_path: Path) -> None:
    """Regions of 32 px with windows of 38.4: pixels up to 31 lie in the first, and reach into the second."""
    sensor = load_sensor(described(tmp_path, '{polygons_px: ["0,0 31,0 31,239 0,239"]}'))
    assert Regions(sensor, 6, 10).covered.reshape(6, 10).all(axis=0).tolist() == [True, True] + [False] * 8
    assert not Regions(sensor, 6, 10).usable.reshape(6, 10)[:, :2].any()


def test_patches_that_are_covered_are_not_believed_and_not_watched() -> None:
    random = np.random.default_rng(1)
    image = cv2.GaussianBlur(random.uniform(0, 255, (240, 320)).astype(np.uint8), (0, 0), 1.5)
    flow = make_flow('inverse_compositional', {'rows': 6, 'cols': 8, 'covered': [0, 8, 16, 24, 32, 40]})
    flow.set_reference(image)
    own = flow.displacement(image)
    assert own.confidence is not None
    assert not own.confidence[:, 0].any()
    assert own.confidence[:, 1:].min() > 0.5
    assert Registered(image, own).known.reshape(10, 10).all(axis=0).tolist() == [False] * 2 + [True] * 8


def test_a_patch_beyond_the_last_cannot_be_covered() -> None:
    with pytest.raises(ConfigurationError, match='names region 48, but there are only 6x8'):
        make_flow('inverse_compositional', {'rows': 6, 'cols': 8, 'covered': [48]})


@pytest.mark.parametrize(
    ('mask', 'said'),
    [
        ('{polygons_px: ["0,0 319,0 319,239 0,239"]}', 'mask covers the whole image'),
        ('{polygons_px: ["0,0 319,0 319,239", "0,0 9"]}', "polygon 2 of mask.polygons_px is '0,0 9'"),
        ('{polygons_px: ["0,0 nan,0 319,239"]}', 'polygon 1 of mask.polygons_px'),
        ('{polygons_px: "0,0 3,0 3,3"}', "mine.yaml:3: 'mask.polygons_px' must be a list"),
        ('{file: none.png}', r'cannot read the mask .*none\.png'),
        ('{file: mine.yaml}', 'is not a readable picture; name a PNG file'),
        ('{file: white.png}', 'has 640x480 pixels, but image says 320x240'),
        ('{file: black.png}', 'mask covers the whole image'),
        ('{file: spotted.png}', 'separate parts, at most 100 are allowed'),
        ('{file: black.png, polygons_px: ["0,0 9,0 9,9"]}', 'has both mask.file and mask.polygons_px; remove one'),
    ],
)
def test_a_mask_that_cannot_be_used_is_refused_with_its_key(tmp_path: Path, mask: str, said: str) -> None:
    cv2.imwrite(str(tmp_path / 'white.png'), np.full((480, 640), 255, np.uint8))
    cv2.imwrite(str(tmp_path / 'black.png'), np.zeros((240, 320), np.uint8))
    spots = np.full((240, 320), 255, np.uint8)
    spots[::8, ::8] = spots[1::8, ::8] = spots[::8, 1::8] = spots[1::8, 1::8] = 0
    cv2.imwrite(str(tmp_path / 'spotted.png'), spots)
    with pytest.raises(ConfigurationError, match=said):
        load_sensor(described(tmp_path, mask))
