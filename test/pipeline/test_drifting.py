"""From which stamp on a verdict holds, and how much light a calibration may lose."""

from __future__ import annotations

from dataclasses import replace

from tactile_nodes.model_file import LoadedModel, find_model, load_model
from tactile_nodes.pipeline.drifting import Told, limits_of
from tactile_nodes.sensing.explain.network import NetworkReadout
from tactile_nodes.sensing.judge.drift import DriftMonitor, Limits
from tactile_nodes.sensing.judge.drift_alarm import Level

S = 1_000_000_000
WELL = replace(DriftMonitor().verdict, level=Level.VALID)
WORSE = replace(WELL, level=Level.INVALID)


def test_a_worse_verdict_holds_half_a_second_later_and_a_better_one_at_once() -> None:
    told = Told()
    assert told.holds_from_ns(WORSE, 10 * S, of_rest=False) == 10 * S + S // 2
    assert told.holds_from_ns(WORSE, 11 * S, of_rest=False) == 11 * S + S // 2
    assert told.holds_from_ns(WELL, 12 * S, of_rest=False) == 12 * S


def test_a_verdict_on_a_rest_image_holds_from_that_image_on() -> None:
    assert Told().holds_from_ns(WORSE, 10 * S, of_rest=True) == 10 * S


def test_a_network_that_nobody_contradicts_may_lose_less_light_than_one_with_a_witness() -> None:
    loaded = load_model(find_model('paper'))
    readout = loaded.model.readout
    assert isinstance(readout, NetworkReadout) and readout.witness is not None
    alone = LoadedModel(replace(loaded.model, readout=replace(readout, witness=None)), loaded.card)
    assert limits_of(loaded) == Limits() == limits_of(load_model(find_model('fast')))
    assert limits_of(alone) == replace(Limits(), contrast=(0.9, 0.75))
