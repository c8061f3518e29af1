"""Decodes images (PNG, JPEG, BMP, TIFF, WebP, PGM and PPM) and opens videos.

A few kilobytes can unpack to gigabytes, and OpenCV allocates the memory before it reports the size of an image. So the
size is read from the header first. A format whose header is not known here is not accepted as an image.
"""

from __future__ import annotations

import errno
import re
import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactile_nodes import opencv
from tactile_nodes.files import PICTURE_BYTES, read_plain

LARGEST_SIDE = 8192
LARGEST = f'{LARGEST_SIDE}x{LARGEST_SIDE} pixels (64 megapixels)'
"""The limit in words; a narrower image may be longer."""

Picture = npt.NDArray[np.uint8]
Size = tuple[int, int]
"""Width, height."""

_PNG_CHUNKS = 1 << 16
_PNM_BYTES = 4096
_PNM = re.compile(rb'P[1-6]\s%s(\d{1,10})\s%s(\d{1,10})\s' % ((rb'(?:\s|#[^\r\n]*[\r\n])*',) * 2))
_JPEG_MARKER = re.compile(rb'\xff[^\x00\xff]')  # bytes before a marker are skipped, as in the decoder
_JPEG_SIZES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # ITU-T T.81, table B.1: start of a frame
_JPEG_ALONE = frozenset({0x01, *range(0xD0, 0xD8)})  # markers without a segment
_JPEG_SEGMENTS = 4096
_TIFF_WIDTHS, _TIFF_HEIGHTS = {256, 322}, {257, 323}  # of the image, and of a tile, which is unpacked whole
_TIFF_NUMBERS = {3: 'H', 4: 'I'}


def decode(data: bytes, *, grey: bool) -> Picture | None:
    """The image, (h, w), or unless `grey` also (h, w, 3) blue-green-red; None if the data are not an image.

    Raises:
        OSError: it is larger than `LARGEST`; `strerror` says so.
    """
    if (size := size_of(data)) is None:
        return None
    check_pixels(*size)
    cv2 = opencv.load()
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE if grey else cv2.IMREAD_ANYCOLOR)
    except cv2.error:  # raised for some damaged images
        return None
    return None if image is None else np.asarray(image, np.uint8)


def read_picture(path: str | Path, *, grey: bool) -> Picture:
    """The image in a file, in the format of `decode`.

    Raises:
        OSError: it cannot be read, is too large, or is not an image; `strerror` says which.
    """
    picture = decode(read_plain(path, PICTURE_BYTES), grey=grey)
    if picture is None:
        raise OSError(errno.EINVAL, 'it is not a readable picture')
    return picture


def check_pixels(width: int, height: int) -> None:
    """Raise OSError, with a sentence in `strerror`, for an image larger than `LARGEST`."""
    if width * height > LARGEST_SIDE**2:
        raise OSError(errno.EFBIG, f'it has {width}x{height} pixels, more than the limit of {LARGEST}')


def open_video(source: str, options: Sequence[int] = ()) -> Any | None:
    """A `cv2.VideoCapture` of a file or a stream, by FFmpeg; None if FFmpeg finds no video there.

    Raises:
        OSError: its images are larger than `LARGEST`; `strerror` says so.
    """
    cv2 = opencv.load()
    video = cv2.VideoCapture(source, cv2.CAP_FFMPEG, options)
    if not video.isOpened():
        return None
    try:
        check_pixels(round(video.get(cv2.CAP_PROP_FRAME_WIDTH)), round(video.get(cv2.CAP_PROP_FRAME_HEIGHT)))
    except OSError:
        video.release()
        raise
    return video


def size_of(data: bytes) -> Size | None:
    """The size in an image's header; None if the data are not an image."""
    for signature, read in _KINDS.items():
        if data.startswith(signature):
            try:
                return read(data)
            except struct.error:  # the header is truncated
                return None
    return None


def _png(data: bytes) -> Size | None:
    """Also None if a chunk claims to be longer than the file, because OpenCV would allocate memory for it."""
    width, height = struct.unpack_from('>II', data, 16)
    at = 8
    for _ in range(_PNG_CHUNKS if data[12:16] == b'IHDR' else 0):
        length, kind = struct.unpack_from('>I4s', data, at)
        at += 12 + length
        if at > len(data):
            return None
        if kind == b'IEND':
            return width, height
    return None


def _jpeg(data: bytes) -> Size | None:
    at = 2
    for _ in range(_JPEG_SEGMENTS):
        if (found := _JPEG_MARKER.search(data, at)) is None:
            return None
        marker, at = data[found.end() - 1], found.end()
        if marker in _JPEG_SIZES:
            height, width = struct.unpack_from('>HH', data, at + 3)
            return width, height
        if marker not in _JPEG_ALONE:
            (length,) = struct.unpack_from('>H', data, at)
            at += max(length, 2)
    return None


def _bmp(data: bytes) -> Size | None:
    (header_bytes,) = struct.unpack_from('<I', data, 14)
    width, height = struct.unpack_from('<HH' if header_bytes == 12 else '<ii', data, 18)
    return abs(width), abs(height)  # negative: the lines are stored from top to bottom


def _tiff(data: bytes) -> Size | None:
    """The largest size in the first directory."""
    order = '<' if data.startswith(b'II') else '>'
    (at,) = struct.unpack_from(f'{order}I', data, 4)
    (entries,) = struct.unpack_from(f'{order}H', data, at)
    width = height = 0
    for entry in range(at + 2, at + 2 + 12 * entries, 12):
        tag, kind = struct.unpack_from(f'{order}HH', data, entry)
        if tag not in _TIFF_WIDTHS | _TIFF_HEIGHTS:
            continue
        if kind not in _TIFF_NUMBERS:
            return None
        (side,) = struct.unpack_from(f'{order}{_TIFF_NUMBERS[kind]}', data, entry + 8)
        width, height = max(width, side * (tag in _TIFF_WIDTHS)), max(height, side * (tag in _TIFF_HEIGHTS))
    return (width, height) if width and height else None


def _webp(data: bytes) -> Size | None:
    """RFC 9649: a lossy image, a lossless one, or the canvas of an extended one."""
    kind = data[8:16]
    if kind == b'WEBPVP8 ':
        width, height = struct.unpack_from('<HH', data, 26)
        return width & 0x3FFF, height & 0x3FFF
    if kind == b'WEBPVP8L':
        (bits,) = struct.unpack_from('<I', data, 21)
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if kind == b'WEBPVP8X':
        low_width, high_width, low_height, high_height = struct.unpack_from('<HBHB', data, 24)
        return (high_width << 16 | low_width) + 1, (high_height << 16 | low_height) + 1
    return None


def _pnm(data: bytes) -> Size | None:
    found = _PNM.match(data[:_PNM_BYTES])
    return (int(found[1]), int(found[2])) if found else None


_KINDS: dict[bytes, Callable[[bytes], Size | None]] = {
    b'\x89PNG\r\n\x1a\n': _png,
    b'\xff\xd8\xff': _jpeg,
    b'BM': _bmp,
    b'II*\0': _tiff,
    b'MM\0*': _tiff,
    b'RIFF': _webp,
    b'P': _pnm,
}
