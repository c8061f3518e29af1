"""The readout `field`: what it tells of a frame, and that a file keeps it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tactile_nodes.errors import ModelError
from tactile_nodes.model_file import find_model, load_model, save_model
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensing.explain.field.spread import FieldSpread
from tactile_nodes.sensing.explain.field.sums import covariance_of_tips
from tactile_nodes.sensing.explain.model import FeatureLayout, ForceEstimator, ForceModel
from tactile_nodes.sensing.explain.network import InputScaling
from tactile_nodes.sensing.explain.reading import Contact
from tactile_nodes.sensing.features import Features
from tactile_nodes.sensing.geometry import BinGrid

SIDE, NOISE_PX = 20, 0.004
CARD = {
    'flow': {'name': 'inverse_compositional', 'options': {'rows': SIDE, 'cols': SIDE}},
    'encoding': {'name': 'cartesian_mean', 'options': {'rows': SIDE, 'cols': SIDE}},
    'crop_px': 440, 'gel': {'id': 'made'},
}  # fmt: skip


@pytest.fixture(scope='module')
def readout(response: np.ndarray) -> FieldReadout:
    shape = SIDE, SIDE, 2
    scaling = InputScaling(
        np.zeros(shape, np.float32), np.full(shape, 1 / NOISE_PX, np.float32), np.ones(shape[:2], np.float32)
    )
    return FieldReadout(scaling, response, BinGrid(), NOISE_PX)


def seen(readout: FieldReadout, forces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Features under forces on patches, with noise, and full confidence."""
    motion = readout.response @ forces.reshape(-1)
    motion = motion + NOISE_PX * np.random.default_rng(3).standard_normal(motion.shape)
    return motion.reshape(SIDE, SIDE, 2).astype(np.float32), np.ones((SIDE, SIDE), np.float32)


def edge(readout: FieldReadout) -> np.ndarray:
    """2 N along a line of eight patches, dragged along y by 0.4 N."""
    forces = np.zeros((3, readout.solver.patches.count))
    line = 6 * 18 + np.arange(4, 12)
    forces[0, line], forces[2, line] = 0.25, 0.05
    return forces


def test_a_frame_is_reported_with_wrench_bins_and_fine_map_that_agree(readout: FieldReadout) -> None:
    forces = edge(readout)
    reading = readout.read(*seen(readout, forces))
    acting = reading.acting
    assert acting is not None
    assert acting.explanation == 'field'
    total = float(reading.normal_force_n.sum())
    assert total == pytest.approx(2.0, rel=0.05)
    assert acting.wrench[2] == pytest.approx(-total, rel=1e-4)
    assert acting.wrench[1] == pytest.approx(float(acting.shear_n[..., 1].sum()), abs=1e-4)
    x, y = readout.solver.patches.centres_mm[6 * 18 + np.arange(4, 12)].mean(axis=0)
    assert acting.wrench[3] == pytest.approx(-y * 2.0, rel=0.05)  # (0, 0, -f) at (x, y) turns by (-y f, x f, 0)
    assert acting.wrench[4] == pytest.approx(x * 2.0, abs=0.5)
    assert acting.wrench[5] == pytest.approx(x * 0.4, abs=0.15)
    assert acting.field is not None
    area = float(np.prod(readout.solver.patches.size_mm))
    assert float(acting.field().pressure_mpa.sum()) * area == pytest.approx(total, rel=1e-3)
    assert np.linalg.eigvalsh(acting.wrench_covariance).min() >= 0
    (contact,) = reading.contacts
    assert contact.region is not None
    assert contact.region.length_mm > 3 * contact.region.width_mm
    assert abs(contact.region.angle_rad) < 0.2


def test_a_light_contact_is_no_surer_than_5_mn(readout: FieldReadout) -> None:
    """Of contacts below 0.3 N so much is off by what holds patches down; without it their intervals held 79 %."""
    reading = readout.read(*seen(readout, edge(readout) / 20))
    assert reading.acting is not None
    assert reading.acting.explanation == 'field'
    assert reading.total_sigma_n >= 0.005
    assert all(each.sigma_n >= 0.005 for each in reading.contacts)
    assert reading.acting.wrench_covariance[2, 2] == pytest.approx(reading.total_sigma_n**2)


def test_the_torque_of_a_force_that_may_hide_anywhere_is_surer_across_a_narrow_surface(readout: FieldReadout) -> None:
    """(0, 0, -f) at (x, y) turns by (-y f, x f, 0), shear by x f or -y f about z; the mean of x² over n equal cells of
    a width W about x0 is x0² + W² (1 - 1 / n²) / 12."""
    bins = BinGrid(rows=2, cols=5, width_mm=30.0, height_mm=8.0, centre_mm=(1.0, 0.0))
    narrow = replace(readout, bins=bins, response=np.zeros((len(readout.response), 3 * 4 * 10), np.float32))
    covariance = narrow.nothing(0.1).wrench_covariance
    x, y = 1.0 + 30.0**2 * (1 - 1 / 10**2) / 12, 8.0**2 * (1 - 1 / 4**2) / 12
    assert np.diag(covariance) == pytest.approx(0.01 * np.array([1, 1, 1, y, x, x + y]))
    assert covariance[2, 4] == pytest.approx(-0.01 * 1.0)


@pytest.mark.parametrize('compiled', [False, True])
def test_forces_that_cannot_be_told_apart_are_unknown(readout: FieldReadout, compiled: bool) -> None:
    """In a picture that shows a part of the gel only, forces may all cause much the same motion: that is no error."""
    y, x = np.mgrid[:SIDE, :SIDE] / 2
    motion = np.stack([np.sin(x), np.sin(y)], axis=-1).astype(np.float32)
    strength = 1 + 0.3 * np.random.default_rng(6).random(readout.response.shape[1])
    response = np.outer(motion, strength).astype(np.float32)
    alike = replace(readout, response=response, doubt=1e-3, compiled=compiled)
    reading = alike.read(0.5 * motion, np.ones((SIDE, SIDE), np.float32))
    assert np.isnan(reading.normal_force_n).all()
    assert reading.acting is None


def test_noise_is_explained_by_nothing(readout: FieldReadout) -> None:
    reading = readout.read(*seen(readout, np.zeros((3, readout.solver.patches.count))))
    assert reading.acting is not None
    assert reading.acting.explanation == 'nothing'
    assert not reading.normal_force_n.any()
    assert reading.total_sigma_n > 0


def test_nine_times_the_noise_alone_is_explained_by_nothing_either(readout: FieldReadout) -> None:
    """As in pictures so noisy, one region in fifty is followed wrongly."""
    for seed in range(20):
        values = 9 * NOISE_PX * np.random.default_rng(seed).standard_normal((SIDE, SIDE, 2)).astype(np.float32)
        values[::7, ::7] *= 6
        assert not readout.read(values, np.ones((SIDE, SIDE), np.float32)).normal_force_n.any(), seed


def test_a_calibrated_response_explains_such_noise_by_nothing_either(readout: FieldReadout) -> None:
    """As above, with twice the error where regions are followed wrongly: forces of up to 3 N explained it, if the
    likelihood had to gain only as much as there were patches, and not as there were forces (Akaike)."""
    calibrated, sure = replace(readout, doubt=0.02), np.ones((SIDE, SIDE), np.float32)
    for seed in (11, 14, 15, 19, 41, 47, 50):
        values = 9 * NOISE_PX * np.random.default_rng(seed).standard_normal((SIDE, SIDE, 2)).astype(np.float32)
        values[::7, ::7] *= 12
        assert not calibrated.read(values, sure).normal_force_n.any(), seed


def test_what_so_much_noise_may_hide_is_reported_and_is_not_ok(readout: FieldReadout) -> None:
    """A force is ok while its deviation is at most twice the nominal error. Half the squared motion of a force over the
    noise is what it gains; nothing is reported where that is below 8, or below what the l1 term takes from the best
    contact of 16 patches: 2 times 7 for each. The gel is as likely untouched, so the deviation is 1/√6 of that force
    (uniform from zero up to it, in half of the cases). With twice the noise of motion, as in pictures of four times
    the noise, a gel at rest stays ok."""
    noise = np.random.default_rng(5).standard_normal((SIDE, SIDE, 2)).astype(np.float32) * NOISE_PX
    sure, nominal_n = np.ones((SIDE, SIDE), np.float32), readout.nominal_n(0.0)
    quiet, noisy = readout.read(noise, sure), readout.read(9 * noise, sure)
    assert not noisy.normal_force_n.any()
    assert quiet.total_sigma_n == pytest.approx(nominal_n)
    assert readout.read(2 * noise, sure).total_sigma_n < 2 * nominal_n < noisy.total_sigma_n
    of_patches = readout.response[:, : readout.solver.patches.count].astype(float)
    hidden_n = np.sqrt(2 * 2 * 7 * 16 / (np.square(of_patches).sum(axis=0) / (9 * NOISE_PX) ** 2))
    assert math.sqrt(6) * noisy.total_sigma_n > 0.75 * np.median(hidden_n)
    assert noisy.acting is not None
    assert noisy.acting.wrench_covariance[2, 2] == pytest.approx(noisy.total_sigma_n**2)
    assert noisy.acting.field is not None
    noise_n = noisy.acting.field().pressure_sigma_mpa * np.prod(readout.solver.patches.size_mm)
    assert noise_n == pytest.approx(np.full_like(noise_n, noisy.total_sigma_n), rel=1e-4)


@pytest.mark.parametrize('odd_px', [0.03, 0.2])
def test_a_motion_that_no_force_makes_is_less_sure_than_is_usual(readout: FieldReadout, odd_px: float) -> None:
    """So that forces found with the response of another gel are not ok."""
    values, sure = seen(readout, edge(readout))
    values[:6] += odd_px * np.random.default_rng(1).standard_normal(values[:6].shape).astype(np.float32)
    reading = readout.read(values, sure)
    total_n = float(reading.normal_force_n.sum())
    assert reading.unlikeness > 1
    assert reading.total_sigma_n > 2 * readout.nominal_n(total_n)
    assert reading.total_sigma_n > 0.25 * total_n
    assert reading.contacts[0].sigma_mm >= 0.2


@pytest.mark.parametrize(('row', 'usual'), [(17, False), (12, True)])
def test_a_contact_that_little_of_the_picture_shows_is_less_sure_than_is_usual(
    readout: FieldReadout, row: int, usual: bool
) -> None:
    """On the outermost patches; five further inside regions all around tell of it, pressed and dragged as hard."""
    forces = np.roll(edge(readout).reshape(3, 18, 18), row - 6, axis=1)
    reading = readout.read(*seen(readout, forces))
    assert reading.normal_force_n.any()
    assert (reading.total_sigma_n <= 2 * readout.nominal_n(float(reading.normal_force_n.sum()))) == usual


def test_forces_that_show_half_as_much_are_off_by_three_fifths() -> None:
    assert FieldSpread().out_of_sight(1.0).normal_n(0.0, 1.0) == pytest.approx(0.6, abs=0.001)
    assert FieldSpread().out_of_sight(0.0) == FieldSpread()


def test_a_noisy_picture_is_less_sure_and_hardly_further_off(readout: FieldReadout) -> None:
    """Four times the noise in all regions."""
    values, sure = seen(readout, edge(readout))
    plain = readout.read(values, sure)
    noisy = readout.read(
        values + 4 * NOISE_PX * np.random.default_rng(1).standard_normal(values.shape).astype(np.float32), sure
    )
    assert noisy.total_sigma_n > plain.total_sigma_n
    assert float(noisy.normal_force_n.sum()) == pytest.approx(2.0, rel=0.1)


def test_a_file_keeps_it(readout: FieldReadout, tmp_path: Path) -> None:
    layout = FeatureLayout('cartesian_mean', SIDE, SIDE, 2)
    file = tmp_path / 'field.safetensors'
    save_model(file, ForceModel(layout, BinGrid(), readout), CARD)
    loaded = load_model(file).model
    values, sure = seen(readout, edge(readout))
    estimate = ForceEstimator(loaded).predict(Features('cartesian_mean', values, sure))
    assert estimate.total_n == pytest.approx(float(readout.read(values, sure).normal_force_n.sum()), rel=5e-3)
    assert estimate.acting is not None


def test_a_response_of_other_bins_is_refused(readout: FieldReadout) -> None:
    with pytest.raises(ModelError, match='does not fit'):
        readout.require_fit(2 * SIDE * SIDE, BinGrid(8, 8))


@pytest.mark.parametrize('times', [1.0, 3.0])
def test_a_tip_in_a_noisier_picture_is_still_read_as_a_tip_and_less_surely(times: float) -> None:
    """Motion as the shipped response of a tip has it, 0.5 N at (4, -3) mm, with once and three times the noise."""
    shipped = load_model(find_model('field')).model.readout
    assert isinstance(shipped, FieldReadout)
    assert shipped.tips is not None
    known = shipped.tips.scaling.trusted.reshape(-1) > 0
    values = shipped.tips.scaling.mean.reshape(-1, 2).copy()
    values[known] += shipped.tips.response.motion(np.array([[4.0, -3.0, 0.5]]))[0]
    noise = times / shipped.tips.scaling.gain.reshape(-1, 2)[known]
    values[known] += noise * np.random.default_rng(4).standard_normal(noise.shape)
    reading = shipped.read(values.reshape(SIDE, SIDE, 2), np.ones((SIDE, SIDE), np.float32))
    assert reading.acting is not None
    assert reading.acting.explanation == 'tips'
    (contact,) = reading.contacts
    assert contact.force_n == pytest.approx(0.5, abs=0.03)
    assert contact.sigma_n == pytest.approx(times * 0.003, rel=0.7)


def test_a_tip_has_no_shear_that_is_known_exactly() -> None:
    """0.5 N at (4, -3) mm: off by hypot(0.8 * 12, 1.2 % of 500) = 11.3 mN along x and y; about z by 5 mm of that."""
    found = covariance_of_tips((Contact(4.0, -3.0, 0.5, 0.1, 0.01),), FieldSpread())
    squared = 0.0096**2 + 0.006**2
    assert np.diag(found) == pytest.approx(
        [squared, squared, 0.01**2, 0.03**2 + 0.05**2, 0.04**2 + 0.05**2, 25 * squared]
    )
    assert (found[0, 5], found[1, 5]) == pytest.approx((3 * squared, 4 * squared))
    assert np.linalg.eigvalsh(found).min() > 0
