"""Encoded pictures: their size is known before they are unpacked."""

from __future__ import annotations

import struct
import time

import cv2
import numpy as np
import pytest

from tactile_nodes import opencv
from tactile_nodes.decoding import decode, size_of
from tactile_nodes.drivers.camera import jpeg

LOSSLESS = [cv2.IMWRITE_WEBP_QUALITY, 101]
KINDS = [
    ('.png', []),
    ('.jpg', []),
    ('.jpg', [cv2.IMWRITE_JPEG_PROGRESSIVE, 1]),
    ('.jpg', [cv2.IMWRITE_JPEG_RST_INTERVAL, 1]),
    ('.bmp', []),
    ('.tif', []),
    ('.webp', []),
    ('.webp', LOSSLESS),
    ('.pgm', []),
    ('.pgm', [cv2.IMWRITE_PXM_BINARY, 0]),
    ('.ppm', []),
]


def encoded(kind: str, options: list[int], width: int = 40, height: int = 24) -> bytes:
    image = np.random.default_rng(7).integers(0, 255, (height, width, 3), np.uint8)
    return bytes(cv2.imencode(kind, image if kind != '.pgm' else image[..., 0], options)[1].tobytes())


def tiff(order: str, entries: list[tuple[int, int, int]]) -> bytes:
    """A directory of numbers by tag and type, without a picture."""
    kept = {1: 'Bxxx', 3: 'Hxx', 4: 'I'}
    mark = b'II*\0' if order == '<' else b'MM\0*'
    listed = [struct.pack(f'{order}HHI{kept[kind]}', tag, kind, 1, value) for tag, kind, value in entries]
    return mark + struct.pack(f'{order}IH', 8, len(entries)) + b''.join(listed)


def chunk(kind: bytes, payload: bytes = b'') -> bytes:
    return struct.pack('>I', len(payload)) + kind + payload + bytes(4)


def webp(kind: bytes, payload: bytes) -> bytes:
    return b'RIFF' + bytes(4) + b'WEBP' + kind + bytes(4) + payload


def frame(width: int, height: int) -> bytes:
    return b'\xff\xc0\x00\x11\x08' + struct.pack('>HH', height, width) + bytes(10)


FORGED = {
    'png': b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', struct.pack('>II', 60000, 50000)) + chunk(b'IEND'),
    'jpeg': b'\xff\xd8' + frame(60000, 50000),
    'jpeg with a thumbnail': b'\xff\xd8\xff\xe1\x00\x15' + frame(8, 8) + frame(60000, 50000),
    'jpeg with marks in between': b'\xff\xd8\xff\xd0rubbish\xff\x00\xff\xff' + frame(60000, 50000),
    'jpeg with a length of nothing': b'\xff\xd8\xff\xe1\x00\x00' + frame(60000, 50000),
    'bmp': b'BM' + bytes(12) + struct.pack('<Iii', 40, 60000, 50000),
    'bmp upside down': b'BM' + bytes(12) + struct.pack('<Iii', 40, 60000, -50000),
    'bmp of OS/2': b'BM' + bytes(12) + struct.pack('<IHH', 12, 60000, 50000),
    'tiff': tiff('<', [(256, 4, 60000), (257, 4, 50000)]),
    'tiff of Motorola': tiff('>', [(257, 3, 50000), (258, 3, 8), (256, 3, 60000)]),
    'tiff that says it twice': tiff('<', [(256, 3, 60000), (256, 3, 1), (257, 3, 50000), (257, 3, 1)]),
    'tiff in tiles': tiff('<', [(256, 3, 9), (257, 3, 9), (322, 4, 60000), (323, 4, 50000)]),
    'webp': webp(b'VP8X', bytes(4) + struct.pack('<HBHB', 59999, 0, 49999, 0)),
    'pgm': b'P5 # of 8 8\n60000\t#\r50000\n255\n',
}


@pytest.mark.parametrize(('kind', 'options'), KINDS)
@pytest.mark.parametrize(('width', 'height'), [(40, 24), (1, 300)])
def test_the_header_tells_the_size_of_what_is_decoded(kind: str, options: list[int], width: int, height: int) -> None:
    data = encoded(kind, options, width, height)
    assert size_of(data) == (width, height)
    image = decode(data, grey=True)
    assert image is not None and image.shape == (height, width)


@pytest.mark.parametrize('data', FORGED.values(), ids=FORGED)
def test_a_picture_of_three_gigapixels_is_refused_by_its_header(data: bytes) -> None:
    with pytest.raises(
        OSError, match=r'it has 60000x50000 pixels, more than the limit of 8192x8192 pixels \(64 megapixels\)'
    ):
        decode(data, grey=True)


def test_sixty_four_megapixels_are_the_most() -> None:
    def claimed(width: int, height: int) -> bytes:
        return f'P5 {width} {height} 255\n'.encode()

    assert decode(claimed(8192, 8192), grey=True) is None  # no pixels follow
    assert decode(claimed(16384, 4096), grey=True) is None
    with pytest.raises(OSError, match='it has 8193x8192 pixels'):
        decode(claimed(8193, 8192), grey=True)


@pytest.mark.parametrize(
    'data',
    [
        encoded('.png', [])[:-1],
        encoded('.png', [])[:33] + b'\xff' + encoded('.png', [])[34:],  # a part of four gigabytes
        b'GIF89a' + struct.pack('<HH', 8, 8),
        b'RIFF....WAVEfmt ' + bytes(40),
        tiff('<', [(256, 1, 8), (257, 1, 8)]),
        tiff('<', [(256, 3, 8)]),
        b'P5 ' + b'9' * 5000,
        b'P5 #' + b' ' * 5000 + b'\n8 8 255\n' + bytes(64),
        b'P5 3#5\n2 5\n' + bytes(64),  # OpenCV takes it for 3x5
        b'\xff\xd8\xff\xd9',
        b'',
    ],
)
def test_what_has_no_header_that_is_known_here_is_no_picture(data: bytes) -> None:
    assert size_of(data) is None
    assert decode(data, grey=True) is None


def test_a_header_without_an_end_is_given_up_soon() -> None:
    begun = time.process_time()
    assert size_of(b'\xff\xd8' + b'\xff\xd0' * (10 << 20)) is None
    assert size_of(b'\xff\xd8' + b'\xff' * (20 << 20)) is None
    assert time.process_time() - begun < 1.0


@pytest.mark.parametrize(('kind', 'options'), KINDS)
def test_a_damaged_picture_is_none_or_of_the_size_that_its_header_tells(kind: str, options: list[int]) -> None:
    rng, whole = np.random.default_rng(3), np.frombuffer(encoded(kind, options), np.uint8)
    decoded = 0
    for _ in range(300):
        data = whole.copy()
        data[rng.integers(0, min(len(data), 400))] = rng.integers(0, 256)
        try:
            image = decode(data.tobytes(), grey=True)
        except OSError:
            continue
        if image is not None:
            decoded += 1
            assert sorted(image.shape) == sorted(size_of(data.tobytes()) or ())  # a JPEG may ask to be turned
    assert decoded > 0


def test_a_stream_drops_a_picture_that_claims_to_be_gigantic() -> None:
    whole = encoded('.jpg', [])
    at = whole.index(b'\xff\xc0') + 5
    assert jpeg.decode(whole) is not None
    assert jpeg.decode(whole[:at] + struct.pack('>HH', 60000, 60000) + whole[at + 4 :]) is None


def test_opencv_4_11_is_silenced_by_the_name_that_it_has_there(monkeypatch: pytest.MonkeyPatch) -> None:
    levels: list[int] = []
    monkeypatch.delenv('OPENCV_LOG_LEVEL', raising=False)
    monkeypatch.delattr(cv2.utils, 'logging', raising=False)
    monkeypatch.setattr(cv2, 'setLogLevel', levels.append, raising=False)
    assert opencv.load.__wrapped__() is cv2
    assert levels == [0]
