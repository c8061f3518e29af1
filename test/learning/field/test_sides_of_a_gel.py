"""A gel with sides, which its description ignores: presses show them."""

import dataclasses

import numpy as np
import pytest
from coarse_table import hertz
from layered_gel import BALL, SENSOR, SIDE, nominal, pressed, quiet_scaling, regions

from tactile_nodes.learning.field.fit import FieldFit, fit_field
from tactile_nodes.learning.transfer.fit import folds_of
from tactile_nodes.sensing.elasticity.regions import Regions

PRESSES = 20
FREE = dataclasses.replace(SENSOR, gel=dataclasses.replace(SENSOR.gel, sides='free'))


@pytest.fixture(scope='module')
def real() -> Regions:
    return Regions(FREE, SIDE, SIDE)


@pytest.fixture(scope='module')
def fit(real: Regions) -> FieldFit:
    """Presses up to 4 mm from the free sides, and a description that says nothing of them."""
    places = np.random.default_rng(4).uniform(-12, 12, (PRESSES, 2))
    terms = real.terms_of_pressure(places, hertz(real.layer, 0.5), np.arange(real.count))
    dataset = pressed((places, terms), nominal(), PRESSES)
    rows = np.arange(PRESSES)
    contacts = dataset.presses[:, [0, 1, 3]].astype(float)
    return fit_field(SENSOR, quiet_scaling(), dataset, rows, folds_of(contacts), BALL)


def test_presses_show_that_the_sides_are_free(fit: FieldFit):
    assert fit.found_sides == 'free'
    assert 'write gel.sides: free into its description' in fit.reason


def test_the_response_is_that_of_a_gel_with_sides_far_better_than_without(fit: FieldFit, real: Regions):
    true, without = (
        np.einsum('rptu,rt->rpu', each.terms_of_patches(np.arange(each.count)), nominal()).reshape(2 * SIDE**2, -1)
        for each in (real, regions())
    )
    assert np.linalg.norm(fit.readout.response - true) < 0.1 * np.linalg.norm(without - true)


def test_tips_are_told_what_the_sides_add(fit: FieldFit, real: Regions):
    terms = real.terms_by_sides(np.arange(real.count))
    assert terms is not None
    assert fit.sides is not None
    true = np.einsum('rptk,rt->krp', terms, nominal())
    assert np.linalg.norm(fit.sides.per_n - true) < 0.1 * np.linalg.norm(true)
