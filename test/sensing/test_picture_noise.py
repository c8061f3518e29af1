"""How noisy a picture is shows in what no press explains of two frames, and by how much that puts a force off."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from responding import COMPONENTS, GRID, components, features, readout

from tactile_nodes.sensing.explain.measured.altered import read_altered
from tactile_nodes.sensing.explain.measured.picture_noise import (
    FEWEST,
    LIMIT_SIGMAS,
    left_over,
    noise_between,
    usual_noise,
)

FREE = 2 * GRID**2 - COMPONENTS
SURE = np.ones((GRID, GRID), np.float32)
PLAIN = readout(most_contacts=1, scale=4000.0)
FLOOR = math.sqrt(FREE / (2 * GRID**2)) * (1 + LIMIT_SIGMAS / math.sqrt(2 * FREE))
READER = replace(PLAIN, likeness=replace(PLAIN.likeness, floor=FLOOR))  # of which a noise of 1 is usual


def frame(random: np.random.Generator, noise: float, s: float = 0.5) -> np.ndarray:
    pressed = features(READER, components(READER.response, (2.0, -1.0, s)))
    return (pressed + noise * random.normal(size=pressed.shape)).astype(np.float32)


def test_noise_is_what_two_frames_differ_by() -> None:
    assert noise_between(np.array([3.0, 0.0], np.float32), np.array([1.0, 0.0], np.float32)) == pytest.approx(1.0)


def test_inputs_that_one_frame_does_not_know_tell_nothing() -> None:
    now, before = np.array([3.0, np.nan, 5.0], np.float32), np.array([1.0, 0.0, np.nan], np.float32)
    assert noise_between(now, before) == pytest.approx(math.sqrt(2.0))
    assert math.isnan(noise_between(now[1:], before[1:]))


def test_a_limit_one_of_a_thousand_frames_exceeds_tells_the_usual_noise() -> None:
    assert usual_noise(READER, SURE) == pytest.approx(1.0)


def test_noise_is_told_whatever_presses() -> None:
    """The standard deviation of 48 numbers is off by a tenth, that of 50 times as many by 1.4 %; four of those."""
    random, found = np.random.default_rng(1), []
    for s in np.linspace(0.1, 0.9, 50):
        now, before = (read_altered(READER, frame(random, 2.5, s), SURE).left_over for _ in range(2))
        assert now is not None and before is not None
        found.append(noise_between(now, before))
    assert math.sqrt(np.mean(np.square(found))) == pytest.approx(2.5, rel=4 / math.sqrt(2 * FREE * 50))


@pytest.mark.parametrize('noise', [2.0, 6.0])
def test_noise_puts_force_and_place_off_by_as_much_as_told(noise: float) -> None:
    """A standard deviation over 300 frames is off by a twenty-fourth; three of those, as the fit is not linear."""
    random = np.random.default_rng(2)
    contacts = [read_altered(READER, frame(random, noise), SURE).contacts[0] for _ in range(300)]
    force, place = noise * contacts[0].noise_n, noise * contacts[0].noise_mm
    assert np.std([each.force_n for each in contacts]) == pytest.approx(force, rel=0.13)
    apart = [np.std([each.x_mm for each in contacts]), np.std([each.y_mm for each in contacts])]
    assert np.sqrt(np.mean(np.square(apart))) == pytest.approx(place, rel=0.13)


def test_regions_that_are_not_followed_tell_no_noise() -> None:
    lost = SURE.copy()
    lost[0] = 0.0
    seen = READER.seen(frame(np.random.default_rng(3), 1.0), lost)
    left = left_over(READER, frame(np.random.default_rng(3), 1.0), lost, seen.scores).reshape(GRID, GRID, 2)
    assert np.isnan(left[0]).all()
    assert np.isfinite(left[1:]).all()


def test_with_too_few_inputs_nothing_is_told_of_noise() -> None:
    few = np.zeros((GRID, GRID), np.float32)
    few.reshape(-1)[: (COMPONENTS + FEWEST) // 2 - 1] = 1.0
    assert math.isnan(usual_noise(READER, few))
    assert np.isnan(
        left_over(READER, frame(np.random.default_rng(4), 1.0), few, np.zeros(COMPONENTS, np.float32))
    ).all()


def test_of_a_picture_as_in_the_training_nothing_is_told() -> None:
    found = READER.read(frame(np.random.default_rng(5), 1.0), SURE)
    assert found.left_over is None
    assert math.isnan(found.contacts[0].noise_n)
