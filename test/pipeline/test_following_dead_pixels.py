"""Frames with dead pixels in, features out."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from dots import SIDE, picture, press

from tactile_nodes import conversions
from tactile_nodes.messages import types
from tactile_nodes.pipeline.following import Following, FollowingParams

FORCE = types.ForceDistribution
S = 1_000_000_000
TOUCH = press(180, 250, 1.5)
DRAWN = np.random.default_rng(6).random((SIDE, SIDE))


def answered(frames: Iterator[np.ndarray]) -> list[types.FlowFeatures]:
    following = Following(FollowingParams(reference_frames=4))
    following.begin_capture()
    return [
        following.answer(image, conversions.header(S + number * S // 30, 'camera'), acquire_s=0.0)
        for number, image in enumerate(frames)
    ]


def stream(share: float, grey: int, begin: int) -> Iterator[np.ndarray]:
    """At rest, then touched; pixels die in the frame `begin`."""
    for number in range(20):
        image = picture(*([TOUCH] if number >= 16 else []), number=number)
        if number >= begin:
            image[share > DRAWN] = grey
        yield image


@pytest.fixture(scope='module')
def plain() -> list[types.FlowFeatures]:
    """What is answered where no pixel is dead."""
    return answered(stream(0.0, 0, begin=0))


@pytest.mark.parametrize(('share', 'grey', 'begin'), [(0.001, 255, 0), (0.001, 0, 6), (0.008, 255, 6), (0.008, 0, 0)])
def test_dead_pixels_are_filled_in_within_eight_frames_and_nothing_is_said(
    share: float, grey: int, begin: int, plain: list[types.FlowFeatures]
) -> None:
    filled = answered(stream(share, grey, begin))
    assert {each.reasons for each in filled[begin + 8 :]} <= {each.reasons for each in plain[begin + 8 :]} == {0}
    off = np.abs(filled[-1].values - plain[-1].values).max()
    assert off < 0.01 + 1.5 * 0.5 * share  # a patch shows less of its motion by half of the share that says little
    assert len({each.reference_id for each in filled[4:]}) == 1


def test_a_picture_of_which_more_than_a_hundredth_is_guessed_is_reported(plain: list[types.FlowFeatures]) -> None:
    filled = answered(stream(0.03, 255, begin=6))
    assert filled[-1].reasons == FORCE.REASON_LIGHT_CHANGED
    assert np.abs(filled[-1].values - plain[-1].values).max() < 0.01 + 1.5 * 0.5 * 0.03
