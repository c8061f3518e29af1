"""Whole and broken JPEG pictures."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from tactile_nodes.drivers.camera import jpeg


def test_a_whole_picture_is_decoded_also_with_padding_after_its_end(jpeg_of: Callable[..., bytes]) -> None:
    data = jpeg_of(3)
    for padding in (b'', b'\0' * 512, b'\r\n', b'\r\n--'):
        image = jpeg.decode(data + padding)
        assert image is not None
        assert abs(float(image.mean()) - 52) < 2  # number 3: level 20 + 30, every other column 4 above


def test_a_grey_picture_stays_grey() -> None:
    data = cv2.imencode('.jpg', np.full((16, 24), 77, np.uint8))[1].tobytes()
    assert jpeg.decode(data).shape == (16, 24)


def test_of_a_picture_in_colour_its_grey_is_taken():
    colour = np.full((16, 24, 3), (200, 100, 50), np.uint8)
    data = cv2.imencode('.jpg', colour, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
    image = jpeg.decode(data)
    assert image is not None and image.shape == (16, 24)
    assert image == pytest.approx(0.114 * 200 + 0.587 * 100 + 0.299 * 50, abs=1.5)  # ITU-R BT.601, which JPEG takes


@pytest.mark.parametrize(
    'cut', [lambda d: d[:-2], lambda d: d[: len(d) // 2], lambda d: d[1:], lambda d: b'', lambda d: b'\xff\xd8\xff\xd9']
)
def test_a_picture_that_is_not_whole_is_none(cut: Callable[[bytes], bytes], jpeg_of: Callable[..., bytes]) -> None:
    assert jpeg.decode(cut(jpeg_of(3))) is None
