"""Two recordings of one squeeze agree; two of different ones do not."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks import fingers
from tactile_nodes.errors import ConfigurationError

SQUEEZE_PX = [0, 0, 1, 2, 3, 3, 2, 1, 0]
PATTERN = np.random.default_rng(3).integers(20, 220, (30, 30), dtype=np.uint8).repeat(4, 0).repeat(4, 1)


def recording(folder: Path, motion_px: list[int]) -> Path:
    folder.mkdir()
    for number, shift in enumerate(motion_px):
        cv2.imwrite(str(folder / f'{number:03d}.png'), np.roll(PATTERN, shift, axis=1))
    return folder


def test_reading_is_the_motion_of_the_pattern(tmp_path: Path) -> None:
    reading = fingers.read(recording(tmp_path / 'a', SQUEEZE_PX), rest=0)
    assert reading.motion_px == pytest.approx(SQUEEZE_PX[1:], abs=0.15)


def test_fingers_that_feel_the_same_agree_and_opposite_ones_do_not(tmp_path: Path) -> None:
    one = fingers.read(recording(tmp_path / 'a', SQUEEZE_PX), rest=0)
    half_as_soft = fingers.read(recording(tmp_path / 'b', [2 * shift for shift in SQUEEZE_PX]), rest=0)
    opposite = fingers.read(recording(tmp_path / 'c', [0, *(3 - shift for shift in SQUEEZE_PX[1:])]), rest=0)
    assert fingers.agreement(one, half_as_soft) > 0.95
    assert fingers.agreement(one, opposite) < -0.95


def test_recording_shorter_than_its_rest_frame_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match='ends before its frame 10'):
        fingers.read(recording(tmp_path / 'a', SQUEEZE_PX), rest=10)


@pytest.mark.parametrize(
    ('squeeze', 'frames', 'least'), [('ball_white_thread/exp_num_2', 220, 0.85), ('cheese_tube/exp_num_1', 57, 0.65)]
)
def test_real_fingers_rise_and_fall_together(shared_data: Path, squeeze: str, frames: int, least: float) -> None:
    folder = shared_data / 'gelsight_mini_videos' / squeeze
    one, other = (fingers.read(folder / f'camera_{number}.avi', rest=10) for number in (0, 2))
    assert len(one.motion_px) == len(other.motion_px) == frames
    assert fingers.agreement(one, other) > least
