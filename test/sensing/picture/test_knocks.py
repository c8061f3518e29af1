"""Common motion of patches: a knock, a press, or a gel of another shape."""

from __future__ import annotations

import numpy as np
import pytest
from dots import picture, shift
from measured import Measured

from tactile_nodes.sensing.picture.knocks import NOISE_SIGMAS, Common, judge, noise_allowance_px
from tactile_nodes.sensing.picture.motion import MotionFit
from tactile_nodes.sensing.picture.registration import Registration

S = 1_000_000_000


def moved(common_px: float, off_px: float, share_off: float, noise_px: float = 0.0) -> Common:
    """100 patches that move to the right by so much, of which some are off downwards by so much."""
    carried = np.tile([common_px, 0.0], (100, 1))
    off = np.where(np.arange(100) < 100 * share_off, off_px, 0.0)
    return judge(carried + np.column_stack([np.zeros(100), off]), carried, common_px, noise_px)


@pytest.mark.parametrize(
    ('common_px', 'off_px', 'share_off', 'expected'),
    [
        (0.04, 0.0, 0.0, Common.NONE),
        (0.06, 0.0, 0.0, Common.KNOCK),
        (0.06, 0.2, 0.45, Common.KNOCK),
        (0.06, 0.2, 0.55, Common.NONE),
        (0.3, 0.2, 0.45, Common.KNOCK),
        (0.9, 0.19, 0.9, Common.KNOCK),  # within 0.05 px and a sixth of 0.9 px
        (0.5, 0.2, 0.2, Common.KNOCK),
        (0.5, 0.2, 0.3, Common.MISSHAPEN),
        (3.0, 0.3, 0.3, Common.MISSHAPEN),
        (0.5, 0.7, 0.6, Common.MISSHAPEN),
        (0.5, 0.8, 0.6, Common.NONE),  # a hard contact that moves all of a thick, small gel
    ],
)
def test_what_patches_do_tells_a_knock_from_a_press_and_from_another_shape(
    common_px: float, off_px: float, share_off: float, expected: Common
) -> None:
    assert moved(common_px, off_px, share_off) is expected


def test_what_a_contact_moves_far_away_is_no_knock() -> None:
    """A ball of 5 mm near a corner of `speckle_membrane` moves most patches alike by 0.13 px, and six by 1.5 px.
    In live sensing its force was 12 % too large."""
    assert moved(0.13, 1.5, 0.06) is Common.NONE
    assert moved(0.26, 1.5, 0.06) is Common.KNOCK
    assert moved(0.13, 1.5, 0.04) is Common.KNOCK  # a thin tip


def test_a_hard_drag_is_no_knock_though_most_patches_move_about_alike() -> None:
    """All within 0.06 px of 0.06 px, half of it left over (0.035 / 0.0695): an edge of 14 mm dragged with 2 N does so.
    Of a knock a quarter is left over (0.015 / 0.0618)."""
    assert moved(0.06, 0.035, 1.0) is Common.NONE
    assert moved(0.06, 0.015, 1.0) is Common.KNOCK


def test_what_mostly_bends_the_picture_is_no_knock() -> None:
    carried = np.tile([0.2, 0.0], (100, 1))
    assert [judge(carried, carried, 0.2, bent=each) for each in (0.49, 0.51)] == [Common.KNOCK, Common.NONE]


def test_a_camera_that_tilts_bends_less_than_it_shifts_even_with_a_view_of_a_right_angle() -> None:
    """With lines kept, x moves by 1 + x² and y by x y, for x and y from -1 to 1: means of squares 28/15 and 1/9, of the
    bends alone 1/5 and 1/9."""
    fit = MotionFit((400, 400), 10, 10)
    tilted = np.array([1.0, 0, 0, 0, 0, 0, 1.0, 0])
    assert fit.bent(tilted) == pytest.approx(np.sqrt((1 / 5 + 1 / 9) / (28 / 15 + 1 / 9)), rel=0.03)
    assert fit.bent(np.array([1.0, 1, 1, 1, 0, 0, 0, 0])) == 0.0


def bulging(at: np.ndarray) -> np.ndarray:
    """The rim goes right by 0.15 px and the corners by 0.3 px, smoothly, as far from a contact on a thick gel."""
    moved: np.ndarray = np.column_stack([0.15 * np.square((at - 220) / 220).sum(axis=1), 0 * at[:, 0]])
    return moved


def test_a_smooth_bend_of_the_picture_is_left_to_the_forces() -> None:
    registration = Registration()
    measure = Measured(picture(), registration=registration)
    for number, motions in enumerate([[]] * 4 + [[bulging]]):
        measure(picture(*motions, number=number), (1 + number) * S)
    assert registration.settled
    assert registration.size_px < 0.05


def test_what_noise_may_carry_is_no_knock() -> None:
    """0.0585 px of a patch's noise of 0.013 px: 3 x 0.01 x sqrt(8 / 100) above 0.05 px."""
    assert [moved(each, 0.0, 0.0, noise_px=0.013) for each in (0.0584, 0.0586)] == [Common.NONE, Common.KNOCK]
    assert moved(0.0501, 0.0, 0.0, noise_px=0.003) is Common.KNOCK


def test_the_terms_of_a_motion_follow_noise_by_as_much_as_is_allowed_for() -> None:
    """Root mean square over 200 draws of noise: known to 2 %."""
    fit, random = MotionFit((440, 440), 10, 10), np.random.default_rng(1)
    sizes = [fit.size_px(fit.common(random.normal(0, 0.01, (100, 2)), np.ones(100), rounds=1)) for _ in range(200)]
    allowed_px = noise_allowance_px(0.013, 100) / NOISE_SIGMAS
    assert np.sqrt(np.mean(np.square(sizes))) == pytest.approx(allowed_px, rel=0.1)


def swollen(at: np.ndarray) -> np.ndarray:
    """The picture shrinks by 0.8 px at the rim, and its rows by 0.6 px more or less, in waves of 100 px."""
    waves: np.ndarray = np.column_stack([0.6 * np.sin(at[:, 1] / 16), 0 * at[:, 0]])
    return waves - 0.8 / 220 * (at - 220)


@pytest.mark.parametrize('knocked_px', [0.0, 1.3])
def test_a_gel_of_another_shape_is_lost_at_once_and_found_at_once_when_it_is_as_it_was(knocked_px: float) -> None:
    registration = Registration()
    measure = Measured(picture(), registration=registration)
    lost = []
    for number, motions in enumerate(
        [[shift(knocked_px, 0.0)]] * 6 + [[swollen, shift(knocked_px, 0.0)]] * 3 + [[]] * 6
    ):
        measure(picture(*motions, number=number), (1 + number) * S)
        lost.append(registration.lost)
    assert lost == [False] * 6 + [True] * 3 + [False] * 6
    assert registration.settled
    assert registration.surely
