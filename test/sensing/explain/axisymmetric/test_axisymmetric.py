"""An axisymmetric response: what follows from symmetry, slopes, and what a readout makes of it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tactile_nodes.errors import ModelError
from tactile_nodes.sensing.explain.arrays import readout_arrays, readout_from
from tactile_nodes.sensing.explain.axisymmetric.correction import Correction
from tactile_nodes.sensing.explain.axisymmetric.prior import ErrorPrior
from tactile_nodes.sensing.explain.axisymmetric.radial_smear import RadialSmear
from tactile_nodes.sensing.explain.axisymmetric.readout import DOUBT_MM, AxisymmetricReadout
from tactile_nodes.sensing.explain.axisymmetric.response import DISTANCES, AxisymmetricResponse
from tactile_nodes.sensing.explain.network import InputScaling
from tactile_nodes.sensing.explain.splines import SplineAxis
from tactile_nodes.sensing.explain.uncertainty import Calibration
from tactile_nodes.sensing.geometry import BinGrid

HARDEST_N = 1.0
NOISE_PX = 0.003


def response(rows: int = 8, cols: int = 8) -> AxisymmetricResponse:
    """Motion away from the press that falls off over some millimetres, seen alike by regions 4 mm apart."""
    along, across = (np.linspace(-14.0, 14.0, count) for count in (cols, rows))
    places = np.stack(np.meshgrid(along, across), axis=-1).reshape(-1, 2)
    knots = np.linspace(DISTANCES.low, DISTANCES.high, DISTANCES.count)
    mm = np.sinh(knots)
    lateral = -np.outer(mm * np.exp(-mm / 4.0), np.ones(6))
    vertical = np.outer(np.exp(-mm / 3.0), np.ones(6))
    couplings = np.concatenate([np.tile(np.eye(2), (rows * cols, 1, 1)), places[:, :, None] / 20], axis=2)
    return AxisymmetricResponse(np.stack([lateral, vertical]), 1, HARDEST_N, places, couplings)


def readout(**changes: object) -> AxisymmetricReadout:
    scaling = InputScaling(
        np.zeros((8, 8, 2), np.float32), np.full((8, 8, 2), 1 / NOISE_PX, np.float32), np.ones((8, 8), np.float32), 0.1
    )
    made = AxisymmetricReadout(
        scaling,
        response(),
        np.full(len(DOUBT_MM), 0.02),
        Correction.none(14.0, HARDEST_N),
        BinGrid(),
        Calibration(misfit_limit=3.0, least_gain=20.0),
        most_contacts=2,
    )
    return dataclasses.replace(made, **changes)  # type: ignore[arg-type]


def seen(contacts: list[tuple[float, float, float]], seed: int = 1) -> np.ndarray:
    """Features of the contacts, with noise."""
    motion = response().motion(np.array(contacts)).sum(axis=0).reshape(8, 8, 2)
    noisy: np.ndarray = (motion + NOISE_PX * np.random.default_rng(seed).normal(size=motion.shape)).astype(np.float32)
    return noisy


SURE = np.ones((8, 8), np.float32)


def test_motion_turns_with_the_press() -> None:
    """Of a square of regions that all see lateral motion alike, a quarter turn of the press turns the field."""
    plain = dataclasses.replace(response(), couplings=np.concatenate([
        np.tile(np.eye(2), (64, 1, 1)), np.zeros((64, 2, 1))], axis=2))  # fmt: skip
    one, turned = (plain.motion(np.array([[*place, 0.5]]))[0].reshape(8, 8, 2) for place in ((5.0, 2.0), (-2.0, 5.0)))
    # (x, y) to (-y, x): what was in row i and column j comes to row j and column 7 - i.
    expected = np.stack([-one[..., 1], one[..., 0]], axis=-1).transpose(1, 0, 2)[:, ::-1]
    assert turned == pytest.approx(expected, abs=1e-9)


def test_without_force_nothing_moves() -> None:
    assert response().motion(np.array([[1.0, 2.0, 0.0]])) == pytest.approx(0.0)


def test_right_under_the_press_lateral_motion_has_no_direction() -> None:
    plain = response()
    here = plain.places[27]
    moved = plain.motion(np.array([[*here, 0.5]]))[0, 27]
    vertical_only = plain.couplings[27, :, 2] * plain.columns(np.array([[*here, 0.5]]))[0, 27, 2]
    assert moved == pytest.approx(vertical_only, abs=1e-2)


def test_a_gel_twice_as_soft_shows_at_half_the_force_what_the_known_one_does() -> None:
    soft = dataclasses.replace(response(), softness=2.0)
    known = response().motion(np.array([[3.0, 4.0, 0.8]]))
    assert soft.motion(np.array([[3.0, 4.0, 0.4]])) == pytest.approx(known)
    assert soft.highest_n == pytest.approx(HARDEST_N / 2)


def test_splines_of_many_values_are_those_of_each() -> None:
    axis, values = SplineAxis(0.0, 3.0, 5), np.array([0.0, 0.7, 2.9, 3.0])
    first, weights = axis.weights_of(values)
    for number, value in enumerate(values.tolist()):
        one, pair = axis.weights(value)
        assert first[number] == one
        assert weights[:, number] == pytest.approx(pair)


def test_a_press_is_found_where_it_is() -> None:
    found = readout().read(seen([(3.3, -5.2, 0.6)]), SURE)
    contact = found.contacts[0]
    assert (contact.x_mm, contact.y_mm, contact.force_n) == pytest.approx((3.3, -5.2, 0.6), abs=0.03)
    assert found.normal_force_n.sum() == pytest.approx(contact.force_n, rel=1e-5)
    assert found.unlikeness < 1


def test_two_presses_are_told_apart() -> None:
    found = readout().read(seen([(-8.0, -6.0, 0.7), (7.0, 6.0, 0.4)]), SURE)
    assert [each.force_n for each in found.contacts] == pytest.approx([0.7, 0.4], abs=0.05)


def test_steps_end_where_a_second_contact_explains_nothing_more(monkeypatch: pytest.MonkeyPatch) -> None:
    compare, compared = AxisymmetricReadout._compare, []
    monkeypatch.setattr(AxisymmetricReadout, '_compare', lambda *given: compared.append(1) or compare(*given))
    noisier = (2 * NOISE_PX * np.random.default_rng(1).normal(size=(8, 8, 2))).astype(np.float32)
    tried = readout(calibration=Calibration(misfit_limit=1.0, least_gain=20.0))
    contacts = tried.read(seen([(3.3, -5.2, 0.6)]) + noisier, SURE).contacts
    assert (contacts[0].x_mm, contacts[0].y_mm) == pytest.approx((3.3, -5.2), abs=0.06)
    assert len(compared) <= 6  # three for a contact that is there, and hardly more for one that is not


def test_noise_alone_is_no_contact() -> None:
    noise = (NOISE_PX * np.random.default_rng(3).normal(size=(8, 8, 2))).astype(np.float32)
    assert readout().read(noise, SURE).normal_force_n.sum() == 0


def test_regions_that_cannot_be_followed_have_no_say() -> None:
    features, confidence = seen([(3.3, -5.2, 0.6)]), SURE.copy()
    features[0, :4] = 9.0
    confidence[0, :4] = 0.0
    contact = readout().read(features, confidence).contacts[0]
    assert (contact.x_mm, contact.y_mm, contact.force_n) == pytest.approx((3.3, -5.2, 0.6), abs=0.03)


def test_with_hardly_any_region_left_nothing_is_said() -> None:
    confidence = np.zeros((8, 8), np.float32)
    confidence[0] = 1.0
    assert np.isnan(readout().read(seen([(3.3, -5.2, 0.6)]), confidence).normal_force_n).all()


def test_motion_that_no_contact_makes_is_unlike_anything_known() -> None:
    columns = np.full((8, 8, 2), 0.5, np.float32)
    columns[:, ::2] = -0.5
    assert readout().read(columns, SURE).unlikeness > 1


def test_a_camera_that_moves_as_a_whole_is_no_force() -> None:
    found = readout().read(np.full((8, 8, 2), 0.5, np.float32), SURE)
    assert found.unlikeness < 1 and not found.normal_force_n.any()


def test_a_camera_that_gives_way_under_a_press_changes_neither_its_force_nor_its_place() -> None:
    """By a shift, a turn and a growth, each as large as what the press moves the median region."""
    press = [(3.3, -5.2, 0.6)]
    across = np.linspace(-1.0, 1.0, 8)
    x, y = np.meshgrid(across, across)
    still, size_px = seen(press), float(np.median(np.abs(response().motion(np.array(press)))))
    moved = still + size_px * np.stack([1.0 - y + x, 0.5 + x + y], axis=-1).astype(np.float32)
    (one, *_), (other, *_) = readout().read(still, SURE).contacts, readout().read(moved, SURE).contacts
    assert (other.x_mm, other.y_mm, other.force_n) == pytest.approx((one.x_mm, one.y_mm, one.force_n), abs=2e-3)


def test_a_light_press_is_found_although_the_camera_moves_all_regions_by_more() -> None:
    random = np.random.default_rng(0)
    for press in [(*random.uniform(-9, 9, 2).tolist(), random.uniform(0.05, 0.4)) for _ in range(20)]:
        found = readout().read(seen([press]) + np.array([0.3, 0.1], np.float32), SURE).contacts[0]
        assert (found.x_mm, found.y_mm) == pytest.approx(press[:2], abs=0.2)
        assert found.force_n == pytest.approx(press[2], abs=0.01)


def test_a_correction_is_added_in_the_known_gels_units() -> None:
    """0.1 mm to the right everywhere and 2 % more force; of a gel that is 1.5 times as wide, 0.15 mm."""
    terms = np.zeros_like(Correction.none(14.0, 1.0).terms)
    terms[0] = 0.1, 0.0, 0.02
    corrected = readout(correction=Correction(terms, 14.0, 1.0)).corrected(np.array([[1.0, 2.0, 0.5]]))
    assert corrected[0] == pytest.approx([1.1, 2.0, 0.51])
    wide = readout(correction=Correction(terms, 14.0, 1.0), response=dataclasses.replace(response(), width=1.5))
    assert wide.corrected(np.array([[1.0, 2.0, 0.5]]))[0] == pytest.approx([1.15, 2.0, 0.51])


def test_a_readout_comes_back_from_its_arrays() -> None:
    """With all that a calibration may add to it; 16 bit floats are exact to a two-thousandth."""
    prior = ErrorPrior((10, 40), np.stack([np.full((20, 3), 3.0), np.full((20, 3), 1.0)]))
    unsure = np.full((64, 2, 5, 1), 0.1)
    made = readout(
        prior=prior,
        correction=dataclasses.replace(readout().correction, local=np.tile([0.1, -0.2, 0.04], (3, 3, 1))),
        response=dataclasses.replace(response(), smear=RadialSmear(-0.4, 0.1), unsure=unsure),
    )
    again, features = readout_from(*readout_arrays(made), BinGrid()), seen([(3.3, -5.2, 0.6)])
    assert again.read(features, SURE).contacts[0].force_n == pytest.approx(
        made.read(features, SURE).contacts[0].force_n, abs=1e-4
    )
    assert again.correction.local == pytest.approx(made.correction.local)
    assert again.prior.presses == prior.presses
    assert again.prior.terms == pytest.approx(prior.terms)
    assert again.response.smear == RadialSmear(-0.4, 0.1)
    assert again.response.unsure == pytest.approx(unsure, rel=5e-4)


def test_a_file_of_before_has_none_of_what_was_added_later() -> None:
    arrays, entries = readout_arrays(readout())
    assert not {'local', 'carried', 'unsure'} & arrays.keys()
    del entries['streak']
    again = readout_from(arrays, entries, BinGrid())
    assert (again.correction.local, again.prior, again.response.unsure) == (None, None, None)
    assert again.response.smear == RadialSmear()


def test_another_number_of_features_is_refused() -> None:
    with pytest.raises(ModelError, match='does not fit 200 features'):
        readout().require_fit(200, BinGrid())
