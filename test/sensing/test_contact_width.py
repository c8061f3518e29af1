"""Contacts wider than those of the training are told from the training's own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from responding import COMPONENTS, GRID, components, features, readout, response

from tactile_nodes.sensing.contact_width import USUAL_MM2, Widths, added_by_width, mended, taken
from tactile_nodes.sensing.response import locate

GEL = response()
READER = readout()
SURE = np.ones((GRID, GRID), np.float32)


def pressed(apart_mm: float, s: float = 0.6) -> np.ndarray:
    """Four contacts of a quarter each, this far from the middle of them: this gel answers in proportion to s."""
    x, y, quarter = 2.0, -1.0, s / 4
    places = [(x + apart_mm, y), (x - apart_mm, y), (x, y + apart_mm), (x, y - apart_mm)]
    return components(GEL, *[(*place, quarter) for place in places])


@pytest.mark.parametrize('apart_mm', [0.4, 0.8, 1.2])
def test_a_wider_contact_adds_half_the_mean_square_of_its_places_along_an_axis(apart_mm: float) -> None:
    """Two of four places are apart_mm away along an axis: (1/2) (1/2) apart_mm²; s is that of all four together."""
    seen = pressed(apart_mm)
    found, contact = added_by_width(GEL, seen, fit := locate(GEL, seen, GEL.start(seen)[None])), fit.contacts[0]
    s = contact[2] + found.steps[0, 2] + found.off[0]
    assert found.mm2[0] == pytest.approx(apart_mm**2 / 4, rel=0.1)
    assert s == pytest.approx(0.6, abs=0.02)
    assert abs(s - 0.6) < 0.2 * abs(contact[2] - 0.6)


def test_noise_adds_no_width_beyond_its_standard_deviation() -> None:
    random, found = np.random.default_rng(3), []
    for _ in range(200):
        seen = components(GEL, (2.0, -1.0, 0.6)) + random.normal(size=COMPONENTS).astype(np.float32)
        widths = added_by_width(GEL, seen, locate(GEL, seen, GEL.start(seen)[None]))
        found.append((widths.mm2[0], widths.sigma_mm2[0]))
    mm2, sigma_mm2 = np.array(found).T
    # 1 within sqrt(1 / 400), and four times that is an even chance of one in 16 000
    assert np.sqrt(np.mean((mm2 / sigma_mm2) ** 2)) == pytest.approx(1.0, abs=4 * 0.05)


def test_what_is_wide_but_may_be_noise_is_not_called_wide() -> None:
    mm2, sigma_mm2 = np.array([[0.2, 0.09], [0.2, 0.11], [0.05, 0.001], [-0.5, 0.01]]).T
    assert Widths(mm2, sigma_mm2, np.zeros((4, 3)), np.zeros(4)).wide.tolist() == [True, False, False, False]


def test_contacts_of_a_usual_width_are_read_better_with_it_than_without() -> None:
    """Places of a pair lie so far apart that the width is one standard deviation of the usual ones, or minus that.

    Noise lets width be known to a tenth of that here, so what a contact is off by for it is nearly all taken out.
    """
    gel, found, random = response(scale=20_000.0), [], np.random.default_rng(7)
    for x, y in random.uniform(-6, 6, (40, 2)).tolist():
        apart_mm = (4 * USUAL_MM2) ** 0.5
        places = [(x + apart_mm, y), (x - apart_mm, y), (x, y + apart_mm), (x, y - apart_mm)]
        seen = components(gel, *[(*place, 0.15) for place in places])
        seen += random.normal(size=COMPONENTS).astype(np.float32)
        fit = locate(gel, seen, gel.start(seen)[None])
        told = mended(gel, fit, added_by_width(gel, seen, fit))
        found.append((fit.contacts[0, 2] - 0.6, told.contacts[0, 2] - 0.6))
    without, with_it = np.sqrt(np.square(found).mean(axis=0))
    assert with_it < 0.5 * without


def test_a_light_wide_contact_is_read_nearly_as_hard_as_it_is() -> None:
    """Three tenths of what it is off by stay, and what of the width is of a higher order."""
    gel = response(scale=4000.0)
    seen = components(gel, *[(x, y, 0.0625) for x, y in ((2.8, -1.0), (1.2, -1.0), (2.0, -0.2), (2.0, -1.8))])
    fit = locate(gel, seen, gel.start(seen)[None])
    told = mended(gel, fit, added_by_width(gel, seen, fit)).contacts[0]
    assert abs(fit.contacts[0, 2] - 0.25) > 0.003
    assert abs(told[2] - 0.25) < 0.4 * abs(fit.contacts[0, 2] - 0.25)


def test_a_share_of_a_width_is_taken_by_how_sure_it_is_and_how_light_the_contact() -> None:
    """Of no width 0.7 / (1 + sqrt(0.0901 / 0.001)): variances of 0.01² + 0.3² and 0.01² + 0.03² mm⁴, even chances."""
    assert taken(1e-9, 0.01**2, 0.1) == pytest.approx(0.7 / 10.49, rel=1e-3)
    assert taken(0.5, 0.01**2, 0.1) == pytest.approx(0.7)
    assert taken(0.5, 0.01**2, 0.45) == pytest.approx(0.35)
    assert taken(0.5, 0.01**2, 0.6) == 0
    assert taken(-0.5, 0.01**2, 0.1) == 0


def test_a_contact_of_no_width_stays_what_it_is() -> None:
    seen = components(GEL, (2.0, -1.0, 0.6))
    fit = locate(GEL, seen, GEL.start(seen)[None])
    assert mended(GEL, fit, added_by_width(GEL, seen, fit)).contacts[0] == pytest.approx([2.0, -1.0, 0.6], abs=2e-3)


def test_a_contact_where_the_splines_end_stays_there() -> None:
    seen = components(GEL, (12.0, 0.0, 0.5), (11.0, 1.0, 0.2))
    fit = replace(locate(GEL, seen, GEL.start(seen)[None]), contacts=np.array([[12.0, 0.1, 0.6]]))
    widths = added_by_width(GEL, seen, fit)
    assert np.abs(widths.steps).max() > 1e-3
    assert mended(GEL, fit, widths).contacts.tolist() == [[12.0, 0.1, 0.6]]


def test_a_wide_contact_is_unlike_the_training_and_less_sure() -> None:
    usual, broad = (READER.read(features(READER, pressed(apart)), SURE) for apart in (0.0, 1.0))
    assert usual.unlikeness < 0.5
    assert broad.unlikeness >= 1
    off_n = 0.6 - broad.contacts[0].force_n
    assert abs(off_n) > 3 * usual.total_sigma_n
    assert broad.total_sigma_n == pytest.approx(abs(off_n), rel=0.3)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.1, 300.0))
def test_whatever_is_seen_a_contact_stays_within_the_splines_and_is_told_as_mended(seed: int, size: float) -> None:
    seen = np.random.default_rng(seed).normal(scale=size, size=COMPONENTS).astype(np.float32)
    fit = READER.fit(seen)
    told = READER.mended(seen, fit).contacts
    _, _, low, high = GEL.limits_array
    assert np.isfinite(told).all()
    assert ((told >= low) & (told <= high)).all()
    found = READER.reading(READER.seen(features(READER, seen), SURE))
    if found.contacts[0].force_n > 0:
        assert found.contacts[0].force_n == pytest.approx(told[:, 2].max(), rel=1e-3, abs=1e-4)
