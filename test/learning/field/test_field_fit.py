"""The response of regions from presses: what a gel differs by is found, and no more numbers than presses support."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from layered_gel import BALL, SENSOR, SIDE, Terms, nominal, pressed, pressed_terms, quiet_scaling, uneven
from pressures import hertz

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.field.fit import described, fit_field
from tactile_nodes.sensing.elasticity.regions import Regions
from tactile_nodes.sensing.explain.network import InputScaling


@pytest.fixture(scope='module')
def scaling() -> InputScaling:
    return quiet_scaling()


@pytest.fixture(scope='module')
def terms() -> Terms:
    return pressed_terms()


def fitted(dataset: Dataset, scaling: InputScaling):
    count = len(dataset.presses)
    return fit_field(SENSOR, scaling, dataset, np.arange(count), np.arange(count) % 5, BALL)


def test_a_gel_that_is_softer_as_a_whole_gets_one_gain(scaling: InputScaling, terms: Terms):
    fit = fitted(pressed(terms, 1.25 * nominal(), 30), scaling)
    assert fit.form == 'gain'
    assert fit.gain == pytest.approx(1.25, rel=0.02)
    described_response = described(SENSOR, scaling).readout.response
    assert fit.readout.response == pytest.approx(1.25 * described_response, abs=0.05)


def test_a_gel_as_it_is_described_needs_nothing_more(scaling: InputScaling, terms: Terms):
    fit = fitted(pressed(terms, nominal(), 30), scaling)
    assert fit.form == 'description'
    assert set(fit.misfits) == {'description', 'gain', 'regions'}


def test_regions_with_markers_of_their_own_are_told_by_many_presses(scaling: InputScaling, terms: Terms):
    """Each region's depths count up to half more or less: with sixty presses they are known better than before."""
    shares = uneven()
    fit = fitted(pressed(terms, shares, 60), scaling)
    assert fit.form == 'regions'
    made = Regions(SENSOR, SIDE, SIDE).terms_of_patches(np.arange(SIDE * SIDE))
    true, start = (np.einsum('rptu,rt->rpu', made, each).reshape(2 * SIDE * SIDE, -1) for each in (shares, nominal()))
    assert np.linalg.norm(fit.readout.response - true) < 0.4 * np.linalg.norm(start - true)


AS_DESCRIBED = SENSOR.camera
LOOKING = {
    'aside': dataclasses.replace(AS_DESCRIBED, position_mm=(0.7, -0.5, AS_DESCRIBED.position_mm[2])),
    'tilted': dataclasses.replace(AS_DESCRIBED, tilt_deg=(1.5, -1.0)),
    'turned': dataclasses.replace(AS_DESCRIBED, roll_deg=2.0),
    'longer': dataclasses.replace(AS_DESCRIBED, focal_px_per_rad=1.05 * AS_DESCRIBED.focal_px_per_rad),
}


@pytest.mark.parametrize('looking', LOOKING)
def test_a_camera_that_looks_otherwise_than_described_is_told_by_ten_presses(scaling: InputScaling, looking: str):
    """And the description of the response with it, but for what noise allows."""
    real = Regions(dataclasses.replace(SENSOR, camera=LOOKING[looking]), SIDE, SIDE)
    places = np.random.default_rng(4).uniform(-12, 12, (10, 2))
    made = real.terms_of_pressure(places, hertz(real.layer, 0.5), np.arange(real.count))
    fit = fitted(pressed((places, made), nominal(), 10), scaling)
    true = np.einsum('rptu,rt->rpu', real.terms_of_patches(np.arange(real.count)), nominal())
    start = described(SENSOR, scaling).readout.response
    true = true.reshape(start.shape)
    assert 'beside its description the camera is' in fit.reason
    assert np.linalg.norm(fit.readout.response - true) < 0.35 * np.linalg.norm(start - true)


def test_a_camera_that_looks_as_described_is_left_alone(scaling: InputScaling, terms: Terms):
    assert not fitted(pressed(terms, 1.25 * nominal(), 10), scaling).looks.any()


def test_what_no_press_told_is_stated_less_sure(scaling: InputScaling, terms: Terms):
    none, many = described(SENSOR, scaling).readout, fitted(pressed(terms, uneven(), 60), scaling).readout
    assert none.spread.normal_n(0.0, 1.0) > 1.5 * many.spread.normal_n(0.0, 1.0)


def test_presses_without_a_force_are_refused(scaling: InputScaling, terms: Terms):
    dataset = pressed(terms, nominal(), 20)
    presses = dataset.presses.copy()
    presses[:, 3] = np.nan
    with pytest.raises(DatasetError, match='no press has a force that is known'):
        fitted(dataclasses.replace(dataset, presses=presses), scaling)
