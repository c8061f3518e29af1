"""Recordings of two real GelSight Mini fingers that squeeze a ball: described from what is known, never pressed."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tactile_nodes import conversions
from tactile_nodes.learning.field.calibration import described_model
from tactile_nodes.learning.progress import Progress
from tactile_nodes.messages import types
from tactile_nodes.model_file import find_model, load_model
from tactile_nodes.pipeline.estimating import Estimating
from tactile_nodes.pipeline.following import Following, FollowingParams
from tactile_nodes.sensing.geometry import grey
from tactile_nodes.sensors import load_sensor

RECORDINGS = Path(__file__).parents[2].parent / 'shared' / 'data' / 'gelsight_mini_videos'
VIDEOS = RECORDINGS / 'ball_white_thread' / 'exp_num_2'
REST, HELD, FREE = 11, slice(20, 180), slice(-15, None)
"""Frames of the recording: the untouched gel, the squeeze, and after it."""


@pytest.fixture(scope='module')
def model(tmp_path_factory: pytest.TempPathFactory) -> str:
    file = tmp_path_factory.mktemp('dots') / 'dots.safetensors'
    described_model(load_model(find_model('field')), load_sensor('printed_dots'), '', file, Progress())
    return str(file)


def read(model: str, video: Path) -> list[types.ForceDistribution]:
    """The forces of a recording, its untouched gel being the rest image."""
    following, estimating = Following(FollowingParams(model=model)), Estimating(model)
    capture, forces = cv2.VideoCapture(str(video)), []
    while (frame := capture.read())[0]:
        picture, head = np.ascontiguousarray(grey(frame[1])), conversions.header((len(forces) + 1) * 40_000_000, '')
        if len(forces) == REST:
            following.use_reference(picture, head)
        forces.append(estimating.answer(following.answer(picture, head), '', 0.85, 0.0))
    return forces


@pytest.mark.shared_data
@pytest.mark.skipif(not VIDEOS.is_dir(), reason='needs the recordings beside the checkout')
@pytest.mark.parametrize('camera', [0, 2])
def test_a_grasp_is_followed_from_the_first_touch_to_its_release(model: str, camera: int) -> None:
    forces = read(model, VIDEOS / f'camera_{camera}.avi')
    total = np.array([each.total for each in forces])
    assert total[REST] == 0.0
    assert total[HELD].min() > 0.5
    assert total[FREE].max() < 0.3 * total[HELD].mean()
    assert {each.status for each in forces[REST + 1 :]} == {types.ForceDistribution.STATUS_DEGRADED}  # uncalibrated
