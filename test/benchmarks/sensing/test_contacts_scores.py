"""Scores of contacts: the truth scores as such, and a force one bin off is all misplaced."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from benchmarks.contacts.cases import Case
from benchmarks.contacts.page import page
from benchmarks.contacts.scores import Score, by_family, score, summed
from tactile_nodes import conversions
from tactile_nodes.contact_tables.touch_tables import ready_contacts
from tactile_nodes.messages import types
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.scene import truth_of_touch
from tactile_nodes.simulation.touch.table import Touch

GEL, BINS = Gel(), BinGrid()


@pytest.fixture(scope='module')
def case() -> Case:
    table = ready_contacts(GEL)['ring']
    return Case('ring', 0, Touch('ring', 5.0, -1.0, 0.3, float(table.stages - 1)), table)


def force_of(case: Case, roll: int = 0) -> types.ForceDistribution:
    """What the simulator's camera says of a contact, its normal forces moved along x by some bins."""
    truth = truth_of_touch(case.touch, case.table, GEL.shear_modulus_mpa, BINS)
    moved = dataclasses.replace(truth, normal_force_n=np.roll(truth.normal_force_n, roll, axis=1))
    return types.ForceDistribution(**conversions.truth_fields(moved, BINS))


def scored(case: Case, force: types.ForceDistribution) -> Score:
    return score(case, force, None, GEL, (5.0, 4.0), 0.1)


def test_the_truth_is_without_error(case: Case):
    found = scored(case, force_of(case))
    assert found.misplaced == pytest.approx(0.0, abs=1e-5)
    assert found.total_n == pytest.approx(0.0, abs=1e-5)
    assert found.shear == pytest.approx(0.0, abs=1e-5)
    assert found.centre_mm < 0.6  # of the bins' middles


def test_a_force_that_is_elsewhere_is_all_misplaced(case: Case):
    found = scored(case, force_of(case, roll=-4))
    assert found.misplaced == pytest.approx(1.0, abs=0.02)
    assert found.total_n == pytest.approx(0.0, abs=1e-5)
    assert found.centre_mm == pytest.approx(4 * 32 / 9, abs=0.6)


def test_the_page_tells_of_all_models_and_of_what_was_to_be_reached(case: Case):
    found = [scored(case, force_of(case)), scored(case, force_of(case, roll=1))]
    models = {name: {**summed(found), 'families': by_family(found)} for name in NAMES}
    result = {
        'command': 'tactile bench contacts', 'models': models, 'seed': 1, 'dis_ms': 10.0,
        'broad': {}, 'disturbed': {}, 'commit': 'c0ffee', 'versions': {},
        'machine': {'processor': 'a processor', 'cores_allowed': 2, 'load_before': [0.1]},
    }  # fmt: skip
    text = page(result)
    assert all(name in text for name in NAMES)
    assert '| ring' in text
    assert '0.50; 0.50 (compiled 0.50; 0.50)' in text  # CPU: 5 ms of 10
    assert '1.25' in text  # and 4 ms alone


NAMES = 'field, 100 presses', 'field, 10 presses', 'field, no presses', 'field, 100 presses, compiled'
