"""Printed dots that are found again one by one: motion as drawn, whatever the light, and what is lost is said."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes.errors import ImageError
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.flow.methods import DisplacementField

WIDTH, HEIGHT, PITCH_PX, RADIUS_PX = 320, 240, 44.0, 9.0
REACH_PX = 40
"""So far from its middle a dot changes no bit of the sheet."""
PLACES = np.array([(38.0 + PITCH_PX * col, 32.0 + PITCH_PX * row) for row in range(5) for col in range(6)])


def sheet(places: np.ndarray) -> np.ndarray:
    """Dark discs with soft edges on a sheet that is brighter on the left."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    grey: np.ndarray = 150.0 - 0.15 * x
    for px, py in places:
        near = tuple(slice(max(0, int(at) - REACH_PX), max(0, int(at) + REACH_PX)) for at in (py, px))
        grey[near] *= 1 - 0.6 / (1 + np.exp((np.hypot(x[near] - px, y[near] - py) - RADIUS_PX) / 0.7))
    return grey


def drawn(places: np.ndarray, light: float = 1.0, seed: int = 0, noise: float = 1.0) -> np.ndarray:
    """The same as a picture, with noise of some grey levels."""
    clean = light * sheet(places)
    noisy = clean + np.random.default_rng(seed).normal(0, noise, clean.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def seen(places: np.ndarray, light: float = 1.0) -> DisplacementField:
    flow = make_flow('dots', {'rows': 6, 'cols': 8})
    flow.set_reference(drawn(PLACES))
    return flow.displacement(drawn(places, light, seed=1))


@pytest.mark.parametrize('shift', [(0.3, -0.2), (1.7, 2.2), (-9.0, 12.0), (0.0, 20.0)])
def test_a_shift_of_up_to_nearly_half_the_pitch_is_measured_everywhere(shift: tuple[float, float]) -> None:
    field = seen(PLACES + np.array(shift))
    assert np.abs(field.displacement_px - np.array(shift)).max() < 0.08
    assert field.confidence is not None
    assert field.confidence.min() == pytest.approx(1.0)


@pytest.mark.parametrize('light', [0.7, 1.3])
def test_light_is_no_motion(light: float) -> None:
    assert np.abs(seen(PLACES, light).displacement_px).max() < 0.08


def test_noise_moves_dots_hardly_more_than_it_must() -> None:
    """No unbiased measurement of a shift has a smaller variance than that of the noise over the sum of the squared
    slopes (Cramér and Rao); here both pictures have noise, and 30 dots are shifted by parts of a pixel."""
    noise, reach = 2.5, 14
    errors = []
    for seed in range(4):
        shifts = np.random.default_rng(seed).uniform(-0.5, 0.5, PLACES.shape)
        flow = make_flow('dots', {'rows': 6, 'cols': 8})
        flow.set_reference(drawn(PLACES, seed=10 + seed, noise=noise))
        motion, found, _ = flow._rest.followed(drawn(PLACES + shifts, seed=20 + seed, noise=noise))  # type: ignore[attr-defined]
        at = np.argmin(np.hypot(*(flow._rest.centres_px[:, None] - PLACES).transpose(2, 0, 1)), axis=1)  # type: ignore[attr-defined]
        assert found.all()
        errors.append(motion - shifts[at])
    x, y = PLACES[8].astype(int)
    slope = np.gradient(sheet(PLACES)[y - reach : y + reach + 1, x - reach : x + reach + 1], axis=1)
    least_px = np.sqrt(2) * noise / np.sqrt(np.square(slope).sum())
    assert np.sqrt(np.square(errors).mean()) < 1.4 * least_px


@pytest.mark.parametrize(('noise', 'shift'), [(2.0, 0.0), (8.0, 0.4)])
def test_the_noise_of_the_motion_is_found_in_the_picture(noise: float, shift: float) -> None:
    flow = make_flow('dots', {'rows': 6, 'cols': 8})
    flow.set_reference(drawn(PLACES))
    told, errors = [], []
    for seed in range(1, 5):
        picture = drawn(PLACES + np.array((shift, 0.0)), seed=seed, noise=noise)
        field = flow.displacement(picture)
        told.append(field.noise_px)
        errors.append(field.displacement_px - (shift, 0.0))
    assert np.mean(told) == pytest.approx(np.sqrt(np.square(errors).mean()), rel=0.2)


def test_a_turn_of_the_camera_is_measured_in_the_middle_of_each_region() -> None:
    """1 degree about (148, 120), with dots beside the middles of regions."""
    about = PLACES - (148.0, 120.0)
    field = seen(PLACES + np.deg2rad(1) * np.column_stack([-about[:, 1], about[:, 0]]))
    x = (np.arange(8) + 0.5) * WIDTH / 8 - 0.5 - 148
    y = (np.arange(6) + 0.5) * HEIGHT / 6 - 0.5 - 120
    turned = np.deg2rad(1) * np.stack([np.broadcast_to(-y[:, None], (6, 8)), np.broadcast_to(x, (6, 8))], -1)
    np.testing.assert_allclose(field.displacement_px, turned, atol=0.1)


def test_a_picture_that_grows_moves_more_towards_its_rim() -> None:
    """2 % about (148, 120): a region at (60, 120) goes 88 * 0.02 = 1.76 px to the left."""
    field = seen(PLACES + 0.02 * (PLACES - (148.0, 120.0)))
    x = (np.arange(8) + 0.5) * WIDTH / 8 - 0.5
    np.testing.assert_allclose(field.displacement_px[2:4, 1:7, 0].mean(axis=0), 0.02 * (x[1:7] - 148), atol=0.15)


def test_a_dot_that_is_covered_is_left_out_and_makes_the_regions_about_it_less_sure() -> None:
    gone = np.argmin(np.hypot(*(PLACES - (170.0, 120.0)).T))
    field = seen(np.delete(PLACES + np.array((2.0, 0.0)), gone, axis=0))
    assert np.abs(field.displacement_px - (2.0, 0.0)).max() < 0.1
    assert field.confidence is not None
    lowest = np.unravel_index(field.confidence.argmin(), field.confidence.shape)
    assert field.confidence[lowest] < 0.6
    assert field.confidence[0, 0] == pytest.approx(1.0)
    assert abs(lowest[1] - PLACES[gone][0] / 40) < 1.5


def test_regions_far_from_every_dot_know_nothing() -> None:
    """Dots 10 px apart on the left quarter of 640x240 px: the right rim is 48 pitches away."""
    y, x = np.mgrid[:240, :640].astype(float)
    off = np.hypot(x - 10 * np.rint(x / 10), y - 10 * np.rint(y / 10))
    rest = np.where((off < 3) & (x < 165), 60, 160).astype(np.uint8)
    flow = make_flow('dots', {'rows': 12, 'cols': 32})
    flow.set_reference(rest)
    sure = flow.displacement(rest).confidence
    assert sure is not None
    assert sure[1:-1, 1:7].min() == pytest.approx(1.0)
    assert sure[:, 11:].max() < 0.01


def test_a_picture_without_dots_is_refused() -> None:
    with pytest.raises(ImageError, match='shows no printed dots in rows and columns'):
        make_flow('dots').set_reference(np.full((HEIGHT, WIDTH), 120, np.uint8))
