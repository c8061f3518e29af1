"""Recordings of two real GelSight Mini fingers that squeeze a ball: described from what is known, never pressed."""

from __future__ import annotations

import dataclasses
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
from tactile_nodes.sensing.elasticity.rays import dot_place_mm
from tactile_nodes.sensing.elasticity.view import View
from tactile_nodes.sensing.flow.dot_pattern import find_dots
from tactile_nodes.sensing.geometry import grey
from tactile_nodes.sensors import load_sensor

RECORDINGS = Path(__file__).parents[2].parent / 'shared' / 'data' / 'gelsight_mini_videos'
BALL, TUBE = RECORDINGS / 'ball_white_thread' / 'exp_num_2', RECORDINGS / 'cheese_tube' / 'exp_num_1'
FINGERS = 0, 2
REST, HELD, FREE = 11, slice(20, 180), slice(-15, None)
"""Frames of the recordings: the untouched gel; of the ball's the squeeze, and after it."""

pytestmark = [
    pytest.mark.shared_data,
    pytest.mark.skipif(not RECORDINGS.is_dir(), reason='needs the recordings beside the checkout'),
]


@dataclasses.dataclass(frozen=True)
class Grasp:
    """The forces of each finger, frame by frame."""

    recording: Path
    forces: list[list[types.ForceDistribution]]

    @property
    def totals(self) -> list[np.ndarray]:
        """Of each finger; no number: 0."""
        return [np.nan_to_num([each.total for each in finger]) for finger in self.forces]


def read(video: Path, folder: Path) -> list[types.ForceDistribution]:
    """The forces of a recording: its untouched gel is the rest image, and says where its dots are."""
    capture, pictures = cv2.VideoCapture(str(video)), list[np.ndarray]()
    while (frame := capture.read())[0]:
        pictures.append(np.ascontiguousarray(grey(frame[1])))
    known, dots = load_sensor('printed_dots'), find_dots(pictures[REST])
    assert dots is not None
    pattern = dataclasses.replace(known.pattern, dot_mm=dot_place_mm(View(known), dots.centres_px))
    model = str(folder / 'dots.safetensors')
    own = dataclasses.replace(known, pattern=pattern)
    described_model(load_model(find_model('field')), own, '', Path(model), Progress())
    following, estimating, forces = Following(FollowingParams(model=model)), Estimating(model), []
    for number, picture in enumerate(pictures):
        head = conversions.header((number + 1) * 40_000_000, '')
        if number == REST:
            following.use_reference(picture, head)
        forces.append(estimating.answer(following.answer(picture, head), '', 0.85, 0.0))
    return forces


@pytest.fixture(scope='module', params=[BALL, TUBE], ids=lambda each: each.parent.name)
def grasp(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Grasp:
    """The forces of both fingers in a recording."""
    folder = tmp_path_factory.mktemp('dots')
    forces = [read(request.param / f'camera_{finger}.avi', folder) for finger in FINGERS]
    return Grasp(request.param, forces)


def test_a_grasp_is_followed_from_the_first_touch_to_its_release(grasp: Grasp) -> None:
    if grasp.recording != BALL:
        pytest.skip('the tube is held for nine frames alone')
    for total in grasp.totals:
        assert total[REST] == 0.0
        assert total[HELD].min() > 0.4
        assert total[FREE].max() < 0.3 * total[HELD].mean()
    forces = [each for finger in grasp.forces for each in finger[REST + 1 :]]
    assert {each.status for each in forces if each.total > 0.2} == {types.ForceDistribution.STATUS_DEGRADED}


def test_two_fingers_feel_the_same_squeeze(grasp: Grasp) -> None:
    """Nobody measured it, but what one presses the other bears: within a tenth while both hold."""
    first, second = grasp.totals
    held = (first > first.max() / 2) & (second > second.max() / 2)
    assert held.sum() >= 8
    assert first[held].mean() == pytest.approx(second[held].mean(), rel=0.1)
