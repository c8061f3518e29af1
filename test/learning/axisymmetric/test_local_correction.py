"""What a calibrated readout gets wrong at its own presses is taken away there and nearby, and nowhere else."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from responding_gel import presses

from tactile_nodes.learning.axisymmetric.calibration import Judged
from tactile_nodes.learning.axisymmetric.local import ALIKE_MM, NODES, OF_A_PICTURE, OWN, interpolated, with_local
from tactile_nodes.learning.axisymmetric.regions import Presses
from tactile_nodes.learning.transfer.fit import OtherGel
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout

CENTRE = NODES // 2
ONE = np.array([[0.0, 0.0]])


def pressed(known_gel: AxisymmetricReadout, count: int, seed: int) -> Presses:
    dataset = presses(count, seed=seed, still=0.0)
    return Presses.of(dataset, np.arange(count), known_gel.scaling)


@pytest.fixture
def on_the_left(known_gel: AxisymmetricReadout) -> Presses:
    """Presses on one side of the gel alone."""
    known = pressed(known_gel, 60, seed=2)
    return known.take(np.flatnonzero(known.contacts[:, 0] < -2.0))


def shifted(known: Presses) -> Presses:
    """Each is stated to be 0.2 mm further to the right than it was."""
    return dataclasses.replace(known, contacts=known.contacts + np.array([0.2, 0.0, 0.0]))


def test_one_press_alone_is_believed_by_what_it_shares_with_its_neighbourhood() -> None:
    table = interpolated(ONE, np.array([[0.02]]), np.array([8]), 14.0)
    believed = 1 / (1 + OWN + OF_A_PICTURE / 8)
    assert table[CENTRE, CENTRE, 0] == pytest.approx(0.02 * believed)
    # Nodes are 1 mm apart: five of them are two lengths away, exp(-2) of it.
    assert ALIKE_MM == 2.5
    assert table[CENTRE, CENTRE + 5, 0] == pytest.approx(0.02 * believed * np.exp(-2))
    assert abs(table[0, 0, 0]) < 1e-9


def test_a_press_of_one_picture_is_believed_less_than_one_of_eight() -> None:
    one, eight = (interpolated(ONE, np.array([[1.0]]), np.array([count]), 14.0).max() for count in (1, 8))
    assert one == pytest.approx(1 / (1 + OWN + OF_A_PICTURE))
    assert one < eight


def test_an_error_that_all_presses_share_is_taken_away_between_them(known_gel: AxisymmetricReadout) -> None:
    known = pressed(known_gel, 120, seed=2)
    harder = dataclasses.replace(known, contacts=known.contacts * np.array([1.0, 1.0, 1.02]))  # by 2 %
    pictures = np.full(120, 8)
    local = with_local(known_gel, shifted(harder), pictures)
    found = np.array([[0.5, -0.5, 0.4], [4.0, 3.0, 0.8]])
    moved = local.corrected(found) - with_local(known_gel, known, pictures).corrected(found)
    assert moved[:, 0] == pytest.approx([0.2, 0.2], abs=0.05)
    assert moved[:, 1] == pytest.approx([0.0, 0.0], abs=0.03)
    assert moved[:, 2] / found[:, 2] == pytest.approx([0.02, 0.02], abs=0.006)


def test_far_from_all_presses_nothing_is_added(known_gel: AxisymmetricReadout, on_the_left: Presses) -> None:
    local = with_local(known_gel, shifted(on_the_left), np.ones(len(on_the_left), int))
    far = np.array([[9.5, 0.0, 0.4]])
    assert local.corrected(far) == pytest.approx(known_gel.corrected(far), abs=1e-3)


def test_one_press_at_a_wrong_place_moves_its_neighbourhood_no_more_than_others_are_off(
    known_gel: AxisymmetricReadout,
) -> None:
    known = pressed(known_gel, 60, seed=2)
    contacts = known.contacts.copy()
    contacts[0, 0] += 3.0
    local = with_local(known_gel, dataclasses.replace(known, contacts=contacts), np.full(60, 8))
    assert local.correction.local is not None
    assert np.abs(local.correction.local[..., 0]).max() < 0.2


def test_presses_of_which_nothing_is_seen_leave_the_readout_as_it_is(known_gel: AxisymmetricReadout) -> None:
    known = pressed(known_gel, 5, seed=2)
    blind = dataclasses.replace(known, certainty=np.zeros_like(known.certainty))
    assert with_local(known_gel, blind, np.ones(5, int)) is known_gel


def test_a_table_that_a_readout_has_is_added_to(known_gel: AxisymmetricReadout, on_the_left: Presses) -> None:
    """What presses show is less by what the table takes away already, and far from them the table stays."""
    table = np.tile([0.2, 0.0, 0.0], (NODES, NODES, 1))
    begun = dataclasses.replace(known_gel, correction=dataclasses.replace(known_gel.correction, local=table))
    found = np.array([[-6.0, 0.0, 0.4], [9.5, 0.0, 0.4]])
    pictures = np.full(len(on_the_left), 8)
    true = with_local(known_gel, on_the_left, pictures).corrected(found)
    moved = with_local(begun, shifted(on_the_left), pictures).corrected(found) - true
    assert moved[:, 0] == pytest.approx([0.2, 0.2], abs=0.01)


def test_what_one_gel_gets_wrong_at_its_places_is_not_carried_over_to_another(known_gel: AxisymmetricReadout) -> None:
    first = with_local(known_gel, pressed(known_gel, 60, seed=2), np.full(60, 8))
    assert first.correction.local is not None
    other = OtherGel.of(first, presses(30, seed=3))
    assert other.readout(other.start, known_gel.doubt).correction.local is None


def test_a_calibration_has_the_errors_of_its_presses_taken_away(known_gel: AxisymmetricReadout) -> None:
    dataset = presses(60, seed=5)
    moved = dataset.presses * np.array([1, 1, 1, 0.8], np.float32)  # as a gel that is softer by a fifth
    other = OtherGel.of(known_gel, dataclasses.replace(dataset, presses=moved))
    plain = other.readout(other.whole().response, known_gel.doubt)
    local = other.locally(plain)
    found = Judged.of(plain, dataset, other.rows).found  # before any correction
    truth = moved[other.rows][:, [0, 1, 3]]
    before, after = (np.abs(each.corrected(found) - truth).mean(axis=0) for each in (plain, local))
    assert (after < before).all()
