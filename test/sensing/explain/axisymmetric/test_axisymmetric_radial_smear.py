"""How radial smear changes where a region shows a press, and that its derivatives match."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tactile_nodes.sensing.explain.axisymmetric.radial_smear import NEAR_MM, SMEAR_MM, WIDE_MM, RadialSmear
from tactile_nodes.sensing.explain.axisymmetric.response import DISTANCES, AxisymmetricResponse

AT_THE_RIM = np.array([SMEAR_MM, 0.0])


def test_regions_of_the_middle_show_a_press_where_it_is() -> None:
    away = np.array([[3.0, -2.0]])
    assert RadialSmear(0.4, 0.1).shown(away, np.zeros((1, 2))) == pytest.approx(away)


def test_a_squeeze_shortens_distances_along_the_smear_alone() -> None:
    """As far away as the squeeze is wide half of it is left: 6 mm become 5.7 along the smear, and stay 6 across it."""
    shown = RadialSmear(0.0, 0.1).shown(np.array([[WIDE_MM, 0.0], [0.0, WIDE_MM]]), AT_THE_RIM)
    assert shown == pytest.approx(np.array([[0.95 * WIDE_MM, 0.0], [0.0, WIDE_MM]]))


def test_a_shift_fades_with_the_distance() -> None:
    """All of it at the press itself, half of it 3 mm away; along the smear, wherever the press is."""
    shown = RadialSmear(-0.4).shown(np.array([[0.0, 0.0], [0.0, NEAR_MM]]), AT_THE_RIM)
    assert shown == pytest.approx(np.array([[-0.4, 0.0], [-0.2, NEAR_MM]]))


def test_half_way_to_the_rim_the_shift_is_half_and_the_squeeze_a_quarter() -> None:
    away = np.array([[WIDE_MM, 0.0]])
    whole, half = ((RadialSmear(0.4, 0.1).shown(away, share * AT_THE_RIM) - away)[0, 0] for share in (1.0, 0.5))
    shift = 0.4 / (1 + (WIDE_MM / NEAR_MM) ** 2)
    squeeze = 0.05 * WIDE_MM
    assert (whole, half) == pytest.approx((shift - squeeze, shift / 2 - squeeze / 4))


def response() -> AxisymmetricResponse:
    random = np.random.default_rng(3)
    profiles = random.normal(size=(2, DISTANCES.count, 6))
    places = random.uniform(-14, 14, (30, 2))
    couplings = random.normal(size=(30, 2, 3))
    return AxisymmetricResponse(profiles, 1, 1.2, places, couplings, 1.1, 0.9, RadialSmear(-0.4, 0.1))


def test_slopes_of_motion_are_its_differences() -> None:
    gel, contacts, step = response(), np.array([[3.0, 2.0, 0.5], [-7.0, 5.0, 0.8]]), 1e-5
    _, slopes = gel.motion_and_slopes(contacts)
    for axis, unit in enumerate(np.eye(3)):
        differences = (gel.motion(contacts + step * unit) - gel.motion(contacts - step * unit)) / (2 * step)
        assert slopes[axis] == pytest.approx(differences, abs=1e-6)


def test_without_smear_motion_is_as_far_away_alike_on_all_sides() -> None:
    """Of regions that look straight: a press 4 mm further out and one 4 mm further in move a region oppositely."""
    plain = dataclasses.replace(response(), smear=RadialSmear(), couplings=np.tile(np.eye(2, 3), (30, 1, 1)))
    place = plain.places[0]
    presses = np.array([[*(place * (1 + sign * 4 / np.linalg.norm(place))), 0.5] for sign in (1, -1)])
    outer, inner = plain.motion(presses)[:, 0]
    assert outer == pytest.approx(-inner, abs=1e-9)
