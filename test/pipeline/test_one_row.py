"""A picture goes down one row of stages: from the camera's message to the force no stage is entered twice."""

from __future__ import annotations

import sys
from pathlib import Path
from types import FrameType

import pytest
from dots import picture, press

import tactile_nodes
from tactile_nodes import conversions
from tactile_nodes.pipeline.estimating import Estimating
from tactile_nodes.pipeline.following import Following, FollowingParams

PACKAGE = f'{Path(tactile_nodes.__file__).parent}/'
CARRIED = {'Frame', 'FlowFeatures', 'Features', 'DisplacementField', 'ForceMap', 'Judged'}
"""What a picture becomes on its way; a file is entered when a function of it is handed one."""
BESIDE = ('conversions.py', 'messages/')


def files_entered(following: Following, estimating: Estimating) -> list[str]:
    """Each file that one pressed frame comes into, in order, as often as it comes into it."""
    entered: list[str] = []

    def called(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event != 'call' or not code.co_filename.startswith(PACKAGE):
            return
        names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
        file = code.co_filename.removeprefix(PACKAGE)
        carries = any(type(frame.f_locals.get(name)).__name__ in CARRIED for name in names)
        if carries and not file.startswith(BESIDE) and entered[-1:] != [file]:
            entered.append(file)

    image, head = picture(press(200, 230, 1.0), number=13), conversions.header(2_000_000_000, 'camera')
    sys.setprofile(called)
    try:
        estimating.answer(following.answer(image, head, acquire_s=0.0), 'gel', 0.85, 0.0)
    finally:
        sys.setprofile(None)
    return entered


@pytest.mark.parametrize('model', ['fast', 'field'])
def test_a_pressed_frame_stays_in_twelve_files_and_returns_to_two_at_most(model: str) -> None:
    following, estimating = Following(FollowingParams(model=model, reference_frames=4)), Estimating(model)
    following.begin_capture()
    for number in range(12):
        following.answer(picture(number=number), conversions.header(1_000_000_000 + number * 33_000_000, 'camera'))
    entered = files_entered(following, estimating)
    stages = [f'pipeline/{each}.py' for each in ('mend', 'measure', 'judge', 'rest_images', 'tell')]
    assert [each for each in entered if each in stages][:5] == stages
    assert len(entered) <= 12
    assert len(entered) - len(set(entered)) <= 2
