"""The motion of a whole picture: what its numbers mean, and that they are found among patches that go elsewhere."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_nodes.sensing.picture.motion import MotionFit, PictureMotion, Shift, Straightening

SHAPE = (440, 440)
FIT = MotionFit(SHAPE, 10, 10)
NUMBERS = st.floats(-4, 4)


def waves(right: np.ndarray, down: np.ndarray) -> np.ndarray:
    return np.rint(128 + 60 * np.sin(right / 4) * np.cos(down / 5)).astype(np.uint8)


def test_turn_and_growth_move_the_rim_as_by_hand() -> None:
    # A turn of 0.01 rad and a growth of 0.02 move the middle of the right edge, 220 px away, 2.2 px down and 4.4 right.
    motion = PictureMotion((0.0, 0.0, 4.4, 2.2, 0.0, 0.0, 0.0, 0.0))
    assert motion.turn_rad(SHAPE) == pytest.approx(0.01)
    assert motion.growth(SHAPE) == pytest.approx(0.02)
    field = motion.field_px(SHAPE, 1, 440)
    assert field[0, -1] == pytest.approx([4.4 * 219.5 / 220, 2.2 * 219.5 / 220], abs=1e-4)


def test_a_lens_that_keeps_lines_straight_tilts_by_one_and_the_square_of_the_distance() -> None:
    # x' = f tan(t + d): d x = f d (1 + x²/f²). With f = 220 px and f d = 1 px the middle moves by 1, the edge by 2 px.
    motion = PictureMotion((1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0))
    field = motion.field_px(SHAPE, 1, 441)[0]
    assert field[220] == pytest.approx([1.0, 0.0], abs=1e-6)
    assert field[-1] == pytest.approx([2.0, 0.0], abs=0.01)


@given(st.lists(NUMBERS, min_size=8, max_size=8), st.integers(0, 1000))
@settings(max_examples=20, deadline=None)
def test_the_common_motion_is_found_whatever_a_fifth_of_the_patches_does(terms: list[float], seed: int) -> None:
    rng = np.random.default_rng(seed)
    motion = FIT.carried(np.array(terms)) + rng.normal(0, 0.003, (100, 2))
    row, col = rng.integers(0, 7, 2)
    touched = np.zeros((10, 10), bool)
    touched[row : row + 4, col : col + 4] = True
    motion[touched.reshape(-1)] += rng.uniform(0.2, 2.0, (16, 2))
    found = FIT.common(motion, np.ones(100))
    assert FIT.size_px(found - np.array(terms)) < 0.03


def test_a_straightened_image_is_the_one_before_the_motion() -> None:
    x, y = np.meshgrid(np.arange(440.0), np.arange(440.0))
    motion = PictureMotion((1.3, -0.7, 0.5, 2.0, 0.0, 0.0, 0.0, 0.0))
    rest = waves(x, y)
    # Where content went by d(p), the image shows at p + d(p) what was at p; d varies by 1 % over a pixel here.
    field = motion.field_px(SHAPE, *SHAPE)
    for _ in range(3):
        back = field
        x0, y0 = x - back[..., 0], y - back[..., 1]
    moved = waves(x0, y0)
    straight = Straightening(motion, SHAPE)(moved, rest)
    off = straight[20:-20, 20:-20].astype(float) - rest[20:-20, 20:-20]
    assert np.sqrt(np.square(off).mean()) < 1.5


def test_a_shift_by_parts_of_a_pixel_is_undone_to_the_rounding_of_grey_levels() -> None:
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float32)
    straight = Shift(1.3, -0.6)(waves(x - 1.3, y + 0.6), waves(x, y))
    off = straight[8:-8, 8:-8].astype(float) - waves(x, y)[8:-8, 8:-8]
    assert np.sqrt(np.square(off).mean()) < 0.6  # two roundings make 0.41


def test_a_whole_shift_is_undone_to_the_bit_and_borders_come_from_the_rest_image() -> None:
    rest = np.random.default_rng(1).integers(0, 255, (40, 50), dtype=np.uint8)
    moved = np.roll(rest, (2, -3), axis=(0, 1))
    straight = Shift(-3.0, 2.0)(moved, rest)
    assert (straight == rest).all()


@pytest.mark.parametrize('part', [0.12, 0.35, 0.5])
@pytest.mark.parametrize('way', [Shift, Straightening])
def test_an_undone_motion_leaves_fine_patterns_as_strong_as_they_were(way: type, part: float) -> None:
    """Waves of 3.5 and of 2.6 pixels; of the latter Lanczos' kernel of eight alone leaves less."""
    across = np.arange(160)
    for length_px, near in ((3.5, 0.01), (2.6, 0.04)):
        waves = 128 + 90 * np.sin(2 * np.pi / length_px * (across - part))
        knocked = np.tile(np.rint(waves).astype(np.uint8), (160, 1))
        motion = PictureMotion((part, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        undo = Shift(part, 0.0) if way is Shift else Straightening(motion, knocked.shape)
        row = undo(knocked, knocked)[80, 20:140].astype(float)
        phase = 2 * np.pi / length_px * across[20:140]
        known = np.stack([np.sin(phase), np.cos(phase), np.ones(120)], axis=1)
        strength = float(np.linalg.lstsq(known, row, rcond=None)[0][0]) / 90
        assert strength == pytest.approx(1.0, abs=near), (length_px, strength)
