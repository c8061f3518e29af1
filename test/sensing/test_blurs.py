"""A readout that knows what blur does to its response reads blurred pictures by that, and sharp ones as ever."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from responding import BINS, COMPONENTS, GRID, components, features, readout

from tactile_nodes.sensing.explain.measured.blurs import Blur, Blurs
from tactile_nodes.sensing.explain.measured.readout import ResponseReadout
from tactile_nodes.sensing.explain.measured.response import Response
from tactile_nodes.sensing.explain.model import FeatureLayout, ForceEstimator, ForceModel
from tactile_nodes.sensing.explain.uncertainty import Calibration
from tactile_nodes.sensing.features import Features

SHARP, SOFT, SOFTER = 0.52, 0.48, 0.42
SHORT = {SOFT: 0.02, SOFTER: 0.06}
"""Motion in pictures of a sharpness is short by this share."""
SURE = np.ones((GRID, GRID), np.float32)
PLAIN = readout(most_contacts=1, scale=20_000.0)


def knowing(noise: float = 1.0) -> ResponseReadout:
    """Knows that motion is short in blurred pictures, and that these have so many times the noise."""
    told, limits = PLAIN.response, PLAIN.likeness
    levels = tuple(
        Blur(
            sharpness, (-short * told.coefficients).astype(np.float16),
            np.eye(COMPONENTS, dtype=np.float32) / np.float32(noise), told.growth, PLAIN.calibration,
            noise * limits.floor, limits.share,
        )
        for sharpness, short in SHORT.items()
    )  # fmt: skip
    return replace(PLAIN, blurs=Blurs(SHARP, levels))


def made_of(readout: ResponseReadout, sharpness: float) -> ResponseReadout:
    """What reads pictures of this sharpness."""
    assert readout.blurs is not None
    made = readout.blurs.readout(readout, sharpness)
    assert made is not None
    return made


def pressed(short: float, force_n: float = 0.6) -> np.ndarray:
    """Features of a press whose motion is short by a share."""
    return np.asarray((1 - short) * features(PLAIN, components(PLAIN.response, (2.0, -1.0, force_n))), np.float32)


def read_n(sharpness: float, short: float, of: ResponseReadout | None = None) -> float:
    """The force that is read in a blurred picture."""
    model = ForceModel(FeatureLayout('cartesian_mean', GRID, GRID, 2), BINS, of or knowing())
    seen = Features('cartesian_mean', pressed(short), SURE)
    return ForceEstimator(model).predict(seen, altered=True, blurred=True, sharpness=sharpness).total_n


@pytest.mark.parametrize('sharpness', [SOFT, SOFTER])
def test_motion_that_is_short_in_a_blurred_picture_is_read_as_the_force_that_it_is(sharpness: float) -> None:
    assert read_n(sharpness, SHORT[sharpness]) == pytest.approx(0.6, abs=1e-3)


def test_a_readout_that_knows_nothing_of_blur_reads_it_short() -> None:
    """As it always did: the response grows with the force in a straight line, so 6 % less motion is 6 % less force."""
    assert read_n(SOFTER, 0.06, PLAIN) == pytest.approx(0.6 * 0.94, abs=2e-3)


def test_between_two_levels_it_is_between_what_they_are() -> None:
    assert read_n((SOFT + SOFTER) / 2, 0.04) == pytest.approx(0.6, abs=1e-3)
    assert read_n((SHARP + SOFT) / 2, 0.01) == pytest.approx(0.6, abs=1e-3)


def test_beyond_the_last_level_it_is_as_there() -> None:
    assert read_n(SOFTER - 0.05, 0.06) == pytest.approx(0.6, abs=1e-3)


@pytest.mark.parametrize('sharpness', [0.0, float('nan'), SHARP, 0.6])
def test_sharp_pictures_and_those_of_unknown_sharpness_are_read_as_by_a_readout_without(sharpness: float) -> None:
    assert read_n(sharpness, 0.0) == read_n(sharpness, 0.0, PLAIN)


def test_undisturbed_pictures_are_read_to_the_bit_as_without() -> None:
    for short in (0.0, 0.02):
        with_blurs, without = (each.read(pressed(short), SURE) for each in (knowing(), PLAIN))
        np.testing.assert_array_equal(with_blurs.normal_force_n, without.normal_force_n)
        assert (with_blurs.contacts, with_blurs.unlikeness) == (without.contacts, without.unlikeness)


def test_the_noise_of_blurred_pictures_makes_forces_as_much_less_sure() -> None:
    """Twice the noise leaves a quarter of the information, so the standard deviation is twice as large."""
    once, twice = (made_of(knowing(noise), SOFT).read(pressed(0.02), SURE).contacts[0] for noise in (1.0, 2.0))
    assert twice.force_n == pytest.approx(once.force_n, abs=1e-3)
    assert twice.sigma_n == pytest.approx(2 * once.sigma_n, rel=1e-2)


def test_the_limits_of_a_level_are_its_own() -> None:
    known = knowing()
    assert known.blurs is not None
    told = Calibration(0.1, 0.02, (2.0,), (3.0,), 1.7, 9.0)
    levels = (replace(known.blurs.levels[0], calibration=told, floor=5.0, share=0.3), known.blurs.levels[1])
    made = made_of(replace(known, blurs=Blurs(SHARP, levels)), SOFT + 0.001)
    assert made.calibration == told
    assert (made.likeness.floor, made.likeness.share) == (5.0, 0.3)


def test_the_table_to_begin_with_is_that_of_the_response() -> None:
    made = made_of(knowing(), SOFT).response
    usual = Response(*made.axes, made.coefficients, made.growth, made.power)
    largest = np.abs(usual.start_components).max()
    np.testing.assert_allclose(made.start_components, usual.start_components, atol=1e-5 * largest)
