"""Which frames become a rest image: a run of the untouched gel, and never one that shows a touch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.sensing.geometry import centre_crop
from tactile_nodes.sensing.rest.capture import RestCapture
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Optics, Press


class Pictures:
    """Frames of the simulated gel, each with noise of its own."""

    def __init__(self, noise: float = 1.0) -> None:
        gel = Gel()
        noisy = replace(
            gel, read_noise_grey=noise * gel.read_noise_grey, shot_noise_grey=noise**2 * gel.shot_noise_grey
        )
        self._optics, self._seed = Optics(noisy, contact_table(gel)), 0

    def of(self, *presses: Press) -> np.ndarray:
        self._seed += 1
        return centre_crop(self._optics.render(presses, self._seed), 440, 440)


@pytest.fixture(scope='module')
def pictures() -> Pictures:
    return Pictures()


def offered(capture: RestCapture, frames: list[np.ndarray]) -> list[bool]:
    return [capture.offer(frame) is not None for frame in frames]


def test_a_held_press_after_too_few_frames_of_the_untouched_gel_is_no_rest_image(pictures: Pictures) -> None:
    capture = RestCapture(wanted=8)
    assert not any(offered(capture, [pictures.of() for _ in range(6)]))
    assert not any(offered(capture, [pictures.of(Press(3.0, -4.0, 0.5)) for _ in range(12)]))
    assert '8 frames in a row of the untouched gel, but only 6 came; something touches the gel' in capture.waiting
    assert offered(capture, [pictures.of() for _ in range(8)]).count(True) == 1
    assert not capture.unsteady


def test_a_picture_of_something_else_in_between_makes_no_press_a_rest_image(pictures: Pictures) -> None:
    """As of a hand before the camera, or of a press too hard to be measured: the gel seen before it still counts."""
    capture = RestCapture(wanted=8)
    hand, moved = (np.roll(pictures.of(), by, axis=(0, 1)) for by in (100, 150))
    assert not any(offered(capture, [pictures.of() for _ in range(6)] + [hand] * 5 + [moved]))
    assert not any(offered(capture, [pictures.of(Press(3.0, -4.0, 0.5)) for _ in range(12)]))
    assert 'something touches the gel now but did not before' in capture.waiting
    assert offered(capture, [pictures.of() for _ in range(8)])[-1]


def test_no_patience_makes_presses_a_rest_image(pictures: Pictures) -> None:
    presses = [pictures.of(Press(number % 7 - 3.0, number % 5 - 2.0, 0.4)) for number in range(25)]
    capture = RestCapture(wanted=5)
    assert not any(offered(capture, [pictures.of() for _ in range(4)] + presses))
    assert not capture.unsteady


@pytest.mark.parametrize('force', ['elsewhere', 'fading'])
def test_a_gel_that_is_never_left_alone_gives_no_rest_image_and_why_is_said(pictures: Pictures, force: str) -> None:
    """Of a camera that never rests twenty frames would do; then the untouched gel is taken at once."""
    press = {
        'elsewhere': lambda number: Press(number % 7 - 3.0, number % 5 - 2.0, 0.4),
        'fading': lambda number: Press(3.0, -4.0, 1.0 - 0.02 * number),
    }[force]
    capture = RestCapture(wanted=5)
    assert not any(offered(capture, [pictures.of(press(number)) for number in range(25)]))
    assert 'something touches the gel in some frames but not in others' in capture.waiting
    assert offered(capture, [pictures.of() for _ in range(5)])[-1]
    assert not capture.unsteady


@pytest.mark.parametrize('noise', [2.0, 4.0])
def test_a_noisy_camera_is_no_picture_that_never_rests(noise: float) -> None:
    noisy = Pictures(noise)
    capture = RestCapture(wanted=16)
    assert offered(capture, [noisy.of() for _ in range(16)])[-1]
    assert not capture.unsteady


def test_a_touch_that_ends_leaves_the_untouched_gel_to_be_taken(pictures: Pictures) -> None:
    capture = RestCapture(wanted=8)
    assert not any(offered(capture, [pictures.of(Press(0.0, 2.0, 0.8)) for _ in range(6)]))
    assert offered(capture, [pictures.of() for _ in range(8)])[-1]


def test_a_camera_that_moved_meanwhile_is_no_touch(pictures: Pictures) -> None:
    capture = RestCapture(wanted=8)
    moved = [np.roll(pictures.of(), 2, axis=1) for _ in range(8)]
    assert not any(offered(capture, [pictures.of() for _ in range(6)]))
    assert offered(capture, moved)[-1]


def test_a_capture_begins_anew_with_pictures_of_another_size(pictures: Pictures) -> None:
    """As when the camera or its crop is set while a capture waits for a touch to end."""
    capture = RestCapture(wanted=5)
    assert not any(offered(capture, [pictures.of() for _ in range(4)] + [pictures.of(Press(3.0, -4.0, 0.5))] * 3))
    assert offered(capture, [pictures.of()[20:-20, 20:-20] for _ in range(5)]).index(True) == 4


def test_nothing_is_said_while_the_frames_may_still_suffice(pictures: Pictures) -> None:
    capture = RestCapture(wanted=8)
    for _ in range(7):
        capture.offer(pictures.of())
        assert capture.waiting == ''
