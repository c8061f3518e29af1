from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes.errors import ConfigurationError, ImageError
from tactile_nodes.sensing.features import Features, block_means, fewer_means, make_encoding
from tactile_nodes.sensing.flow.methods import DisplacementField


def uniform(dx: float, dy: float, side: int = 440) -> DisplacementField:
    return DisplacementField(np.full((side, side, 2), [dx, dy], np.float32))


def test_the_papers_features_are_3200():
    assert make_encoding('polar_mean').encode(uniform(0, 0)).values.size == 3200


def test_three_right_and_four_down_is_five_pixels_at_53_degrees():
    values = make_encoding('polar_mean').encode(uniform(3, 4)).values
    np.testing.assert_allclose(values[..., 0], 5, rtol=1e-6)
    np.testing.assert_allclose(values[..., 1], np.arctan2(4, 3), atol=1e-3)


def test_upwards_is_three_quarters_of_a_turn():
    values = make_encoding('polar_mean').encode(uniform(0, -1)).values
    np.testing.assert_allclose(values[..., 1], 1.5 * np.pi, atol=1e-3)


def test_angles_average_as_plain_numbers_over_the_wrap():
    field = np.empty((440, 440, 2), np.float32)
    field[::2] = [np.cos(0.1), np.sin(0.1)]
    field[1::2] = [np.cos(0.1), -np.sin(0.1)]
    angle = make_encoding('polar_mean', {'rows': 20, 'cols': 20}).encode(DisplacementField(field)).values[..., 1]
    np.testing.assert_allclose(angle, np.pi, atol=1e-3)


def test_cartesian_means_keep_the_signs():
    values = make_encoding('cartesian_mean').encode(uniform(-0.25, 0.5)).values
    np.testing.assert_allclose(values, np.broadcast_to([-0.25, 0.5], (40, 40, 2)), atol=1e-6)


def test_rows_run_down_and_columns_to_the_right():
    field = uniform(0, 0)
    field.displacement_px[11:22, 55:66] = [1, 0]  # region in row 1, column 5
    values = make_encoding('cartesian_mean').encode(field).values
    assert values[1, 5, 0] == pytest.approx(1)
    assert np.count_nonzero(values) == 1


def test_a_block_mean_is_the_mean_of_the_block():
    random = np.random.default_rng(1).normal(size=(22, 33)).astype(np.float32)
    expected = random.reshape(2, 11, 3, 11).mean(axis=(1, 3))
    np.testing.assert_allclose(block_means(random, 2, 3), expected, atol=1e-6)


def test_regions_without_texture_are_not_believed():
    image = np.full((440, 440), 20, np.uint8)
    image[:, 220:] = np.random.default_rng(2).integers(0, 2, (440, 220)) * 200
    encoding = make_encoding('polar_mean')
    encoding.set_reference(image)
    confidence = encoding.encode(uniform(0, 0)).confidence
    assert confidence[:, :19].max() == 0
    assert confidence[:, 21:].min() > 0.8


def test_confidence_of_the_flow_and_of_the_texture_multiply():
    encoding = make_encoding('polar_mean')
    field = DisplacementField(np.zeros((440, 440, 2), np.float32), np.full((440, 440), 0.25, np.float32))
    np.testing.assert_allclose(encoding.encode(field).confidence, 0.25)


def test_regions_must_divide_the_image():
    with pytest.raises(ImageError, match='40x40 regions do not divide an image of 441x440'):
        make_encoding('polar_mean').encode(DisplacementField(np.zeros((440, 441, 2), np.float32)))


def test_an_unknown_encoding_is_refused_with_those_there_are():
    with pytest.raises(ConfigurationError, match='polar_mean, cartesian_mean'):
        make_encoding('fourier')


def test_an_unknown_option_is_refused():
    with pytest.raises(ConfigurationError, match="no option 'raws'"):
        make_encoding('polar_mean', {'raws': 40})


def test_means_over_fewer_regions_go_by_how_far_each_is_believed():
    """Of 1 px believed fully and 4 px believed half: 3 px / 1.5 in the one, nothing believed in the other."""
    values = np.zeros((1, 4, 2), np.float32)
    values[0, :, 0] = [1, 4, 7, 7]
    seen = Features('cartesian_mean', values, np.array([[1, 0.5, 0, 0]], np.float32))
    means, sure = fewer_means(seen.values, seen.confidence, 1, 2)
    np.testing.assert_allclose(means[0, :, 0], [2, 0], atol=1e-6)
    np.testing.assert_allclose(sure, [[0.75, 0]])
