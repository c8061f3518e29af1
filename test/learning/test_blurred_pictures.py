"""Software blurs a picture as a lens would, with the noise that the camera would have added after it."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes.learning.datasets.blurred_pictures import PictureNoise, SoftwareBlur

READ, SHOT = 1.5, 0.05
ROUNDING = 1 / 12
"""Variance of what rounding to whole grey levels adds."""


def taken(scene: np.ndarray, count: int, seed: int = 1) -> list[np.ndarray]:
    """Pictures of a scene as a camera takes them."""
    random = np.random.default_rng(seed)
    spread = np.sqrt(READ + SHOT * scene)
    return [np.rint(scene + spread * random.normal(size=scene.shape)).astype(np.uint8) for _ in range(count)]


def test_noise_is_told_by_pictures_of_one_scene() -> None:
    """With 90000 pixels of 8 pictures the variance is known to 0.5 %, its rise to a few."""
    scene = np.tile(np.linspace(20, 200, 300), (300, 1))
    noise = PictureNoise.of(taken(scene, 8))
    assert noise.read == pytest.approx(READ + ROUNDING, abs=0.15)
    assert noise.shot == pytest.approx(SHOT, rel=0.05)


def test_one_picture_tells_no_noise() -> None:
    assert PictureNoise.of(taken(np.full((9, 9), 50.0), 1)) == PictureNoise()


@pytest.mark.parametrize('sigma_px', [0.5, 1.5])
def test_a_blurred_picture_is_as_noisy_as_one_that_is_not(sigma_px: float) -> None:
    """The variance of 160000 pixels is known to 0.4 %; rounding adds to it a second time."""
    image = taken(np.full((400, 400), 100.0), 1)[0]
    soft = SoftwareBlur(sigma_px, PictureNoise(READ + ROUNDING, SHOT))(image)
    assert soft.astype(float).var() == pytest.approx(READ + 100 * SHOT + 2 * ROUNDING, rel=0.02)
    assert soft.mean() == pytest.approx(image.mean(), abs=0.03)


@pytest.mark.parametrize('sigma_px', [0.5, 1.0, 1.5])
def test_a_point_is_spread_by_the_standard_deviation_asked_for(sigma_px: float) -> None:
    """A bright square of 9 px, of variance (81 - 1) / 12 along an axis, is wider by that of the blur.

    Rounding takes light away that is less than half a grey level, from far out: 0.034 px² at 0.5 px.
    """
    image = np.zeros((41, 41), np.uint8)
    image[16:25, 16:25] = 250
    soft = SoftwareBlur(sigma_px, PictureNoise())(image).astype(float)
    at = np.arange(41) - 20
    along = soft.sum(axis=0)
    assert (along * at**2).sum() / along.sum() == pytest.approx(80 / 12 + sigma_px**2, abs=0.05)


def test_the_same_pictures_become_the_same_by_one_seed() -> None:
    images = taken(np.full((20, 20), 100.0), 2)
    once, again, other = (SoftwareBlur(1.0, PictureNoise(READ, SHOT), seed) for seed in (1, 1, 2))
    first = [once(each) for each in images]
    assert all(np.array_equal(a, again(b)) for a, b in zip(first, images, strict=True))
    assert not np.array_equal(first[0], other(images[0]))
