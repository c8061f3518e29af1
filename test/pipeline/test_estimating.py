"""What the estimator says of a force beside the number: how sure it is, and why it is less sure than usual."""

from __future__ import annotations

import dataclasses
import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tactile_nodes import conversions
from tactile_nodes.errors import ModelError
from tactile_nodes.messages import types
from tactile_nodes.model_file import SENSOR, find_model, load_model, save_model
from tactile_nodes.paths import share_directory
from tactile_nodes.pipeline.estimating import MOST_EARLIER, Estimating
from tactile_nodes.pipeline.judge_force import Judged, judged
from tactile_nodes.pipeline.ready_model import Ready
from tactile_nodes.sensing.explain.measured.readout import ResponseReadout
from tactile_nodes.sensing.explain.model import ForceMap
from tactile_nodes.sensing.explain.splines import value_and_slopes
from tactile_nodes.viewing.force_shapes import pressure_map

FORCE = types.ForceDistribution


def force_map(confidence: float = 1.0, unlikeness: float = 0.3, sigma_n: float = 0.002) -> ForceMap:
    """0.5 N by a model that is 2 mN off as a rule, 2 mN sure."""
    none = np.zeros((9, 9), np.float32)
    return ForceMap(none, 0.5, (0.0, 0.0), confidence, total_sigma_n=sigma_n, unlikeness=unlikeness, nominal_n=0.002)


@pytest.mark.parametrize(
    ('begun_n', 'confidence', 'sigma_n', 'reasons'),
    [
        (0.0, 1.0, 0.002, 0),
        (0.5, 1.0, math.hypot(0.002, 0.05), FORCE.REASON_BEGINNING),
        (0.03, 1.0, math.hypot(0.002, 0.003), 0),
        (0.04, 1.0, math.hypot(0.002, 0.004), FORCE.REASON_BEGINNING),
        (0.0, 0.985, math.hypot(0.002, 0.005 * 0.55), 0),
        (0.0, 0.89, math.hypot(0.002, 0.1 * 0.55), FORCE.REASON_LOW_CONFIDENCE),
    ],
)
def test_what_makes_a_force_more_than_twice_as_unsure_as_usual_is_a_reason(
    begun_n: float, confidence: float, sigma_n: float, reasons: int
) -> None:
    verdict = judged(force_map(confidence), 0, begun_n)
    assert verdict.sigma_n == pytest.approx(sigma_n)
    assert verdict.reasons == reasons
    assert verdict.status == (FORCE.STATUS_DEGRADED if reasons else FORCE.STATUS_OK)


@pytest.mark.parametrize('reason', [FORCE.REASON_LIGHT_CHANGED, FORCE.REASON_BLURRED])
def test_an_altered_picture_is_two_hundredths_of_doubt_and_ok_while_that_is_within_twice_the_usual(reason: int) -> None:
    """Of 0.5 N and the 50 mN that anything may be off by: 11 mN, beside 2 mN that the model states."""
    found, sigma_n = force_map(), math.hypot(0.002, 0.02 * 0.55)
    usual = dataclasses.replace(found, nominal_n=0.006)
    assert judged(usual, reason) == Judged(pytest.approx(sigma_n), FORCE.STATUS_OK, 0)
    assert judged(found, reason) == Judged(pytest.approx(sigma_n), FORCE.STATUS_DEGRADED, reason)


def test_a_network_in_a_noisy_or_blurred_picture_is_never_ok() -> None:
    """Noise of four times the usual made `paper` 0.26 N off. With 30 % more or less light, or a fifth of the
    markers gone, most of its forces stay within twice the nominal error."""
    usual = dataclasses.replace(force_map(), nominal_n=0.5)
    unsure_of = Estimating('paper').now.unsure_of
    assert judged(usual, FORCE.REASON_BLURRED, unsure_of=unsure_of).status == FORCE.STATUS_DEGRADED
    assert judged(usual, FORCE.REASON_LIGHT_CHANGED, unsure_of=unsure_of).status == FORCE.STATUS_OK
    assert not Estimating('fast').now.unsure_of


def test_a_force_that_the_model_itself_is_unsure_of_is_unlike_the_training() -> None:
    assert judged(force_map(sigma_n=0.0041), 0).reasons == FORCE.REASON_UNLIKE_TRAINING


def test_a_picture_of_other_light_and_sharpness_is_a_seventh_of_doubt() -> None:
    both = FORCE.REASON_LIGHT_CHANGED | FORCE.REASON_BLURRED
    verdict = judged(force_map(), both)
    assert verdict.sigma_n == pytest.approx(math.hypot(0.002, 0.15 * 0.55))
    assert (verdict.status, verdict.reasons) == (FORCE.STATUS_DEGRADED, both)


@pytest.mark.parametrize(
    'reason',
    [
        FORCE.REASON_STALE, FORCE.REASON_REST_DOUBTFUL, FORCE.REASON_CALIBRATION_AGEING, FORCE.REASON_UNLIKE_TRAINING,
    ],
)  # fmt: skip
def test_what_nobody_can_put_a_number_to_is_not_ok_by_itself(reason: int) -> None:
    assert judged(force_map(), reason) == Judged(0.002, FORCE.STATUS_DEGRADED, reason)


def test_a_knock_is_a_tenth_of_doubt_and_what_makes_a_force_useless_is_invalid() -> None:
    knocked = judged(force_map(), FORCE.REASON_FOREIGN_MOTION)
    assert knocked.sigma_n == pytest.approx(math.hypot(0.002, 0.055))
    assert knocked.status == FORCE.STATUS_DEGRADED
    for reason in (FORCE.REASON_PICTURE_LOST, FORCE.REASON_CALIBRATION_INVALID, FORCE.REASON_DARK_IMAGE):
        assert judged(force_map(), reason).status == FORCE.STATUS_INVALID


def test_a_model_that_knows_no_uncertainty_is_ok_without_a_reason_only() -> None:
    nan = math.nan
    unsure = dataclasses.replace(force_map(), total_sigma_n=nan, nominal_n=nan)
    assert judged(unsure, 0).status == FORCE.STATUS_OK
    assert judged(unsure, FORCE.REASON_BLURRED).status == FORCE.STATUS_DEGRADED


def test_a_model_by_which_nothing_can_be_read_is_refused_before_its_first_frame(tmp_path: Path) -> None:
    shipped = load_model(find_model('fast'))
    readout = shipped.model.readout
    assert isinstance(readout, ResponseReadout)
    nowhere = replace(readout.response, x=replace(readout.response.x, intervals=99))
    save_model(
        tmp_path / 'nowhere.safetensors', replace(shipped.model, readout=replace(readout, response=nowhere)),
        shipped.card,
    )  # fmt: skip
    with pytest.raises(ModelError, match='holds invalid numbers, so no force can be computed'):
        Estimating(str(tmp_path / 'nowhere.safetensors'))


def test_what_is_unlike_the_training_is_unsure_by_as_much() -> None:
    assert judged(force_map(unlikeness=1.9), 0) == Judged(pytest.approx(0.0038), FORCE.STATUS_OK, 0)
    assert judged(force_map(unlikeness=3.0), 0) == Judged(
        pytest.approx(0.006), FORCE.STATUS_DEGRADED, FORCE.REASON_UNLIKE_TRAINING
    )


def features(of: Estimating, s: float) -> types.FlowFeatures:
    """Those of a press of s near the middle of the gel, without noise."""
    readout, layout = of.now.loaded.model.readout, of.now.inputs.layout
    assert isinstance(readout, ResponseReadout)
    response, scaling = readout.response, readout.scaling
    seen = value_and_slopes(response.axes, response.coefficients, (1.0, -2.0, s))[0] if s else np.zeros(40)
    inputs = readout.likeness.directions.T @ np.linalg.solve(readout.whitening.astype(float), seen)
    shape = (layout.rows, layout.cols, layout.channels)
    used = np.where(scaling.trusted > 0, scaling.trusted, 1.0)[..., None]
    values = inputs.reshape(shape) / used / np.where(scaling.gain > 0, scaling.gain, 1.0) + scaling.mean
    return types.FlowFeatures(
        header=conversions.header(1, 'camera'), rows=layout.rows, cols=layout.cols, channels=layout.channels,
        encoding=layout.encoding, values=values.astype(np.float32).reshape(-1),
        confidence=np.ones(layout.rows * layout.cols, np.float32), image_width=440, image_height=440,
    )  # fmt: skip


def test_the_first_frame_of_a_contact_says_that_it_began() -> None:
    estimating = Estimating('fast')
    forces = [estimating.answer(features(estimating, s), '', 0.85, 0.0) for s in (0.0, 0.5, 0.5, 0.0, 0.4)]
    begun = FORCE.REASON_BEGINNING
    assert [each.reasons for each in forces] == [0, begun, 0, 0, begun]
    assert [each.status for each in forces] == [
        FORCE.STATUS_DEGRADED if each.reasons else FORCE.STATUS_OK for each in forces
    ]
    assert forces[1].total == pytest.approx(0.5, abs=2e-3)
    assert forces[1].total_sigma == pytest.approx(math.hypot(forces[2].total_sigma, 0.05), rel=0.01)


def test_features_of_another_flow_method_give_no_force_though_their_layout_fits() -> None:
    """As of flow_features that was started with another model: each method reads other motion of the same gel."""
    estimating = Estimating('fast')
    pressed = features(estimating, 0.5)
    own = dataclasses.replace(pressed, method=estimating.now.inputs.method)  # type: ignore[type-var]
    assert estimating.answer(own, '', 0.85, 0.0).total == pytest.approx(0.5, abs=2e-3)
    other = dataclasses.replace(pressed, method='dis(preset=medium)')  # type: ignore[type-var]
    said = r'fast needs the flow inverse_.*, but the features come from dis\(preset=medium\); start flow_features and'
    with pytest.raises(ModelError, match=said):
        estimating.answer(other, '', 0.85, 0.0)


def test_a_contact_of_which_nobody_knows_what_was_before_does_not_begin() -> None:
    estimating = Estimating('fast')
    blind = dataclasses.replace(features(estimating, 0.0), reasons=FORCE.REASON_DARK_IMAGE)  # type: ignore[type-var]
    forces = [
        estimating.answer(each, '', 0.85, 0.0) for each in (features(estimating, 0.5), blind, features(estimating, 0.5))
    ]
    assert [each.reasons for each in forces] == [0, FORCE.REASON_DARK_IMAGE, 0]


def test_while_a_force_is_invalid_its_field_is_reported_as_unknown_and_so_is_every_number_of_the_wrench() -> None:
    """Whoever draws the field alone would go on to show the last contact."""
    estimating = Estimating('field')
    layout = estimating.now.inputs.layout
    blind = types.FlowFeatures(
        header=conversions.header(7, 'camera'), rows=layout.rows, cols=layout.cols, channels=layout.channels,
        encoding=layout.encoding, values=np.full(layout.count, np.nan, np.float32),
        confidence=np.ones(layout.rows * layout.cols, np.float32), image_width=440, image_height=440,
    )  # fmt: skip
    force = estimating.answer(blind, '', 0.85, 0.0)
    field = estimating.field(force)
    assert field is not None
    assert (field.status, field.header.stamp) == (FORCE.STATUS_INVALID, force.header.stamp)
    assert (field.rows, field.cols, field.pressure.size, field.shear_sigma.size) == (18, 18, 0, 0)
    assert np.isnan(np.frombuffer(pressure_map(field).data.tobytes(), '<f4')).sum() == 18 * 18
    numbers = force.wrench.force, force.wrench.torque
    assert all(math.isnan(value) for each in numbers for value in (each.x, each.y, each.z))
    assert Estimating('fast').field(force) is None


def test_models_to_go_back_to_are_kept_up_to_a_number() -> None:
    estimating = Estimating('fast')
    models = [replace(estimating.now, name=f'{number}') for number in range(MOST_EARLIER + 5)]
    for model in models:
        estimating.take(model)
    back = []
    for _ in range(MOST_EARLIER):
        back.append(estimating.previous())
        estimating.take(back[-1])
    assert back == models[-2 : -MOST_EARLIER - 2 : -1]
    with pytest.raises(ModelError, match='no model to return to'):
        estimating.previous()


def test_a_force_names_the_file_in_use_also_where_another_holds_the_same_model(tmp_path: Path) -> None:
    estimating = Estimating('fast')
    same = Path(shutil.copy(find_model('fast'), tmp_path / 'copy.safetensors'))
    names = [estimating.answer(features(estimating, 0.5), '', 0.85, 0.0).provenance.model]
    estimating.take(Ready.read(str(same)))
    names.append(estimating.answer(features(estimating, 0.5), '', 0.85, 0.0).provenance.model)
    assert names == ['fast', 'copy']


def test_a_description_that_changed_after_its_model_was_made_is_named(tmp_path: Path) -> None:
    (mine := tmp_path / 'mine.yaml').write_text((share_directory() / 'config/sensors/simulated.yaml').read_text())
    assert Estimating('field', sensor=str(mine)).outdated() == ''
    mine.write_text(mine.read_text().replace('focal_px_per_rad: 290.0', 'focal_px_per_rad: 280.0'))
    message = Estimating('field', sensor=str(mine)).outdated()
    assert 'camera.focal_px_per_rad was 290.0, is 280.0' in message
    assert f'tactile calibrate --sensor {mine} --model field -o mine.safetensors' in message


def test_entries_that_a_description_leaves_out_are_named_too_when_they_change(tmp_path: Path) -> None:
    """Moving the dots or the bins, or shaping the rim, changes entries that are written only if they are not usual."""
    text = (share_directory() / 'config/sensors/simulated.yaml').read_text()
    (mine := tmp_path / 'mine.yaml').write_text(f'{text}\npattern: {{kind: dots, dot_mm: [0.4, -1.1]}}\n')
    message = Estimating('field', sensor=str(mine)).outdated()
    assert 'pattern.dot_mm was [0.0, 0.0], is [0.4, -1.1]' in message
    loaded = load_model(find_model('field'))
    domed = {**loaded.card[SENSOR], 'gel.dome_radius_mm': 80.0}
    save_model(tmp_path / 'domed.safetensors', loaded.model, {**loaded.card, SENSOR: domed})
    mine.write_text(text)
    message = Estimating(str(tmp_path / 'domed.safetensors'), sensor=str(mine)).outdated()
    assert 'gel.dome_radius_mm was 80.0, is 0.0' in message
