"""A rest image that was pressed shows in the first frames beside it: motion towards the place."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes.sensing.picture.dented_rest import LEAST_FRAMES, PROVEN_FRAMES, DentedRest
from tactile_nodes.sensing.picture.quietness import PATCHES

FOUND = np.ones(PATCHES**2, bool)
NOISE_PX = 0.003


def touch(most_px: float, x: float = 3.2, y: float = 6.1) -> np.ndarray:
    """Motion away from a place (in patches), most at a distance of 0.85 patches."""
    across = np.arange(PATCHES)
    apart = np.stack(np.meshgrid(across - x, across - y), axis=-1).reshape(-1, 2) / 0.85
    away: np.ndarray = most_px * apart * np.exp(0.5 - 0.5 * np.square(apart).sum(axis=1, keepdims=True))
    return away


def fed(motion: np.ndarray, frames: int, seed: int = 0) -> DentedRest:
    rest, random = DentedRest(), np.random.default_rng(seed)
    for _ in range(frames):
        rest.without(motion + random.normal(0, NOISE_PX, motion.shape), FOUND, settled=True)
    return rest


@pytest.mark.parametrize('most_px', [0.012, 0.03, 0.2])
def test_motion_towards_a_place_is_a_dent_after_few_frames_and_taken_out(most_px: float) -> None:
    assert not fed(-touch(most_px), LEAST_FRAMES - 1).dented
    rest = fed(-touch(most_px), LEAST_FRAMES)
    assert rest.dented
    left = rest.without(-touch(most_px), FOUND, settled=True)
    # The mean of four frames: 0.0015 px, and 200 numbers stay below four times that but once in eighty.
    assert np.abs(left).max() < 4 * NOISE_PX / 2


@pytest.mark.parametrize('most_px', [0.0, 0.012, 0.03, 0.2])
@pytest.mark.parametrize('seed', range(5))
def test_noise_and_motion_away_from_a_place_are_none(most_px: float, seed: int) -> None:
    rest = fed(touch(most_px), 40, seed)
    assert not rest.dented
    assert not rest.known


def test_a_press_beside_the_dent_says_nothing_until_it_ends() -> None:
    rest, random = DentedRest(), np.random.default_rng(1)
    for pressed in [True] * 10 + [False] * LEAST_FRAMES:
        assert not rest.dented
        motion = touch(0.3, 7.0, 2.0) * pressed - touch(0.02)
        rest.without(motion + random.normal(0, NOISE_PX, motion.shape), FOUND, settled=True)
    assert rest.dented


def test_a_rest_image_beside_which_enough_frames_are_at_rest_has_none_for_good() -> None:
    rest = DentedRest()
    for _ in range(PROVEN_FRAMES):
        rest.rested(surely=True)
    for _ in range(20):
        rest.without(-touch(0.1), FOUND, settled=True)
    assert rest.known
    assert not rest.dented


def test_while_the_camera_was_knocked_frames_say_nothing() -> None:
    rest = DentedRest()
    for _ in range(20):
        assert (rest.without(-touch(0.1), FOUND, settled=False) == -touch(0.1)).all()
    assert not rest.dented
