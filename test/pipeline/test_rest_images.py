"""The rest image: taken on request, from pictures that show something, and kept until a better one is there."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes.errors import ImageError
from tactile_nodes.messages import types
from tactile_nodes.pipeline.frame import Frame
from tactile_nodes.pipeline.rest_images import RestMemory, given, offered
from tactile_nodes.sensing.features import make_encoding
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.rest.in_use import RestInUse
from tactile_nodes.sensing.rest.prepared import Measuring

RNG = np.random.default_rng(5)
PATTERN = np.repeat(np.repeat(RNG.integers(0, 200, (40, 40), dtype=np.uint8), 4, 0), 4, 1)
BLACK = np.zeros_like(PATTERN)


def remembering(frames: int = 2) -> RestMemory:
    flow, encoding = make_flow('dis'), make_encoding('cartesian_mean', {'rows': 10, 'cols': 10})
    return RestMemory(Measuring(flow, encoding), frames, None)


def captured(memory: RestMemory, *images: np.ndarray, skip: int = 0) -> list[RestInUse | None]:
    memory.begin_capture(skip)
    return [offered(memory, Frame(image, types.Header(), number)) for number, image in enumerate(images)]


def test_rest_image_is_the_mean_of_as_many_frames_as_asked() -> None:
    memory = remembering(frames=2)
    first, second = captured(memory, PATTERN, PATTERN + 2)
    assert first is None and second is not None
    assert (second.prepared.image == PATTERN + 1).all()
    assert memory.in_use is second
    assert memory.capture is None


def test_a_capture_begins_anew_with_a_frame_that_shows_something_else() -> None:
    released = np.roll(PATTERN, 1, axis=1)  # as when a touch ends
    *before, last = captured(remembering(frames=2), released, PATTERN, PATTERN)
    assert before == [None, None] and last is not None
    assert (last.prepared.image == PATTERN).all()
    assert not last.unsteady


def test_of_a_picture_that_never_rests_any_frames_are_taken_and_that_is_reported() -> None:
    moving = [np.roll(PATTERN, number % 2, axis=1) for number in range(9)]
    *before, last = captured(remembering(frames=2), *moving)  # four times two frames, and one
    assert before == [None] * 8 and last is not None
    assert last.unsteady


def test_frames_to_skip_are_left_out_whatever_they_show() -> None:
    *before, last = captured(remembering(frames=1), BLACK, BLACK, PATTERN, skip=2)
    assert before == [None, None] and last is not None


def test_black_frames_do_not_go_into_a_rest_image() -> None:
    memory = remembering(frames=2)
    assert captured(memory, PATTERN, BLACK) == [None, None]
    assert 'black' in memory.trouble
    rest = offered(memory, Frame(PATTERN, types.Header(), 3))
    assert rest is not None and (rest.prepared.image == PATTERN).all()
    assert memory.trouble == ''


def test_a_blank_rest_image_is_refused_and_the_one_before_stays() -> None:
    memory = remembering(frames=1)
    kept = given(memory, PATTERN, 0)
    assert captured(memory, np.full_like(PATTERN, 90)) == [None]
    assert 'markers' in memory.trouble
    assert memory.in_use is kept
    assert memory.capture is not None
    with pytest.raises(ImageError, match='markers'):
        given(memory, np.full_like(PATTERN, 90), 1)
    assert memory.in_use is kept
