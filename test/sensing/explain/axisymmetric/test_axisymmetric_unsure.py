"""Regions whose numbers come from few presses: how far off their motion may be, and that they have less say."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from test_axisymmetric import SURE, readout, response, seen

CONTACT = np.array([[3.0, -2.0, 0.5]])
REGIONS = 64
LATERAL_X, VERTICAL, PLACE_X = 0, 2, 3
"""Numbers of a channel: couplings of the lateral profile along x and y, of the vertical one, then the place."""


def unsure(number: int, sigma: float, regions: slice = slice(None)) -> np.ndarray:
    factors = np.zeros((REGIONS, 2, 5, 1))
    factors[regions, :, number] = sigma
    return factors


def test_motion_is_as_unsure_as_its_coupling_times_what_that_shows() -> None:
    """A coupling that is known to 0.1 makes motion unsure by a tenth of the profile's value."""
    gel = dataclasses.replace(response(), unsure=unsure(VERTICAL, 0.1))
    _, slopes, columns = gel.motion_slopes_and_columns(CONTACT)
    expected = np.square(0.1 * columns[0, :, VERTICAL])
    assert gel.variance(slopes, columns)[0] == pytest.approx(np.stack([expected, expected], axis=1))


def test_motion_is_as_unsure_as_its_place_times_the_slope() -> None:
    gel = dataclasses.replace(response(), unsure=unsure(PLACE_X, 0.2))
    _, slopes, columns = gel.motion_slopes_and_columns(CONTACT)
    step = 1e-5 * np.eye(2)[0]
    moved = [dataclasses.replace(gel, places=gel.places + sign * step).motion(CONTACT)[0] for sign in (1, -1)]
    assert gel.variance(slopes, columns)[0] == pytest.approx(np.square(0.2 * (moved[0] - moved[1]) / 2e-5), abs=1e-9)


def test_regions_that_are_known_are_not_unsure() -> None:
    _, slopes, columns = response().motion_slopes_and_columns(CONTACT)
    assert not response().variance(slopes, columns).any()


def test_regions_that_are_unsure_have_less_say() -> None:
    """Half of the regions see a fifth less than they are said to; if that is expected, the others read the force."""
    wrong = response()
    couplings = wrong.couplings.copy()
    couplings[::2] *= 1.2
    wrong = dataclasses.replace(wrong, couplings=couplings)
    factors = unsure(LATERAL_X, 0.2, slice(0, None, 2))
    factors[::2, 1] = [[0.0], [0.2], [0.0], [0.0], [0.0]]
    read = [
        readout(response=each).read(seen([(3.0, -2.0, 0.5)]), SURE).contacts[0].force_n
        for each in (wrong, dataclasses.replace(wrong, unsure=factors))
    ]
    assert abs(read[0] - 0.5) > 0.03
    assert abs(read[1] - 0.5) < 0.01


def test_a_contact_read_by_unsure_regions_is_less_sure() -> None:
    made = [readout(response=dataclasses.replace(response(), unsure=each)) for each in (None, unsure(VERTICAL, 0.3))]
    sure, less = (each.read(seen([(3.0, -2.0, 0.5)]), SURE).contacts[0] for each in made)
    assert less.sigma_n > 1.2 * sure.sigma_n
