"""Nothing touches: patches all over the picture stay where it carried them, each within what is known of it."""

from __future__ import annotations

import numpy as np

from tactile_nodes.sensing.picture.quietness import PATCHES, PLACES, loosely_quiet, quiet

FOUND = np.ones(100, bool)
NOISE = np.random.default_rng(2).normal(0, 0.003, (100, 2))


def touched(most_px: float) -> np.ndarray:
    """Patches of a 10x10 grid that go away from its middle."""
    apart = np.stack(np.meshgrid(np.arange(10) - 4.5, np.arange(10) - 4.5), axis=-1).reshape(-1, 2)
    moved: np.ndarray = NOISE + most_px * apart * np.exp(0.5 - 0.5 * np.square(apart).sum(axis=1, keepdims=True))
    return moved


def test_noise_is_quiet_and_a_light_touch_is_only_to_a_coarse_look() -> None:
    assert quiet(NOISE, FOUND) and loosely_quiet(NOISE, FOUND, 0.0, 1.0)
    assert not quiet(touched(0.02), FOUND) and loosely_quiet(touched(0.02), FOUND, 0.0, 1.0)
    assert not loosely_quiet(touched(0.1), FOUND, 0.0, 1.0)


def test_patches_whose_markers_are_gone_may_seem_to_move() -> None:
    wandering = NOISE * 7  # the middle one by 0.025 px, so that 0.06 px are allowed
    wandering[:8] = [0.12, 0.0]
    assert not loosely_quiet(wandering, FOUND, 0.0, 1.0)
    assert loosely_quiet(wandering, FOUND, 0.0, 0.5)  # half of the middle patch is explained: 0.125 px more


def test_a_limit_is_in_units_of_the_noise_of_the_middle_patch() -> None:
    """Every patch moves by 0.01 px along one axis and not along the other: its noise is half of 0.01 px over 0.6745."""
    left = np.zeros((PATCHES**2, 2))
    left[::2, 0], left[1::2, 1] = 0.01, 0.01
    most = PLACES.most(left.astype(np.float32)) / (0.005 / 0.6745)
    everywhere = np.ones(PATCHES**2, bool)
    assert quiet(left, everywhere, 1.01 * most)
    assert not quiet(left, everywhere, 0.99 * most)
