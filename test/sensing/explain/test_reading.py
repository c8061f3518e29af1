"""Contacts as forces on bins: nothing is lost, and a border is shared."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_nodes.sensing.explain.reading import Contact, spread_over_bins
from tactile_nodes.sensing.geometry import BinGrid

BINS = BinGrid(4, 2, 16.0, 32.0)  # 8 mm wide and 8 mm high each
anywhere = st.floats(-40, 40)
contacts = st.builds(Contact, anywhere, anywhere, st.floats(0, 5), st.one_of(st.floats(0, 20), st.just(math.nan)))


@settings(max_examples=40, deadline=None)
@given(st.lists(contacts, max_size=4))
def test_the_sum_of_the_bins_is_the_force_of_all_contacts(found: list[Contact]) -> None:
    forces = spread_over_bins(tuple(found), BINS)
    assert forces.sum(dtype=float) == pytest.approx(sum(each.force_n for each in found), abs=1e-5)
    assert (forces >= 0).all()


def test_without_any_error_all_of_the_force_is_in_one_bin() -> None:
    forces = spread_over_bins((Contact(4.0, -12.0, 0.7, 0.0),), BINS)
    assert forces.tolist() == [[0, pytest.approx(0.7)], [0, 0], [0, 0], [0, 0]]


def test_a_place_of_unknown_error_counts_as_exact() -> None:
    known, unknown = (spread_over_bins((Contact(1.0, 1.0, 0.7, sigma),), BINS) for sigma in (0.0, math.nan))
    np.testing.assert_array_equal(known, unknown)


@pytest.mark.parametrize('sigma_mm', [0.0, 0.05, 0.5])
def test_on_a_border_both_bins_get_half(sigma_mm: float) -> None:
    forces = spread_over_bins((Contact(0.0, -12.0, 1.0, sigma_mm),), BINS)
    np.testing.assert_allclose(forces[0], [0.5, 0.5], atol=1e-6)


def test_on_a_corner_four_bins_get_a_quarter() -> None:
    np.testing.assert_allclose(spread_over_bins((Contact(0.0, 0.0, 1.0, 0.1),), BINS)[1:3], 0.25, atol=1e-6)


def test_one_standard_deviation_from_a_border_the_far_bin_gets_what_a_normal_error_leaves() -> None:
    forces = spread_over_bins((Contact(0.3, -12.0, 1.0, 0.3),), BINS)
    np.testing.assert_allclose(forces[0], [0.158655, 0.841345], atol=1e-6)


@settings(max_examples=40, deadline=None)
@given(st.floats(-40, 40), st.floats(-40, 40))
def test_a_force_off_the_surface_is_in_the_outermost_bins(x_mm: float, y_mm: float) -> None:
    forces = spread_over_bins((Contact(x_mm, y_mm, 1.0, 0.0),), BINS)
    inside = Contact(min(max(x_mm, -7.9), 7.9), min(max(y_mm, -15.9), 15.9), 1.0, 0.0)
    if abs(x_mm) > 0.1 and min(abs(y_mm - border) for border in (-8, 0, 8)) > 0.1:
        np.testing.assert_array_equal(forces, spread_over_bins((inside,), BINS))


def test_contacts_add_up() -> None:
    one, other = Contact(-3.0, -12.0, 0.4, 0.2), Contact(3.0, 12.0, 0.3, 0.2)
    both = spread_over_bins((one, other), BINS)
    np.testing.assert_allclose(both, spread_over_bins((one,), BINS) + spread_over_bins((other,), BINS), atol=1e-7)
