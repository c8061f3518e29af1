"""A knocked camera is no motion, a press is, and what cannot be decided is reported."""

from __future__ import annotations

import copy
import functools

import numpy as np
import pytest
from dots import picture, press, shift, turn
from hypothesis import given, settings
from hypothesis import strategies as st
from measured import Measured

from tactile_nodes.sensing.picture.registration import Registration, RegistrationOptions

REST = picture()
S = 1_000_000_000


def following(method: str = 'inverse_compositional') -> tuple[Measured, Registration]:
    if method == 'dis':  # it holds an object of OpenCV, which cannot be copied
        return begun(method)
    return copy.deepcopy(begun_by_patches())


def begun(method: str) -> tuple[Measured, Registration]:
    registration = Registration()
    return Measured(REST, method, registration=registration), registration


@functools.cache
def begun_by_patches() -> tuple[Measured, Registration]:
    return begun('inverse_compositional')


@given(st.floats(-2.1, 2.1), st.floats(-2.1, 2.1), st.floats(-1, 1))
@settings(max_examples=6, deadline=None)
def test_any_shift_to_3_px_with_any_turn_to_1_degree_is_found_in_the_first_frame(
    right_px: float, down_px: float, degrees: float
) -> None:
    measure, registration = following()
    measure(picture(turn(degrees), shift(right_px, down_px), number=1), S)
    if np.hypot(right_px, down_px) + abs(degrees) < 0.1:
        return
    assert registration.motion.shift_px == pytest.approx((right_px, down_px), abs=0.05)
    assert np.rad2deg(registration.motion.turn_rad((440, 440))) == pytest.approx(degrees, abs=0.02)


@pytest.mark.parametrize(('method', 'off_px'), [('dis', 0.06), ('inverse_compositional', 0.01)])
def test_a_press_reads_the_same_after_a_knock(method: str, off_px: float) -> None:
    """To within what the methods' own bias under motion of pixels leaves (docs/method.md: 0.046 and 0.006 px)."""
    pressing = press(180, 250, 0.6)
    plain, _ = following(method)
    alone = plain(picture(pressing, number=1), S).features.values
    measure, registration = following(method)
    for number in range(10):
        measure(picture(shift(2.3, -1.4), number=number), (1 + number) * S)
    knocked = measure(picture(pressing, shift(2.3, -1.4), number=1), 12 * S).features.values
    assert registration.settled
    assert np.sqrt(np.square(knocked - alone)[1:-1, 1:-1].mean()) < off_px  # of 0.6


def test_a_press_is_never_taken_for_a_knock() -> None:
    measure, registration = following()
    for number, most_px in enumerate((0.1, 0.5, 2.0, 4.0)):
        measure(picture(press(200, 230, most_px), number=number), number * S)
    assert registration.size_px == 0.0
    assert registration.settled


def test_a_knock_while_something_presses_is_taken_out_and_stays_in_doubt_until_nothing_does() -> None:
    measure, registration = following()
    measure(picture(press(200, 230, 0.8), shift(1.2, 0.5)), S)
    assert registration.motion.shift_px == pytest.approx((1.2, 0.5), abs=0.1)
    assert not registration.settled
    for number in range(4):
        measure(picture(shift(1.2, 0.5), number=number), (2 + number) * S)
    assert registration.settled
    assert registration.motion.shift_px == pytest.approx((1.2, 0.5), abs=0.05)


def test_a_knock_is_taken_out_where_a_quarter_of_the_picture_shows_a_pattern() -> None:
    """As of a gel beside a wide mask; the other regions cannot be measured."""
    rest = np.where(np.arange(440) < 365, np.uint8(80), REST)
    registration = Registration()
    measure = Measured(rest, 'inverse_compositional', registration=registration)
    frame = measure(np.roll(rest, (-1, 2), axis=(0, 1)), S)
    assert registration.motion.shift_px == pytest.approx((2.0, -1.0), abs=0.05)
    assert frame.motion is not None
    assert frame.motion.displacement_px[:, -2:] == pytest.approx(np.zeros((10, 2, 2)), abs=0.05)


def test_a_camera_that_is_knocked_back_is_measured_as_if_it_had_stayed() -> None:
    measure, registration = following()
    measure(picture(shift(0.09, 0.0), number=1), S)
    assert registration.straightening is not None
    back = picture(number=2)
    for number in range(3):
        measure(back, (2 + number) * S)
    assert registration.straightened(back) is back


def test_a_picture_that_moved_too_far_or_is_another_is_lost_and_found_again() -> None:
    measure, registration = following()
    registration.options = RegistrationOptions(most_px=2.0)
    measure(picture(shift(3.0, 0.0)), S)
    assert registration.lost
    measure(REST[::-1].copy(), 2 * S)
    assert registration.lost
    measure(picture(number=2), 3 * S)
    assert not registration.lost


def test_slow_motion_is_followed_while_nothing_touches_and_kept_while_something_does() -> None:
    measure, registration = following()
    for number in range(20):
        measure(picture(shift(0.03, 0.0), number=number), number * S)
    assert registration.motion.shift_px[0] == pytest.approx(0.03, abs=0.005)
    kept = registration.motion
    for number in range(5):
        measure(picture(press(200, 230, 0.5), shift(0.03, 0.0), number=number), (50 + number) * S)
    assert registration.motion == kept
