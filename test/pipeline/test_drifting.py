"""From which stamp on a verdict holds, and how much light a calibration may lose."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from tactile_nodes.conversions import calibration_fields
from tactile_nodes.messages import types
from tactile_nodes.model_file import LoadedModel, find_model, load_model, save_model
from tactile_nodes.pipeline.drifting import Calibrated, VerdictStamps, limits_of
from tactile_nodes.sensing.explain.network import NetworkReadout
from tactile_nodes.sensing.judge.drift import DriftMonitor, Limits
from tactile_nodes.sensing.judge.drift_alarm import Level

S = 1_000_000_000
WELL = replace(DriftMonitor().verdict, level=Level.VALID)
WORSE = replace(WELL, level=Level.INVALID)


def test_a_worse_verdict_holds_half_a_second_later_and_a_better_one_at_once() -> None:
    stamps = VerdictStamps()
    assert stamps.holds_from_ns(WORSE, 10 * S, of_rest=False) == 10 * S + S // 2
    assert stamps.holds_from_ns(WORSE, 11 * S, of_rest=False) == 11 * S + S // 2
    assert stamps.holds_from_ns(WELL, 12 * S, of_rest=False) == 12 * S


def test_a_verdict_on_a_rest_image_holds_from_that_image_on() -> None:
    assert VerdictStamps().holds_from_ns(WORSE, 10 * S, of_rest=True) == 10 * S


def test_a_network_that_nobody_contradicts_may_lose_less_light_than_one_with_a_novelty_check() -> None:
    loaded = load_model(find_model('paper'))
    readout = loaded.model.readout
    assert isinstance(readout, NetworkReadout) and readout.novelty_check is not None
    alone = LoadedModel(replace(loaded.model, readout=replace(readout, novelty_check=None)), loaded.card)
    assert limits_of(loaded) == Limits() == limits_of(load_model(find_model('fast')))
    assert limits_of(alone) == replace(Limits(), contrast=(0.9, 0.75))


def test_of_a_model_from_a_description_no_calibration_is_said_to_be_valid() -> None:
    described, calibrated = replace(WELL, calibrated=False), WELL
    assert described.text.startswith('not calibrated: the model was made from a description')
    assert calibration_fields(described)['level'] == types.CalibrationState.LEVEL_UNCALIBRATED
    assert calibration_fields(calibrated)['level'] == types.CalibrationState.LEVEL_VALID


def test_a_model_from_a_description_is_warned_of_as_any_other() -> None:
    worse = replace(WORSE, calibrated=False)
    assert worse.text == 'invalid'
    assert calibration_fields(worse)['level'] == types.CalibrationState.LEVEL_INVALID


def test_which_model_is_in_use_says_whether_anything_was_calibrated(tmp_path: Path) -> None:
    shipped = load_model(find_model('fast'))
    file = tmp_path / 'described.safetensors'
    described_id = save_model(file, shipped.model, {**shipped.card, 'data': {'origin': 'description'}})
    calibrated = Calibrated(str(file), simulated=False)
    calibrated.use_model(types.Provenance(model='described', model_id=described_id))
    assert not calibrated.is_calibrated
    calibrated.use_model(types.Provenance(model='fast', model_id=shipped.model_id))
    assert calibrated.is_calibrated


def test_another_model_from_a_description_is_known_by_what_its_forces_say() -> None:
    """As when a live launch goes back from a calibration to the description that it was made from."""
    calibrated = Calibrated('fast', simulated=False)
    other = types.Provenance(model='described', model_id='0123456789ab')
    calibrated.use_model(other)
    assert not calibrated.use_force(types.ForceDistribution(provenance=other))
    assert calibrated.is_calibrated
    unsure = types.ForceDistribution(provenance=other, reasons=types.ForceDistribution.REASON_UNCALIBRATED)
    assert calibrated.use_force(unsure)
    assert not calibrated.is_calibrated
    assert not calibrated.use_force(unsure)  # it is news only once
