"""A rest image that was pressed shows in the first frames beside it: motion towards the place."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes.sensing.picture.dented_rest import LASTING_FRAMES, LEAST_FRAMES, PROVEN_FRAMES, DentedRest
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
    assert not fed(touch(most_px), 40, seed).dented


def test_a_press_beside_the_dent_says_nothing_until_it_ends() -> None:
    rest, random = DentedRest(), np.random.default_rng(1)
    for pressed in [True] * 10 + [False] * LEAST_FRAMES:
        assert not rest.dented
        motion = touch(0.3, 7.0, 2.0) * pressed - touch(0.02)
        rest.without(motion + random.normal(0, NOISE_PX, motion.shape), FOUND, settled=True)
    assert rest.dented


def proven() -> DentedRest:
    """With frames at rest beside it, as of a gel that nothing touches, and of one on which something is held still."""
    rest = DentedRest()
    for _ in range(PROVEN_FRAMES):
        rest.rested(surely=True)
    return rest


def feed(rest: DentedRest, motion: np.ndarray, frames: int, seed: int = 2) -> np.ndarray:
    random, left = np.random.default_rng(seed), motion
    for _ in range(frames):
        left = rest.without(motion + random.normal(0, NOISE_PX, motion.shape), FOUND, settled=True)
    return left


def test_what_was_held_still_since_the_rest_image_shows_once_it_has_been_gone_for_some_frames() -> None:
    rest = proven()
    feed(rest, -touch(0.05), LASTING_FRAMES - 1)
    assert not rest.dented
    feed(rest, -touch(0.05), 1)
    assert rest.dented


@pytest.mark.parametrize('after', ['at rest', 'a press'])
def test_a_gel_that_is_pulled_for_a_moment_by_what_leaves_it_has_no_dent(after: str) -> None:
    rest = proven()
    for _ in range(4):
        feed(rest, -touch(0.05), LASTING_FRAMES - 1)
        if after == 'at rest':
            rest.rested(surely=True)
        else:
            feed(rest, touch(0.5), 1)
    assert not rest.dented


def test_a_touch_that_lets_go_slowly_is_taken_out_as_far_as_it_has_gone() -> None:
    rest = DentedRest()
    for share in np.linspace(0.1, 1, 20):
        feed(rest, -touch(share * 0.2), 1, seed=round(100 * share))
    assert rest.dented
    assert np.abs(feed(rest, -touch(0.2), 8)).max() < 5 * NOISE_PX


def test_a_press_beside_a_known_dent_is_a_press_and_never_becomes_part_of_it() -> None:
    rest = DentedRest()
    feed(rest, -touch(0.2), 8)
    left = feed(rest, touch(0.08, 7.0, 2.0) - touch(0.2), 40)
    assert np.abs(left - touch(0.08, 7.0, 2.0)).max() < 5 * NOISE_PX


def test_where_nothing_moved_beside_the_rest_image_it_has_no_dent_whatever_was_thought() -> None:
    rest = DentedRest()
    feed(rest, -touch(0.05), LEAST_FRAMES)
    assert rest.dented
    feed(rest, 0 * touch(0.05), 1)
    assert not rest.dented


def test_while_the_camera_was_knocked_frames_say_nothing() -> None:
    rest = DentedRest()
    for _ in range(20):
        assert (rest.without(-touch(0.1), FOUND, settled=False) == -touch(0.1)).all()
    assert not rest.dented
