"""A gel with sides, which its description ignores: presses show them."""

import dataclasses

import numpy as np
import pytest
from layered_gel import BALL, SENSOR, SIDE, nominal, pressed_gel, quiet_scaling, regions, response_of

from tactile_nodes.learning.field.fit import described, fit_field
from tactile_nodes.learning.transfer.fit import folds_of
from tactile_nodes.sensing.elasticity.regions import Regions
from tactile_nodes.sensors import Sensor

PRESSES = 20
FREE = dataclasses.replace(SENSOR, gel=dataclasses.replace(SENSOR.gel, sides='free'))


def test_presses_show_that_the_sides_are_free_and_what_they_add_to_every_contact_and_to_tips():
    """They come up to 4 mm near the sides. The description says nothing of these."""
    real = Regions(FREE, SIDE, SIDE)
    known, dataset = np.arange(real.count), pressed_gel(real, PRESSES)
    fold = folds_of(dataset.presses[:, [0, 1, 3]].astype(float))
    fit = fit_field(SENSOR, quiet_scaling(), dataset, np.arange(PRESSES), fold, BALL)
    assert fit.found_sides == 'free'
    assert 'write gel.sides: free into its description' in fit.reason
    true, without = response_of(real), response_of(regions())
    assert np.linalg.norm(fit.readout.response - true) < 0.1 * np.linalg.norm(without - true)
    terms = real.terms_by_sides(known)
    assert terms is not None
    assert fit.sides is not None
    by_sides = np.einsum('rptk,rt->krp', terms, nominal())
    assert np.linalg.norm(fit.sides.per_n - by_sides) < 0.1 * np.linalg.norm(by_sides)


@pytest.mark.parametrize(
    ('misfits', 'sides'),
    [
        ({'ignored': 1.05, 'free': 0.5}, ''),  # nothing is left to explain
        ({'ignored': 2.0, 'free': 1.7}, 'free'),
        ({'ignored': 2.0, 'free': 1.9, 'held': 1.7}, 'held'),
        ({'ignored': 2.0, 'free': 1.9, 'held': 1.9}, ''),
    ],
)
def test_sides_are_told_of_only_where_they_leave_less_unexplained(
    monkeypatch: pytest.MonkeyPatch, misfits: dict[str, float], sides: str
):
    alone = described(SENSOR, quiet_scaling())

    def fitted(sensor: Sensor, *_: object, **__: object) -> object:
        return dataclasses.replace(alone, misfits={'gain': misfits[sensor.gel.sides]})

    monkeypatch.setattr('tactile_nodes.learning.field.fit._fit_described', fitted)
    rows, dataset = np.arange(PRESSES), pressed_gel(regions(), PRESSES)
    fit = fit_field(SENSOR, quiet_scaling(), dataset, rows, rows % 5, BALL)
    assert fit.found_sides == sides
    assert fit.misfits['gain'] == misfits[sides or 'ignored']
