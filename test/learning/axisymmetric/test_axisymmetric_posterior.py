"""How unsure a fit leaves regions: what is expected of them without presses, less with every press nearby."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tactile_nodes.learning.axisymmetric.regions import Presses, levers
from tactile_nodes.learning.axisymmetric.unsure import with_unsure
from tactile_nodes.sensing.explain.axisymmetric.readout import DOUBT_MM
from tactile_nodes.sensing.explain.axisymmetric.response import DISTANCES, AxisymmetricResponse

DOUBT = np.full(len(DOUBT_MM), 0.02)
SIGMAS = np.array([0.05, 0.05, 0.1, 0.05, 0.05, 0.1, 0.3, 0.3])
"""Of each region's couplings along x, along y, and of its place (mm)."""


@pytest.fixture
def response() -> AxisymmetricResponse:
    places = np.stack(np.meshgrid(*[np.linspace(-12.0, 12.0, 5)] * 2), axis=-1).reshape(-1, 2)
    mm = np.sinh(np.linspace(DISTANCES.low, DISTANCES.high, DISTANCES.count))
    profiles = np.stack([np.outer(-mm * np.exp(-mm / 4), np.ones(6)), np.outer(np.exp(-mm / 3), np.ones(6))])
    couplings = np.concatenate([np.tile(np.eye(2), (25, 1, 1)), places[:, :, None] / 20], axis=2)
    return AxisymmetricResponse(profiles, 1, 1.0, places, couplings)


@pytest.fixture
def precision() -> np.ndarray:
    return np.tile(np.diag(1 / SIGMAS**2), (25, 1, 1))


def pressed(response: AxisymmetricResponse, places: list[tuple[float, float]], certainty: float) -> Presses:
    contacts = np.array([(*place, 0.5) for place in places])
    motion = response.motion(contacts)
    return Presses(contacts, motion, np.full_like(motion, certainty))


ALL_OVER = [(x, y) for x in (-12.0, 0.0, 12.0) for y in (-12.0, 0.0, 12.0)]


def test_presses_that_show_nothing_leave_what_is_expected(
    response: AxisymmetricResponse, precision: np.ndarray
) -> None:
    """Four factors tell nearly all of the variance that five numbers make, and no more than that."""
    made = with_unsure(response, pressed(response, ALL_OVER, certainty=1e-9), precision, DOUBT)
    asked = np.array([[4.0, -3.0, 0.5], [-6.0, 1.0, 0.3]])
    _, slopes, columns = made.motion_slopes_and_columns(asked)
    stated = made.variance(slopes, columns)
    expected = (levers(response, *response.columns_and_slopes(asked)) ** 2 * SIGMAS**2).sum(axis=-1)
    assert (stated < 1.001 * expected).all()
    assert stated.sum() > 0.9 * expected.sum()


def test_more_presses_leave_regions_surer(response: AxisymmetricResponse, precision: np.ndarray) -> None:
    asked = np.array([[4.0, -3.0, 0.5]])
    few, many = (
        with_unsure(response, pressed(response, places, certainty=1e4), precision, DOUBT)
        for places in (ALL_OVER, ALL_OVER + [(x + 3.0, y - 4.0) for x, y in ALL_OVER])
    )
    variances = [each.variance(*each.motion_slopes_and_columns(asked)[1:]).sum() for each in (few, many)]
    assert variances[1] < 0.7 * variances[0]


def test_regions_are_surest_of_presses_where_they_were_pressed(
    response: AxisymmetricResponse, precision: np.ndarray
) -> None:
    made = with_unsure(response, pressed(response, ALL_OVER, certainty=1e4), precision, DOUBT)
    there, between = (
        made.variance(*made.motion_slopes_and_columns(np.array([[*place, 0.5]]))[1:]).sum()
        for place in ((0.0, 0.0), (6.0, 6.0))
    )
    assert there < between


def test_what_regions_are_unsure_by_is_not_counted_as_doubt_again(
    response: AxisymmetricResponse, precision: np.ndarray
) -> None:
    """Motion that is off by just what the regions' numbers may be off by leaves the least doubt that is stated."""
    from tactile_nodes.learning.axisymmetric.regions import measured_doubt

    unsure = with_unsure(response, pressed(response, ALL_OVER, certainty=1e-9), precision, DOUBT)
    random = np.random.default_rng(4)
    numbers = random.normal(size=(25, 8)) * SIGMAS * 0.9
    contacts = np.column_stack([random.uniform(-12, 12, (200, 2)), np.full(200, 0.5)])
    lever = levers(response, *response.columns_and_slopes(contacts))
    off = np.einsum('nrcl,rl->nrc', lever, numbers)
    seen = Presses(contacts, response.motion(contacts) + off, np.full((200, 25, 2), 1e12))
    known = dataclasses.replace(unsure, unsure=None)
    assert (measured_doubt(unsure, seen) < 0.6 * measured_doubt(known, seen))[1:6].all()
