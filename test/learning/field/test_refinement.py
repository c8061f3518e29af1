"""A refinement in torch and in NumPy, and what it keeps of a solved field."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.contact_tables.touch_tables import ready_contacts
from tactile_nodes.learning.field import random_touches
from tactile_nodes.learning.field.calibration import described_model, refinement_of
from tactile_nodes.learning.field.refinement_fit import Samples, fit_refinement, misplaced, shares_of, totals_off
from tactile_nodes.learning.field.refining import refine_described
from tactile_nodes.learning.progress import Progress
from tactile_nodes.model_file import LoadedModel, find_model, load_model
from tactile_nodes.sensing.explain.arrays import readout_arrays, readout_from
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensing.explain.field.refinement import (
    FORCE_TIMES,
    INPUTS,
    KEPT,
    SOLVED,
    Refinement,
    _kept,
    inputs_of,
)
from tactile_nodes.sensing.explain.field.solver import Field
from tactile_nodes.sensing.features import make_encoding
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.geometry import Crop
from tactile_nodes.sensors import load_sensor
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Optics
from tactile_nodes.simulation.scene import truth_of_touch
from tactile_nodes.simulation.touch.table import Touch

pytest.importorskip('torch')
SHAPE = 18, 18


@pytest.fixture(scope='module')
def shipped() -> LoadedModel:
    return load_model(find_model('field'))


def smeared_samples(count: int) -> Samples:
    """Squares of force that a solver would have spread by one patch to all sides; they pull to the right. It would have
    told 0.8 of the total."""
    random, true = np.random.default_rng(5), np.zeros((count, 3, *SHAPE), np.float32)
    for each in true:
        row, col = random.integers(3, 13, 2)
        each[0, row : row + 2, col : col + 2] = 0.25
        each[1] = 0.2 * each[0]
    solved = np.zeros_like(true)
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            solved += np.roll(true, (down, right), (2, 3)) / 9
    inputs = np.zeros((count, INPUTS, *SHAPE), np.float32)
    inputs[:, :3], inputs[:, SOLVED] = FORCE_TIMES * solved, solved[:, 0] > 0
    return Samples(inputs, solved, true, np.ones(count, np.float32), np.full(count, 0.8, np.float32))


@pytest.fixture(scope='module')
def learnt() -> Refinement:
    return fit_refinement(smeared_samples(200), 1, Progress())


def test_it_undoes_the_smearing_that_it_has_seen_and_keeps_total_and_net_shear(learnt: Refinement) -> None:
    samples = smeared_samples(230)
    unseen = range(200, 230)
    refined = np.stack([shares_of(learnt, samples.inputs[k]) for k in unseen])
    before, after = misplaced(samples.solved[unseen], samples.true[unseen]), misplaced(refined, samples.true[unseen])
    assert after < before / 2
    assert refined[:, 0].min() >= 0
    np.testing.assert_allclose(refined.sum(axis=(2, 3)), [[1.0, 0.2, 0.0]] * 30, atol=1e-6)


def test_without_keeping_the_total_it_finds_what_the_solver_does_not_tell() -> None:
    """The net shear stays."""
    network = fit_refinement(smeared_samples(200), 1, Progress(), keeps_total=False)
    samples = smeared_samples(230)
    unseen = Samples(*(getattr(samples, name)[200:] for name in ('inputs', 'solved', 'true', 'total_n', 'solved_n')))
    refined = np.stack([shares_of(network, each) for each in unseen.inputs])
    assert totals_off(unseen.solved, unseen) == pytest.approx(0.2, abs=1e-6)
    assert totals_off(refined, unseen) < 0.02
    assert misplaced(refined, unseen.true) < misplaced(unseen.solved, unseen.true) / 2
    np.testing.assert_allclose(refined[:, 1:].sum(axis=(2, 3)), [[0.2, 0.0]] * 30, atol=1e-6)


def test_the_centre_stays_even_if_the_network_puts_all_force_on_one_patch() -> None:
    """A centre 0.1 patches to the right and 0.3 above: shares of 0.9 and 0.1, and 0.7 and 0.3."""
    before, changed = np.zeros((3, 5, 5)), np.zeros((3, 5, 5))
    before[0, 1:4, 1:4] = np.outer([0.4, 0.5, 0.1], [0.1, 0.7, 0.2])
    changed[0, 2, 2] = 1.0
    kept = _kept(changed.reshape(3, -1), before.reshape(3, -1), 5, KEPT)[0].reshape(5, 5)
    np.testing.assert_allclose(kept[1:3, 2:4], [[0.27, 0.03], [0.63, 0.07]], atol=1e-12)
    assert kept.sum() == pytest.approx(1.0)


def test_forces_stay_within_a_patch_of_the_solved_ones(learnt: Refinement) -> None:
    inputs = smeared_samples(1).inputs[0]
    there, reached = inputs[SOLVED] > 0, shares_of(learnt, inputs)[0] > 0
    rows, cols = np.nonzero(there)
    allowed = np.zeros(SHAPE, bool)
    allowed[rows.min() - 1 : rows.max() + 2, cols.min() - 1 : cols.max() + 2] = True
    assert not (reached & ~allowed).any()


@pytest.mark.parametrize('keeps_total', [True, False])
def test_numpy_gives_the_field_of_the_torch_network(keeps_total: bool) -> None:
    """NumPy computes on the box around a contact what torch computes on the whole surface."""
    import torch

    from tactile_nodes.learning.field.refinement_fit import _layers, _refined

    torch.manual_seed(3)
    layers = _layers()
    for layer in layers:
        layer.reset_parameters()
    samples = smeared_samples(4)
    samples.inputs[:, 3:7] = np.random.default_rng(1).normal(size=(4, 4, *SHAPE))
    with torch.no_grad():
        inputs, solved = torch.from_numpy(samples.inputs), torch.from_numpy(samples.solved)
        shares, total = _refined(layers, inputs, solved, keeps_total=keeps_total)
        expected = (shares * total[:, None, None, None]).numpy()
        arrays = [[part.numpy() for part in layer.parameters()] for layer in layers]
    limits = KEPT if keeps_total else (0.1, 10.0)
    network = Refinement(tuple(kernel for kernel, _ in arrays), tuple(bias for _, bias in arrays), limits)
    for seen, wanted in zip(samples.inputs, expected, strict=True):
        np.testing.assert_allclose(shares_of(network, seen), wanted, atol=2e-6)


def test_regions_at_rest_give_finite_inputs() -> None:
    field = Field(np.zeros((3, 324)), np.array([40]), np.zeros((0, 0)), 0.0, 0.0)
    assert np.isfinite(inputs_of(field, np.zeros((20, 20, 4), np.float32), 0.005, SHAPE)).all()


def test_the_shipped_model_puts_more_of_a_rings_force_into_the_right_bins(shipped: LoadedModel) -> None:
    """The refinement was learnt from other bodies; the total stays as it was."""
    readout, gel = shipped.model.readout, Gel()
    assert isinstance(readout, FieldReadout)
    table = ready_contacts(gel)['ring']
    optics = Optics(gel, contact_table(gel), bodies={'ring': table})
    flow, encoding = make_flow(*shipped.flow), make_encoding(*shipped.encoding)
    crop = Crop.centred(gel.image_width, gel.image_height, *shipped.image_size)
    rest = np.ascontiguousarray(crop.apply(optics.render((), 1)))
    flow.set_reference(rest)
    encoding.set_reference(rest)
    wrong = []
    for number, (x_mm, y_mm) in enumerate(((2.0, -3.0), (-4.0, 1.0), (0.5, 5.0), (-3.0, -4.0))):
        touch = Touch('ring', x_mm, y_mm, float(number), float(table.presses))
        image = np.ascontiguousarray(crop.apply(optics.render((touch,), 2 + number)))
        seen = encoding.encode(flow.displacement(image))
        true = truth_of_touch(touch, table, gel.shear_modulus_mpa, readout.bins)
        found = [each.read(seen.values, seen.confidence) for each in (replace(readout, refinement=None), readout)]
        solved, refined = (each.normal_force_n for each in found)
        wrong.append([float(np.abs(each - true.normal_force_n).sum()) for each in (solved, refined)])
        assert refined.sum() == pytest.approx(solved.sum(), rel=1e-5)
    before, after = np.sum(wrong, axis=0)
    assert after < 0.8 * before


def test_a_model_file_keeps_it_and_refuses_layers_that_do_not_fit(shipped: LoadedModel) -> None:
    readout = shipped.model.readout
    assert isinstance(readout, FieldReadout) and readout.refinement is not None
    arrays, entries = readout_arrays(readout)
    again = readout_from(arrays, entries, readout.bins)
    assert isinstance(again, FieldReadout) and again.refinement is not None
    np.testing.assert_array_equal(again.refinement.kernels[1], readout.refinement.kernels[1])
    assert again.refinement.keeps_total
    of_dots = load_model(find_model('printed_dots')).model.readout
    assert isinstance(of_dots, FieldReadout) and of_dots.refinement is not None
    assert not of_dots.refinement.keeps_total
    for limits in ([2.0, 1.0], [0.0, 1.0], [1.0, float('nan')]):
        with pytest.raises(ValueError, match='total_limits of the refinement must be positive and in order'):
            readout_from(arrays, {**entries, 'total_limits': limits}, readout.bins)
    arrays['refinement.1.kernel'] = arrays['refinement.1.kernel'][:, :5]
    with pytest.raises(ValueError, match='layers of the refinement do not fit'):
        readout_from(arrays, entries, readout.bins)


def test_a_sensor_with_another_gel_or_camera_does_not_take_it_over(shipped: LoadedModel) -> None:
    sensor = load_sensor('simulated')
    assert refinement_of(shipped, sensor) is not None
    thicker = replace(sensor.gel, layers_mm=(1.5, 6.0), markers_mm=(1.5, 7.5))
    assert refinement_of(shipped, replace(sensor, gel=thicker)) is None


def test_shipped_sensors_bring_their_own_whatever_model_they_begin_from(shipped: LoadedModel) -> None:
    dots = load_sensor('printed_dots')
    own, papers = refinement_of(shipped, dots), refinement_of(shipped, load_sensor('simulated'))
    assert own is not None and papers is not None
    assert not np.array_equal(own.kernels[0], papers.kernels[0])
    assert refinement_of(shipped, replace(dots, pattern=replace(dots.pattern, pitch_mm=3.0))) is None


def test_the_refinement_of_a_described_sensor_is_learnt_from_touches_of_its_gel(
    shipped: LoadedModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One body is learnt from, the other one judges."""
    for name, value in (('SEED', 2), ('PLACES', 2)):
        monkeypatch.setattr(random_touches, name, value)
    file = tmp_path / 'dots.safetensors'
    described_model(shipped, load_sensor('printed_dots'), '', file, Progress())
    before = load_model(file)
    assert refine_described(file, 2, 1, Progress()) != before.model_id
    report = load_model(file).card['training']['refinement']
    assert report['bodies'] == 2
    assert 0 < report['misplaced'] < 0.6


def test_an_older_model_that_does_not_name_its_sensor_has_none(shipped: LoadedModel) -> None:
    older = replace(shipped.model, readout=replace(shipped.model.readout, refinement=None))
    assert refinement_of(replace(shipped, model=older, card={}), load_sensor('simulated')) is None


def test_a_field_without_force_stays_as_it_is() -> None:
    """As of a press that is too light to be solved: also if the network would press on all patches."""
    pressing = Refinement((np.zeros((3, INPUTS, 3, 3), np.float32),), (np.ones(3, np.float32),))
    inputs = np.zeros((INPUTS, *SHAPE), np.float32)
    inputs[SOLVED, 5, 5] = 1
    assert not shares_of(pressing, inputs).any()


def test_a_wide_contact_stays_as_it_is(learnt: Refinement) -> None:
    """40 patches with equal force are twice what counts as wide."""
    inputs = np.zeros((INPUTS, *SHAPE), np.float32)
    inputs[0, 5:10, 4:12], inputs[SOLVED, 5:10, 4:12] = FORCE_TIMES / 40, 1
    np.testing.assert_allclose(shares_of(learnt, inputs), inputs[:3] / FORCE_TIMES, atol=1e-7)


def test_a_picture_without_noise_is_read(shipped: LoadedModel) -> None:
    """Only regions under the contact move, so that the frame's own noise is 0."""
    readout = shipped.model.readout
    assert isinstance(readout, FieldReadout)
    forces = np.zeros((3, 324))
    forces[0, [78, 79, 80, 132, 133, 134]] = 0.5
    motion = (readout.response @ forces.reshape(-1)).reshape(-1, 2)
    values = np.zeros_like(readout.scaling.mean)
    values.reshape(-1, 2)[readout.scaling.trusted.reshape(-1) > 0] = np.where(np.abs(motion) > 0.4, motion, 0)
    still = replace(readout, scaling=replace(readout.scaling, mean=np.zeros_like(values)), misfit_limit=100.0)
    sure = np.ones(values.shape[:2], np.float32)
    assert still.weighed(values, sure)[0] == 0
    found = still.read(values, sure)
    assert found.acting is not None and found.acting.explanation == 'field'
    assert found.normal_force_n.sum() == pytest.approx(3.0, rel=0.2)
