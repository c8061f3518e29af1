"""Moments of a video whose frames are not evenly spaced, as phones record it."""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.tables.pictures import VideoPictures
from tactile_nodes.learning.tables.presses import read_table

BOXES = b'moov', b'trak', b'mdia', b'minf', b'stbl'


def uneven_video(file: Path) -> Path:
    """Ten frames, each 20 brighter than the one before: eight that last 0.05 s, then two that last 0.3 s."""
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter_fourcc(*'mp4v'), 10.0, (64, 64), False)
    for number in range(10):
        writer.write(np.full((64, 64), 20 * number + 10, np.uint8))
    writer.release()
    data = bytearray(file.read_bytes())
    at = data.index(b'stts') - 4
    size, kind, flags, _, _, tenth = struct.unpack_from('>I4s4I', data, at)
    data[at : at + size] = struct.pack('>I4s6I', 32, kind, flags, 2, 8, tenth // 2, 2, 3 * tenth)
    for box in BOXES:  # which hold the longer list
        start = data.index(box) - 4
        struct.pack_into('>I', data, start, struct.unpack_from('>I', data, start)[0] + 32 - size)
    file.write_bytes(data)
    return file


def brightness(folder: Path, *times_s: float) -> list[int]:
    """The numbers of the frames at these times."""
    table = folder / 'times.csv'
    rows = ''.join(f'{each},1,1,0.2\n' for each in times_s)
    table.write_text(f'time_s,x_mm,y_mm,force_n\n{rows}')
    read = read_table(table)
    faults = read.faults
    found = [
        round((float(picture.mean()) - 10) / 20)
        for _, picture in VideoPictures(uneven_video(folder / 'uneven.mp4')).of(read.rows, faults)
    ]
    faults.require_none()
    return found


def test_a_moment_is_the_frame_that_a_player_shows_then(tmp_path: Path) -> None:
    assert brightness(tmp_path, 0.0, 0.06, 0.29, 0.36, 0.42, 0.69, 0.71) == [0, 1, 6, 7, 8, 9, 9]


def test_a_moment_after_the_last_frame_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r'time 2 s: .* ends at 0\.8 s'):
        brightness(tmp_path, 0.0, 2.0)
