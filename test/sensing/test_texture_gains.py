"""Spots of a texture that go further than others: learned from presses, and used where some of them are gone.

Bright spots lie at random; those of one kind go a quarter further than the motion around them, those of the other a
quarter less.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from tactile_nodes.sensing.flow.inverse_compositional import InverseCompositionalFlow, InverseCompositionalOptions
from tactile_nodes.sensing.rest.known_texture import KnownTexture, known_texture
from tactile_nodes.sensing.rest.texture_gains import GainsMeasurement, TextureGains

SIDE, SPOTS, GAIN = 132, 700, 0.25
RANDOM = np.random.default_rng(5)
PLACES = RANDOM.uniform(3, SIDE - 3, (SPOTS, 2))
FAR = RANDOM.permutation(SPOTS) < SPOTS // 2
ALL = np.ones(SPOTS, bool)
SHARES = np.where(FAR, 1 + GAIN, 1 - GAIN)[:, None]
EAST, WEST = np.array([0.6, 0.2]), np.array([-0.4, 0.5])


def shown(motion_px: np.ndarray | None = None, there: np.ndarray = ALL, light: float = 120.0) -> np.ndarray:
    """The spots that are there, moved by their share of an even motion."""
    places = PLACES if motion_px is None else PLACES + SHARES * motion_px
    y, x = np.mgrid[:SIDE, :SIDE]
    picture = np.full((SIDE, SIDE), 20.0)
    for right, down in places[there]:
        near = np.s_[max(0, int(down) - 6) : int(down) + 8, max(0, int(right) - 6) : int(right) + 8]
        picture[near] += light * np.exp(-((x[near] - right) ** 2 + (y[near] - down) ** 2) / (2 * 1.1**2))
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def flow_beside(rest: np.ndarray) -> InverseCompositionalFlow:
    flow = InverseCompositionalFlow(InverseCompositionalOptions(rows=6, cols=6))
    flow.set_reference(rest)
    return flow


@pytest.fixture(scope='module')
def learned() -> TextureGains:
    measurement = GainsMeasurement(shown())
    for motion_px in (EAST, WEST, -EAST, -WEST):
        measurement.add(shown(motion_px))
    return measurement.gains()


def at_spots(gains: np.ndarray, which: np.ndarray) -> float:
    x, y = np.rint(PLACES[which]).astype(int).T
    return float(np.median(gains[y, x]))


def test_presses_tell_which_spots_go_further(learned: TextureGains) -> None:
    """By a quarter, each way; next to others of the other kind it is less."""
    assert 0.6 * GAIN < at_spots(learned.gains, FAR) <= 1.1 * GAIN
    assert -1.1 * GAIN <= at_spots(learned.gains, ~FAR) < -0.6 * GAIN


def test_pictures_without_motion_tell_nothing() -> None:
    measurement = GainsMeasurement(shown())
    measurement.add(shown())
    assert not measurement.gains().gains.any()


def test_gains_go_where_the_picture_went(learned: TextureGains) -> None:
    moved = np.roll(learned.picture, (2, 3), (0, 1))
    beside = learned.beside(moved)
    assert beside is not None
    inner = np.s_[20:-20, 20:-20]
    assert np.abs(beside - np.roll(learned.gains, (2, 3), (0, 1)))[inner].max() < 0.05


def test_of_another_gel_or_another_cut_no_gains_are_known(learned: TextureGains) -> None:
    assert learned.beside(np.ascontiguousarray(learned.picture[::-1])) is None
    assert learned.beside(learned.picture[1:]) is None


def beside_first(texture: TextureGains, rest: np.ndarray) -> tuple[KnownTexture | None, InverseCompositionalFlow]:
    now = flow_beside(rest)
    return known_texture(texture, (now, rest), (flow_beside(shown()), shown())), now


def test_motion_beside_a_rest_image_without_far_spots_is_taken_for_that_of_all(learned: TextureGains) -> None:
    """Without half of those that go further, patches find less than all spots did. Four presses tell a third of it."""
    left = ~FAR | (RANDOM.random(SPOTS) < 0.5)
    known, now = beside_first(learned, shown(there=left))
    assert known is not None and known.finer is None
    found = now.displacement(shown(EAST, left))
    as_all = flow_beside(shown()).displacement(shown(EAST)).displacement_px
    off, mended = (
        float(np.abs(each - as_all).mean())
        for each in (found.displacement_px, known.as_first(found, found).displacement_px)
    )
    assert off > 0.03
    assert mended < 0.67 * off


def test_the_same_texture_leaves_motion_as_it_was_found(learned: TextureGains) -> None:
    known, now = beside_first(learned, shown())
    assert known is not None
    found = now.displacement(shown(EAST))
    np.testing.assert_allclose(known.as_first(found, found).displacement_px, found.displacement_px, atol=1e-6)


def test_patches_further_apart_than_contacts_are_wide_are_told_by_finer_ones(learned: TextureGains) -> None:
    coarse = InverseCompositionalFlow(InverseCompositionalOptions(rows=3, cols=3, finest_scale=1))
    coarse.set_reference(shown())
    known = known_texture(learned, (coarse, shown()), (coarse, shown()))
    assert known is not None and known.finer is not None
    assert known.finer.displacement(shown(EAST)).displacement_px.shape == (6, 6, 2)


def test_in_a_blurred_picture_gains_of_single_spots_are_not_used(learned: TextureGains) -> None:
    known, _ = beside_first(learned, cv2.GaussianBlur(shown(), (0, 0), 1.0))
    assert known is None


def test_spots_that_have_become_too_bright_are_taken_for_those_around(learned: TextureGains) -> None:
    """With gains at spots alone that more light drowns, nothing is left to correct by."""
    bright = shown(light=150.0)
    drowned = (bright >= 250) & (shown() < 250)
    assert 20 < drowned.sum() < 0.1 * drowned.size
    only_there = replace(learned, gains=np.where(drowned, learned.gains, np.float32(0)))
    known, now = beside_first(only_there, bright)
    none, _ = beside_first(replace(learned, gains=np.zeros_like(learned.gains)), bright)
    assert known is not None and none is not None
    found = now.displacement(shown(EAST, light=150.0))
    np.testing.assert_allclose(
        known.as_first(found, found).displacement_px, none.as_first(found, found).displacement_px, atol=1e-4
    )
