"""The force field calibrated by presses of any known body, on a gel half as hard again as its description says."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from body_presses import STIFFER, BodySensor

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.field.alone import transfer_alone
from tactile_nodes.learning.field.body import KnownBody
from tactile_nodes.learning.field.calibration import Pressed
from tactile_nodes.learning.transfer.fit import Transfer
from tactile_nodes.model_file import LoadedModel, find_model, load_model
from tactile_nodes.sensing.explain.field.readout import FieldReadout

PressesOf = tuple[Dataset, np.ndarray]
"""Presses, and what they are: total and centre."""
BODIES = {'square': (2.0, 9.5), 'ring': (2.0, 9.0)}
"""How hard each is pressed (N), and how far from the middle (mm)."""


@pytest.fixture(scope='module')
def model() -> LoadedModel:
    return load_model(find_model('field'))


@pytest.fixture(scope='module')
def pressed(model: LoadedModel) -> dict[str, PressesOf]:
    """Fourteen of each body."""
    return {
        name: BodySensor(name, most_n, cells=48).presses(model, 14, reach_mm, seed)
        for seed, (name, (most_n, reach_mm)) in enumerate(BODIES.items(), 1)
    }


@pytest.fixture(scope='module')
def made(model: LoadedModel, pressed: dict[str, PressesOf]) -> Transfer:
    """A calibration by the presses of the square."""
    return calibrated(model, pressed['square'][0], 'square')


def calibrated(model: LoadedModel, dataset: Dataset, body: str, **more: bool) -> Transfer:
    """Without a try of free and held sides."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr('tactile_nodes.learning.field.fit.UNEXPLAINED', np.inf)
        return transfer_alone(model, dataset, Pressed(body=KnownBody.named(body)), **more)


def off(readout: FieldReadout, dataset: Dataset, acting: np.ndarray) -> tuple[float, float]:
    """Medians of the total's error over the total, and of the distance of the centre (mm)."""
    totals, centres = [], []
    rows = np.flatnonzero(dataset.presses[:, 2] > 0)
    for row, (force_n, *centre) in zip(rows, acting, strict=True):
        found = readout.read(dataset.features[row].astype(np.float32), dataset.confidence[dataset.rest[row]])
        assert found.acting is not None
        assert found.acting.field is not None
        pressure = found.acting.field().pressure_mpa.ravel().astype(float)
        totals.append(abs(found.normal_force_n.sum() / force_n - 1))
        centres.append(np.hypot(*(pressure @ readout.solver.patches.centres_mm / pressure.sum() - centre)))
    return float(np.median(totals)), float(np.median(centres))


def test_presses_of_one_body_calibrate_what_is_reported_of_another(
    model: LoadedModel, made: Transfer, pressed: dict[str, PressesOf]
) -> None:
    """The issue's aim is 2 % and 0.08 mm with a hundred presses; without any these totals are a quarter low."""
    readout = made.readout
    assert isinstance(readout, FieldReadout)
    assert readout.tips is None
    assert made.field.startswith('alone: presses of square contain no information on tips')
    assert made.whole['gain'] == pytest.approx(1 / STIFFER, rel=0.06)
    total, centre = off(readout, *pressed['ring'])
    assert total < 0.05  # 0.052 if presses counted as if the layer were linear
    assert centre < 0.15
    uncalibrated = dataclasses.replace(model.model.readout, tips=None)  # type: ignore[type-var]
    assert off(uncalibrated, *pressed['ring'])[0] > 0.2  # type: ignore[arg-type]


def test_a_square_that_is_taken_for_a_ball_leaves_more_unexplained_and_forces_right_all_the_same(
    model: LoadedModel, made: Transfer, pressed: dict[str, PressesOf]
) -> None:
    wrong = calibrated(model, pressed['square'][0], 'ball:0.6', forced=True)
    assert wrong.misfits[wrong.form] > 1.5 * made.misfits[made.form]
    assert off(wrong.readout, *pressed['ring'])[0] < 0.06  # type: ignore[arg-type]


def test_intervals_of_another_body_hold(made: Transfer, pressed: dict[str, PressesOf]) -> None:
    """Of a normal error 1.645 standard deviations to either side hold nine of ten, and half of them are within 0.67."""
    readout, (dataset, acting) = made.readout, pressed['ring']
    totals, places = [], []
    for row, (force_n, *centre) in zip(np.flatnonzero(dataset.presses[:, 2] > 0), acting, strict=True):
        found = readout.read(dataset.features[row].astype(np.float32), dataset.confidence[dataset.rest[row]])
        totals.append(abs(found.normal_force_n.sum() - force_n) / found.total_sigma_n)
        each = found.contacts[0]
        places += [
            abs(estimated - true) / each.sigma_mm
            for estimated, true in zip((each.x_mm, each.y_mm), centre, strict=True)
        ]
    for times in (np.array(totals), np.array(places)):
        assert (times < 1.645).mean() >= 0.85
        assert np.median(times) > 0.67 / 3


@pytest.mark.parametrize('name', ['ball:0', 'punch:-1', 'ball:nan', 'punch:wide', 'punch:'])
def test_a_radius_that_is_none_is_refused(name: str) -> None:
    with pytest.raises(ConfigurationError, match=f'{name} is not a body: .* followed by a radius in mm above 0'):
        KnownBody.named(name)


def test_a_body_that_is_wider_than_the_gel_is_refused(model: LoadedModel) -> None:
    with pytest.raises(ConfigurationError, match=r'the body punch:17 is \d+ mm wide, but the gel only 32 mm'):
        KnownBody.named('punch:17').require_within(Pressed().known_sensor(model))
