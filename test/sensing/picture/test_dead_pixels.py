"""Pixels that show one grey whatever falls in are found at rest and filled in; nothing else is taken for them."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from dots import SIDE, grow, picture, press, shift
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_nodes.sensing.picture.dead_pixels import ALIVE_GREY, CHECK_EVERY, SEEN, DeadPixels, Filling, covariance
from tactile_nodes.sensing.picture.stillness import StillnessCheck, steady
from tactile_nodes.sensing.rest.reference import average
from tactile_nodes.simulation.camera import through_jpeg

REST = average([picture(number=number) for number in range(8)])
DEAD = np.random.default_rng(5).random((SIDE, SIDE)) < 0.002
CHECK = StillnessCheck()
CHECK.set_reference(REST)


def still(image: np.ndarray) -> bool:
    seen = CHECK.look(image)
    return steady(seen) and not seen.unexplained


def with_dead(image: np.ndarray, grey: int = 255) -> np.ndarray:
    return np.where(DEAD, grey, image).astype(np.uint8)


def looked(*images: np.ndarray) -> DeadPixels:
    dead = DeadPixels()
    dead.beside(REST)
    for image in images:
        dead.look(dead.mended(image), still)
    return dead


def test_a_pixel_of_an_even_picture_is_filled_in_with_its_grey() -> None:
    even = np.full((20, 20), 50, np.uint8)
    one = np.zeros((20, 20), bool)
    one[7, 9] = one[0, 0] = True
    np.testing.assert_array_equal(Filling(even, one)(np.where(one, 255, even).astype(np.uint8)), even)


def test_where_pixels_go_their_own_way_one_is_filled_in_with_the_mean() -> None:
    """What is around says nothing of a pixel then; weights are those of chance, 1 / sqrt(40000) each."""
    noise = np.random.default_rng(1).integers(60, 141, (200, 200)).astype(np.uint8)
    one = np.zeros(noise.shape, bool)
    one[50, 60] = True
    assert float(Filling(noise, one)(noise)[50, 60]) == pytest.approx(100, abs=3)


def test_pixels_in_a_row_go_together_as_their_covariance_says() -> None:
    """Columns of 0 and 100 in turn, half of each: covariance 2500 two columns away, -2500 one away."""
    columns = np.tile(np.array([0, 100], np.uint8), (40, 20))
    measured = covariance(columns)
    np.testing.assert_allclose(measured[4, [2, 3, 5, 6]], [2500, -2500, -2500, 2500], rtol=0.03)


@pytest.mark.parametrize('grey', [0, 140, 255])
def test_dead_pixels_are_found_in_three_frames_and_filled_in(grey: int) -> None:
    dead = looked(*(with_dead(picture(number=number), grey) for number in range(SEEN)))
    far = np.abs(REST.astype(int) - grey) > 16
    assert dead.count >= np.count_nonzero(DEAD & far)
    plain = picture(press(200, 240, 3.0), number=3)
    off = dead.mended(with_dead(plain, grey)).astype(float) - plain
    assert float(np.sqrt(np.square(off[DEAD]).mean())) < 0.2 * plain.std()
    assert not off[~DEAD].any()


def blurred(image: np.ndarray, blur_px: float) -> np.ndarray:
    return cv2.GaussianBlur(image, (0, 0), blur_px)


@pytest.mark.parametrize(
    ('change', 'by'),
    [*((blurred, blur_px) for blur_px in (0.2, 0.3, 0.5, 0.8)), *((through_jpeg, quality) for quality in (90, 60, 30))],
)
def test_what_a_lens_out_of_focus_dims_and_what_jpeg_adds_are_no_dead_pixels(
    change: Callable[..., np.ndarray], by: float
) -> None:
    assert looked(*(change(picture(number=number), by) for number in range(SEEN))).count == 0


def test_touches_between_the_frames_do_not_hinder() -> None:
    frames = [with_dead(picture(number=number)) for number in range(SEEN)]
    touched = with_dead(picture(press(200, 240, 3.0), number=4))
    assert looked(frames[0], touched, frames[1], touched, frames[2]).count == looked(*frames).count > 0


def test_two_frames_do_not_tell() -> None:
    assert looked(*(with_dead(picture(number=number)) for number in range(SEEN - 1))).count == 0


@settings(max_examples=12, deadline=None)
@given(
    st.sampled_from([press(150, 300, 8.0), press(150, 300, 0.2), shift(0.5, -3.0), shift(0, 0.2), grow(0.01), None]),
    st.floats(0.3, 1.6), st.floats(0, 0.6), st.floats(0, 200), st.integers(0, 12), st.floats(0.1, 1.5),
)  # fmt: skip
def test_nothing_else_is_taken_for_dead_pixels(
    motion, light: float, gone: float, spot: float, dirt_px: int, blur_px: float
) -> None:
    """Presses, knocks, another light, dots that are gone, a hot spot, a speck of dirt and a lens out of focus."""
    motions = () if motion is None else (motion,)
    y, x = np.mgrid[:SIDE, :SIDE]
    apart = (x - 150) ** 2 + (y - 280) ** 2
    frames = [picture(*motions, number=number, light=light, gone=gone).astype(float) for number in range(SEEN)]
    seen = [each + spot * np.exp(-0.5 * apart / 40**2) for each in frames]
    dirty = [np.where(apart < dirt_px**2, each / 10, each) for each in seen]
    soft = [cv2.GaussianBlur(each, (0, 0), blur_px) for each in dirty]
    dead = looked(*(np.clip(np.rint(each), 0, 255).astype(np.uint8) for each in soft))
    # Of dots that are gone or dim here and there single pixels may differ; filling those in changes nothing to see.
    assert dead.count < 1e-4 * SIDE * SIDE


def test_a_picture_without_dead_pixels_is_left_as_it_is_to_the_bit() -> None:
    dead = looked(*(picture(number=number) for number in range(SEEN + 1)))
    image = picture(press(200, 240, 3.0))
    assert dead.mended(image) is image


def test_pixels_that_are_alive_again_are_left_alone() -> None:
    dead = looked(*(with_dead(picture(number=number)) for number in range(SEEN)))
    for number in range(CHECK_EVERY):
        dead.mended(picture(number=number))
    plain = picture()
    assert dead.count == np.count_nonzero(DEAD & (plain > 255 - ALIVE_GREY))


@pytest.mark.parametrize(('grey', 'found'), [(0, 1.0), (255, 0.9)])
def test_pixels_that_are_dead_from_the_first_frame_on_are_found_in_the_rest_image(grey: int, found: float) -> None:
    dead = DeadPixels()
    rest = dead.captured(with_dead(REST, grey))
    assert dead.count >= found * np.count_nonzero(DEAD)
    assert float(np.sqrt(np.square(rest.astype(float) - REST)[DEAD].mean())) < 0.3 * REST.std()


def test_a_renewed_rest_image_shows_more_dead_pixels_and_forgets_none() -> None:
    dead = looked(*(with_dead(picture(number=number)) for number in range(SEEN)))
    before, dimmed = dead.count, with_dead((0.7 * REST).astype(np.uint8))
    dimmed[100, 100] = dimmed[300, 200] = 255
    rest = dead.renewed(dead.mended(dimmed))
    assert dead.count == before + 2
    assert max(rest[100, 100], rest[300, 200]) < 150


@pytest.mark.parametrize(('light', 'offset'), [(1.0, 0), (2.5, 0), (1.0, -30)])
def test_a_rest_image_with_bright_dots_or_a_black_ground_is_left_as_it_is(light: float, offset: int) -> None:
    """Dots at 255 light up the pixels beside them; a black ground is no single pixel."""
    image = np.clip(light * REST.astype(float) + offset, 0, 255).astype(np.uint8)
    dead = DeadPixels()
    assert dead.captured(image) is image
