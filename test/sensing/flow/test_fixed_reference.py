from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from shifting import shifted

from tactile_nodes.errors import ConfigurationError, ImageError
from tactile_nodes.sensing.features import make_encoding
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.flow.methods import FlowMethod

NAME = 'inverse_compositional'
SMALL: dict[str, object] = {'rows': 20, 'cols': 20, 'finest_scale': 1}


def flow_of(rest: np.ndarray, **options: object) -> FlowMethod:
    flow = make_flow(NAME, options)
    flow.set_reference(rest)
    return flow


def middle_of(flow: FlowMethod, image: np.ndarray) -> np.ndarray:
    """Displacement of the patches away from the border."""
    found = flow.displacement(image).displacement_px
    rows, cols = found.shape[:2]
    return found[rows // 5 : -rows // 5, cols // 5 : -cols // 5]


@pytest.mark.parametrize(
    ('shift', 'options'),
    [((0.02, -0.01), {}), ((0.5, 0.5), SMALL), ((1.5, -0.8), {}), ((-6.3, 4.4), SMALL), ((21.0, -24.5), SMALL)],
)
def test_every_patch_reads_a_shift_of_any_size_with_its_signs(speckle: np.ndarray, shift, options):
    found = middle_of(flow_of(speckle, **options), shifted(speckle, *shift))
    np.testing.assert_allclose(found, np.broadcast_to(shift, found.shape), atol=0.02)


def test_there_is_one_displacement_a_patch_with_its_confidence(speckle: np.ndarray):
    field = flow_of(speckle, rows=10, cols=20).displacement(speckle)
    assert field.displacement_px.dtype == np.float32
    assert field.displacement_px.shape == (10, 20, 2)
    assert field.confidence is not None
    assert field.confidence.dtype == np.float32
    assert field.confidence.shape == (10, 20)


@pytest.mark.parametrize(('height', 'width'), [(40, 40), (48, 400), (63, 63)])
def test_a_small_image_is_measured_where_its_patches_are_lost_too(speckle: np.ndarray, height: int, width: int):
    """Half of it shows something else. A dense search needs 64 pixels along both sides."""
    rest = np.ascontiguousarray(speckle[:height, :width])
    changed = rest.copy()
    changed[: height // 2] = speckle[200 : 200 + height // 2, :width]
    field = flow_of(rest, rows=4, cols=width // 10).displacement(changed)
    np.testing.assert_allclose(field.displacement_px[-1], 0, atol=0.1)
    assert field.confidence is not None
    assert field.confidence[0].max() < 0.3


def test_features_by_region_take_the_patches_as_they_are(speckle: np.ndarray):
    field = flow_of(speckle, **SMALL).displacement(shifted(speckle, 1.0, 2.0))
    encoding = make_encoding('cartesian_mean', {'rows': 20, 'cols': 20})
    np.testing.assert_array_equal(encoding.encode(field).values, field.displacement_px)


@pytest.mark.parametrize(('gain', 'offset'), [(0.7, 0), (1.3, 0), (0.8, 20)])
def test_light_that_changes_is_not_motion(speckle: np.ndarray, gain: float, offset: float):
    rest = (speckle * 0.6).astype(np.uint8)
    lit = np.clip(np.round(gain * shifted(rest, 0.3, -0.2).astype(float) + offset), 0, 255).astype(np.uint8)
    found = middle_of(flow_of(rest, **SMALL), lit)
    np.testing.assert_allclose(found, np.broadcast_to((0.3, -0.2), found.shape), atol=0.02)


def test_patches_without_texture_follow_their_neighbours_and_say_so(speckle: np.ndarray):
    hole = np.zeros((440, 440), np.float32)
    hole[160:280, 160:280] = 1
    rest = (128 + (speckle - 128.0) * (1 - cv2.GaussianBlur(hole, (0, 0), 6.0))).astype(np.uint8)
    image = shifted(rest, 0.8, 0.4)
    field = flow_of(rest, rows=20, cols=20).displacement(image)
    assert field.confidence is not None
    assert field.confidence[9:11, 9:11].max() < 0.3
    assert field.confidence[2:8, 2:8].min() > 0.8
    np.testing.assert_allclose(field.displacement_px[9:11, 9:11], np.broadcast_to((0.8, 0.4), (2, 2, 2)), atol=0.1)


@pytest.mark.parametrize(('row', 'col', 'options'), [(150, 170, SMALL), (0, 0, {'rows': 20, 'cols': 20})])
def test_what_went_far_is_searched_for_and_patches_far_from_it_stay_as_they_were(
    speckle: np.ndarray, row: int, col: int, options: dict[str, object]
):
    """120 px that went 14 px to the right, with noise, where that was half of a marker's distance to the next one."""
    image, went = speckle.copy(), (slice(row, row + 120), slice(col, col + 120))
    image[went] = np.roll(speckle, 14, axis=1)[went]
    searched, alone = (flow_of(speckle, **options, search_share=share).displacement(image) for share in (0.01, 1.0))
    inside = tuple(slice(each.start // 22 + 1 + 2 * (each is went[1]), each.stop // 22 - 1) for each in went)
    moved = searched.displacement_px[inside] - np.array([14.0, 0.0])
    assert np.median(np.abs(moved)) < 0.05
    away = searched.displacement_px.shape[0] - 4
    far = slice(away, None) if row < 200 else slice(0, 4)
    np.testing.assert_array_equal(searched.displacement_px[far, -4:], alone.displacement_px[far, -4:])


def test_a_picture_of_something_else_is_not_believed(speckle: np.ndarray):
    other = shifted(speckle, 200.0, 150.0)
    confidence = flow_of(speckle, **SMALL).displacement(other).confidence
    assert confidence is not None
    assert np.median(confidence) < 0.3


def test_no_texture_at_all_is_no_motion_and_no_confidence():
    grey = np.full((440, 440), 90, np.uint8)
    field = flow_of(grey, **SMALL).displacement(grey)
    assert field.confidence is not None
    np.testing.assert_array_equal(field.displacement_px, 0)
    np.testing.assert_array_equal(field.confidence, 0)


def test_a_scale_that_leaves_nothing_of_the_image_is_refused(speckle: np.ndarray):
    with pytest.raises(ImageError, match='finest_scale 6 leaves 6x6 of 440x440 pixels'):
        flow_of(speckle, finest_scale=6)


def test_patches_finer_than_pixels_are_still_measured(speckle: np.ndarray):
    assert np.isfinite(flow_of(speckle, rows=80, cols=80, finest_scale=3).displacement(speckle).displacement_px).all()


@pytest.mark.parametrize(
    'options', [{'rows': 0}, {'iterations': 0}, {'window': 'wide'}, {'speed': 1}, {'finest_scale': -1}]
)
def test_wrong_options_are_refused(options: dict[str, object]):
    with pytest.raises(ConfigurationError):
        make_flow(NAME, options)


@pytest.mark.shared_data
@pytest.mark.parametrize(('frame', 'shift'), [('04', 0.4), ('08', 0.8), ('10', 1.0), ('25', 25.0)])
def test_somebody_elses_speckle_moves_as_commanded(shared_data: Path, frame: str, shift: float):
    rest, image = (
        cv2.imread(str(shared_data / 'dic_rigid_shift' / f'rigid_cam0_frame{each}.tiff'), cv2.IMREAD_GRAYSCALE)
        for each in ('00', frame)
    )
    found = middle_of(flow_of(rest, **SMALL), image)
    np.testing.assert_allclose(np.median(found, axis=(0, 1)), [shift, -shift], atol=0.01 if shift < 2 else 0.05)
