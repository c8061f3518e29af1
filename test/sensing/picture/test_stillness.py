"""Is anything touching? A look at one frame, which must never overlook a touch nor hide a disturbance."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import cv2
import numpy as np
import pytest

from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.errors import ConfigurationError, ImageError
from tactile_nodes.sensing.flow.patches import moved_image
from tactile_nodes.sensing.geometry import centre_crop
from tactile_nodes.sensing.picture.stillness import Stillness, StillnessCheck, StillnessOptions
from tactile_nodes.sensing.rest.reference import average
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Optics, Press

RANDOM = np.random.default_rng(3)
PATTERN = cv2.GaussianBlur(RANDOM.uniform(0, 255, (240, 240)).astype(np.float32), (0, 0), 1.5) * 2 - 155
"""Grey levels of about 100, give or take 28: no noise is cut off at black or white."""
NOISE_GREY = 2.0


def frame(light: np.ndarray = PATTERN, seed: int = 0, noise_grey: float = NOISE_GREY) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0, noise_grey, light.shape)
    picture: np.ndarray = np.clip(np.round(light + noise), 0, 255).astype(np.uint8)
    return picture


def check(**options: float) -> StillnessCheck:
    made = StillnessCheck(StillnessOptions(**{'full_every': 1000, 'limit': 6.0, **options}))  # type: ignore[arg-type]
    made.set_reference(rest())
    return made


@cache
def rest() -> np.ndarray:
    return average([frame(seed=seed) for seed in range(100, 116)])


def test_noise_is_still_and_its_size_is_reported() -> None:
    looked = [check().look(frame(seed=seed)) for seed in range(5)]
    # A variance of 4, a sixteenth more for the mean of 16 frames at rest, and what rounding adds: a twelfth to a pixel,
    # and at half size a twelfth to each of the two images, which count for four pixels: 4.25 + 0.09 + 0.67.
    assert [each.noise_grey for each in looked] == pytest.approx([5.0**0.5] * 5, rel=0.03)
    assert all(each.within(StillnessOptions(limit=6.0)) for each in looked)


def test_noise_moves_as_much_as_noise_makes_whatever_its_size() -> None:
    made, twice = check(), check(most_noise_grey=5.0)
    single = np.mean([made.look(frame(seed=seed)).motion for seed in range(10)])
    double = np.mean([twice.look(frame(seed=seed, noise_grey=4.0)).motion for seed in range(10)])
    # The largest of some hundred independent numbers, either way, is about 2.8.
    assert 2.0 < single < 4.0
    assert double == pytest.approx(single, rel=0.15)


def speckled(light: np.ndarray, wide_px: int) -> np.ndarray:
    """With a speck of dirt, which leaves a fifth of the light."""
    dirty = light.copy()
    dirty[100 : 100 + wide_px, 100 : 100 + wide_px] *= 0.2
    return dirty


@pytest.mark.parametrize(
    ('name', 'change'),
    [
        ('a shift of a twentieth of a pixel', lambda light: moved_image(light, 0.05, 0.0)),
        ('the light 10 % darker', lambda light: 0.9 * light),
        ('blur', lambda light: cv2.GaussianBlur(light, (0, 0), 1.0)),
        ('another picture', lambda light: light[::-1]),
        ('no picture', np.zeros_like),
        ('a speck of dirt', lambda light: speckled(light, 12)),
    ],
)
def test_disturbances_are_not_still(name: str, change: Callable[[np.ndarray], np.ndarray]) -> None:
    made = check()
    assert not any(made(frame(change(PATTERN), seed)) for seed in range(5)), name


def test_light_is_reported_as_a_share() -> None:
    assert check().look(frame(0.9 * PATTERN)).light_share == pytest.approx(0.1, abs=0.01)


def test_light_that_flickers_a_little_is_still() -> None:
    made = check()
    assert all(made(frame(gain * PATTERN, seed)) for seed, gain in enumerate((0.98, 0.99, 1.01, 1.02)))


def test_more_noise_than_allowed_is_never_still() -> None:
    made = check(most_noise_grey=1.5)
    assert not any(made(frame(seed=seed)) for seed in range(5))


def test_one_in_so_many_still_frames_is_measured_all_the_same() -> None:
    made = check(full_every=2)
    still = sum(made(frame(seed=seed)) for seed in range(200))
    assert 60 < still < 140  # a coin thrown 200 times is outside of this once in 10^8
    assert not any(check(full_every=1)(frame(seed=seed)) for seed in range(5))


def test_the_answer_depends_on_the_two_images_alone() -> None:
    used, frames = check(full_every=2), [frame(seed=seed) for seed in range(10)]
    used(frame(moved_image(PATTERN, 3.0, 0.0)))
    assert [used(each) for each in frames] == [check(full_every=2)(each) for each in frames]


def test_no_touch_of_20_mn_is_called_still() -> None:
    optics = Optics(Gel(), contact_table(Gel()))

    def seen(presses: tuple[Press, ...], seed: int) -> np.ndarray:
        return centre_crop(optics.render(presses, seed), 440, 440)

    made = StillnessCheck()
    made.set_reference(average([seen((), seed) for seed in range(16)]))
    depth_mm = 0.1237  # where the default gel's contact table passes 20 mN
    assert contact_table(Gel()).force_at(depth_mm) == pytest.approx(0.02, rel=0.01)
    places = np.random.default_rng(8).uniform(-14, 14, (40, 2)).tolist()
    assert not any(made(seen((Press(x, y, depth_mm),), 100 + i)) for i, (x, y) in enumerate(places))
    untouched = sum(made(seen((), 500 + i)) for i in range(60))
    assert untouched > 30  # of the 60, one in 32 is measured all the same, and noise passes the limit in one of five


def test_images_too_small_for_blocks_are_never_still() -> None:
    made = StillnessCheck()
    small = frame()[:100, :100].copy()
    made.set_reference(small)
    assert not made(small)


def test_an_image_of_another_size_is_refused() -> None:
    with pytest.raises(ImageError, match='120x120'):
        check()(frame()[:120, :120].copy())


def test_impossible_options_are_one_sentence() -> None:
    with pytest.raises(ConfigurationError, match='limits above 0'):
        StillnessCheck(StillnessOptions(limit=0.0))


def test_a_touch_leaves_unevenness_with_its_motion_and_dirt_leaves_it_without() -> None:
    # On the simulated gel 0.4 N move by 620 times what noise makes and leave 95; a speck of dirt moves 12, leaves 570.
    assert not Stillness(motion=620.0, noise_grey=2.1, light_share=0.07, unevenness=95.0).unexplained
    assert Stillness(motion=12.0, noise_grey=2.1, light_share=0.5, unevenness=570.0).unexplained


def test_a_speck_of_dirt_is_unexplained_and_no_motion_of_a_twentieth_of_a_pixel_is() -> None:
    assert check().look(frame(speckled(PATTERN, 24))).unexplained
    assert not check().look(frame(moved_image(PATTERN, 0.05, 0.0))).unexplained


def test_frames_of_one_rest_image_differ_by_noise_alone() -> None:
    single = StillnessCheck()
    single.set_reference(frame(seed=1))
    assert single.same(frame(seed=2))
    assert not single.same(frame(0.9 * PATTERN, seed=2))
    assert not single.same(frame(moved_image(PATTERN, 0.1, 0.0), seed=2))


@pytest.mark.parametrize('noise_grey', [1.0, 2.0, 4.0, 8.0])
def test_where_a_frame_shows_no_pattern_its_noise_is_none_that_another_frame_has_lost(noise_grey: float) -> None:
    """Two of a hundred blocks have no contrast but that of one frame's noise, none of which is in another frame."""
    blank = PATTERN.copy()
    blank[:24, :48] = 40.0
    single = StillnessCheck()
    single.set_reference(frame(blank, 0, noise_grey))
    assert [seed for seed in range(1, 15) if not single.same(frame(blank, seed, noise_grey))] == []
    assert not any(single.same(frame(0.8 * blank, seed, noise_grey)) for seed in range(1, 15))


@pytest.mark.parametrize('radius_px', [20.0, 45.0, 60.0])
def test_what_presses_moves_markers_away_however_wide_it_is(radius_px: float) -> None:
    """Markers move most at its rim, by 0.8 px, and less where they are farther away. The gel left alone again is no
    touch, nor is a camera that moved."""
    y, x = np.mgrid[:240, :240].astype(np.float32)
    away = np.hypot(x - 120, y - 110) / radius_px
    share = (0.8 / radius_px * np.minimum(1.0, np.maximum(away, 1e-3) ** -2)).astype(np.float32)
    pressed = cv2.remap(PATTERN, x - share * (x - 120), y - share * (y - 110), cv2.INTER_CUBIC)
    untouched, touched = StillnessCheck(), StillnessCheck()
    untouched.set_reference(frame(seed=1))
    touched.set_reference(frame(pressed, seed=2))
    assert untouched.pressed(frame(pressed, seed=3))
    assert not touched.pressed(frame(seed=4))
    moved = frame(moved_image(PATTERN, 0.8, 0.5), seed=5)
    assert not untouched.pressed(moved)
