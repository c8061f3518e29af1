"""What is remembered between frames is one value: saved anywhere, it goes on as if nothing had happened."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from dots import picture, press, shift, turn

from tactile_nodes import conversions
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.messages import types
from tactile_nodes.pipeline.following import Following, FollowingParams

S = 1_000_000_000
TOUCH, KNOCK = press(200, 230, 0.8), (shift(1.3, -0.6), turn(0.5))
DEAD = np.random.default_rng(6).random((440, 440)) < 0.002
PARAMS = FollowingParams(reference_frames=6)


@functools.cache
def frame(number: int) -> np.ndarray:
    """Captured, pressed, knocked, pressed again, with dead pixels, and in another light until the rest image is new."""
    motions = [*KNOCK] if number >= 16 else []
    motions += [TOUCH] if number % 16 in (10, 11, 12) else []
    image = picture(*motions, number=number, light=0.7 if number >= 44 else 1.0)
    if 26 <= number < 44:
        image[DEAD] = 255
    return image


def answered(following: Following, numbers: range) -> list[types.FlowFeatures]:
    heads = [conversions.header(S + number * S // 30, 'camera') for number in numbers]
    return [
        following.answer(frame(number), head, acquire_s=0.0) for number, head in zip(numbers, heads, strict=True)
    ]  # fmt: skip


def compared(messages: list[types.FlowFeatures]) -> list[tuple[object, ...]]:
    return [
        (each.values.tobytes(), each.reasons, each.moved, each.picture_motion.tobytes(), each.reference_id)
        for each in messages
    ]


FRAMES, SAVED_AT = 70, (3, 11, 20, 36, 50)


@pytest.fixture(scope='module')
def undisturbed() -> tuple[list[tuple[object, ...]], dict[int, bytes]]:
    """What is published of all frames, and what is remembered before some of them."""
    following, found, saved = Following(PARAMS), list[types.FlowFeatures](), dict[int, bytes]()
    following.begin_capture()
    for number in range(FRAMES):
        if number in SAVED_AT:
            saved[number] = following.memory.saved()
        found += answered(following, range(number, number + 1))
    assert len({each.reference_id for each in found}) > 2  # none, captured, renewed in the other light
    return compared(found), saved


@pytest.mark.parametrize('at', SAVED_AT)
def test_what_was_saved_at_any_frame_goes_on_bit_for_bit(
    at: int, undisturbed: tuple[list[tuple[object, ...]], dict[int, bytes]]
) -> None:
    """Up to the next, where the same is remembered."""
    found, saved = undisturbed
    again, then = Following(PARAMS), min((each for each in saved if each > at), default=FRAMES)
    again.memory.recall(saved[at])
    assert compared(answered(again, range(at, then))) == found[at:then]
    assert then == FRAMES or again.memory.saved() == saved[then]


@pytest.mark.parametrize('begin', [0, 6], ids=['captured with them', 'later'])
def test_dead_pixels_that_are_filled_in_are_remembered(begin: int) -> None:
    """A flow features node saves what it remembers once a camera's dead pixels were learned."""

    def frames(numbers: range) -> list[types.FlowFeatures]:
        found = []
        for number in numbers:
            image = picture(*([TOUCH] if number >= 24 else []), number=number)
            image[DEAD & (number >= begin)] = 255
            found.append(following.answer(image, conversions.header(S + number * S // 30, 'camera'), acquire_s=0.0))
        return found

    following = Following(PARAMS)
    following.begin_capture()
    frames(range(22))
    assert following.memory.rest.dead.count > 0.9 * DEAD.sum()
    saved = following.memory.saved()
    undisturbed = compared(frames(range(22, 30)))
    following = Following(PARAMS)
    following.memory.recall(saved)
    assert compared(frames(range(22, 30))) == undisturbed


def test_memories_of_the_same_frames_are_the_same_bytes_and_of_others_are_not() -> None:
    saved = []
    for frames in (10, 10, 11):
        following = Following(PARAMS)
        following.begin_capture()
        answered(following, range(frames))
        saved.append(following.memory.saved())
    assert saved[0] == saved[1] != saved[2]


@pytest.mark.parametrize('data', [b'', b'no file', bytes(64)])
def test_what_was_never_saved_is_refused_and_changes_nothing(data: bytes) -> None:
    following = Following(PARAMS)
    with pytest.raises(ConfigurationError, match='the saved state cannot be used'):
        following.memory.recall(data)
    assert following.reference is None


def test_what_another_measurement_remembers_is_refused() -> None:
    saved = Following(PARAMS).memory.saved()
    with pytest.raises(ConfigurationError, match='rows'):
        Following(FollowingParams(model='portable')).memory.recall(saved)
