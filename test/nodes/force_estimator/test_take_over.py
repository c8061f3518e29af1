"""Another model takes over in the running node: no frame is lost, every force names its model, and undo returns."""

from __future__ import annotations

import dataclasses
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from feeding import START_NS, features, given, run, taken

from tactile_nodes import model_file
from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.parameters import to_message
from tactile_nodes.bus.protocol import Publisher, Qos
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.topics import Topic
from tactile_nodes.clock import SteppedClock
from tactile_nodes.messages import services, stamp_ns, types
from tactile_nodes.nodes.force_estimator import ForceEstimatorNode
from tactile_nodes.pipeline.methods import describe_flow
from tactile_nodes.sensing.explain.network import NetworkReadout
from tactile_nodes.sensing.flow.choice import make_flow

PERIOD_NS = 16_666_667


def changed(file: Path, name: str, card: dict[str, Any], bias: float = 0.25) -> Path:
    """The model of a file with another answer and another card beside it."""
    loaded = model_file.load_model(file)
    old = loaded.model.readout
    assert isinstance(old, NetworkReadout)
    biases = (*old.network.biases[:-1], np.full(9, bias / 9, np.float32))
    readout = dataclasses.replace(old, network=dataclasses.replace(old.network, biases=biases))
    model_file.save_model(
        file.with_name(f'{name}.safetensors'),
        dataclasses.replace(loaded.model, readout=readout),
        {**{key: loaded.card[key] for key in ('flow', 'encoding', 'crop_px', 'gel')}, **card},
    )
    return file.with_name(f'{name}.safetensors')


@pytest.fixture
def calibrated(small_model: Path) -> Path:
    """A calibration of the small model for another gel, which answers 0.25 N."""
    source = {'model': small_model.name, 'model_id': model_file.load_model(small_model).model_id}
    card = {'gel': {'id': 'second'}, 'data': {'origin': 'calibration'}, 'source': source}
    return changed(small_model, 'calibrated', card)


class Live:
    """A force estimator with frames coming in, 60 a second by their stamps."""

    def __init__(self, bus: InProcessBus, clock: SteppedClock, model: Path, source: Publisher) -> None:
        self.bus, self.source, self.sent = bus, source, 0
        self.node = ForceEstimatorNode(bus, given(f'model:={model}'), clock)

    def frame(self) -> None:
        method = describe_flow(make_flow('dis', {}))
        self.source.publish(features(START_NS + self.sent * PERIOD_NS, method=method))
        self.sent += 1
        run(self.node)

    def call(self, service: str, type_name: str, request: Any) -> Any:
        """The answer of a call that another thread makes, while frames go on coming in."""
        return self.calls(service, type_name, request, 1)[0]

    def calls(self, service: str, type_name: str, request: Any, count: int) -> list[Any]:
        """The answers of calls that so many threads make at once."""
        answers: list[Any] = []
        name = f'/force_estimator/{service}'
        callers = [
            threading.Thread(target=lambda: answers.append(self.bus.call(name, type_name, request)))
            for _ in range(count)
        ]
        for caller in callers:
            caller.start()
        time.sleep(0.3 * (count > 1))  # so that all wait for the node, which runs only in `frame`
        while any(caller.is_alive() for caller in callers):
            self.frame()
        return answers

    def set_model(self, file: Path | str) -> types.SetParametersResult:
        entry = types.Parameter(name='model', value=to_message(str(file)))
        request = types.SetParameters_Request(parameters=[entry])
        result: types.SetParametersResult = self.call('set_parameters', services.SET_PARAMETERS, request).results[0]
        return result

    def undo(self) -> types.Trigger_Response:
        answer: types.Trigger_Response = self.call('undo_calibration', services.TRIGGER, types.Trigger_Request())
        return answer


@pytest.fixture
def live(bus: InProcessBus, clock: SteppedClock, publisher: Callable[[Topic], Publisher], small_model: Path) -> Live:
    return Live(bus, clock, small_model, publisher(topics.FLOW_FEATURES))


@pytest.fixture
def forces(bus: InProcessBus) -> Subscription:
    name = f'/{topics.FORCE_DISTRIBUTION.name}'
    return bus.subscribe(name, topics.FORCE_DISTRIBUTION.type_name, Qos('queue', 100_000))


def test_every_frame_across_a_take_over_has_one_force_and_names_its_model(
    live: Live, forces: Subscription, small_model: Path, calibrated: Path
) -> None:
    live.frame()
    assert live.set_model(calibrated).successful
    live.frame()
    found = taken(forces)
    assert [stamp_ns(each.header.stamp) for each in found] == [START_NS + i * PERIOD_NS for i in range(live.sent)]
    old, new = (model_file.load_model(file).model_id for file in (small_model, calibrated))
    names = [each.provenance.model_id for each in found]
    assert names[0] == old
    assert names[-1] == new
    assert names == sorted(names, key=[old, new].index)
    # What is computed changes with the name, in the same frame: 0.5 N of the one, 0.25 N of the other.
    assert [each.total for each in found] == pytest.approx([0.5 if name == old else 0.25 for name in names])


def test_forces_name_a_calibration_as_such(live: Live, forces: Subscription, calibrated: Path) -> None:
    live.frame()
    live.set_model(calibrated)
    live.frame()
    first, *_, last = (each.provenance for each in taken(forces))
    assert (first.calibration_id, first.gel) == ('', 'gel of the test')
    assert (last.calibration_id, last.gel, last.model) == (last.model_id, 'second', 'calibrated')


def test_undo_returns_to_the_model_before(live: Live, forces: Subscription, calibrated: Path) -> None:
    live.set_model(calibrated)
    answer = live.undo()
    live.frame()
    found = taken(forces)
    assert answer.success
    assert answer.message.startswith('back to small')
    assert found[-1].provenance.model == 'small'
    assert len(found) == live.sent
    assert live.node.params.model.endswith('small.safetensors')


def test_the_model_in_use_set_once_more_is_not_the_one_before(live: Live, calibrated: Path) -> None:
    """As by ``tactile param load`` of what ``tactile param dump`` wrote."""
    live.set_model(calibrated)
    assert live.set_model(calibrated).successful
    assert live.undo().message.startswith('back to small')


def test_who_undoes_twice_at_once_is_answered_twice(live: Live, forces: Subscription, calibrated: Path) -> None:
    live.set_model(calibrated)
    answers = live.calls('undo_calibration', services.TRIGGER, types.Trigger_Request(), 2)
    assert sorted(answer.success for answer in answers) == [False, True]
    assert any('no model to return to' in answer.message for answer in answers)
    live.frame()
    assert taken(forces)[-1].provenance.model == 'small'


def test_after_a_restart_undo_returns_to_the_model_that_the_calibration_came_from(
    bus: InProcessBus, clock: SteppedClock, publisher: Callable[[Topic], Publisher], calibrated: Path
) -> None:
    started_anew = Live(bus, clock, calibrated, publisher(topics.FLOW_FEATURES))
    assert started_anew.undo().message.startswith('back to small')


def test_undo_without_a_calibration_says_that_there_is_nothing_to_return_to(live: Live) -> None:
    answer = live.undo()
    assert not answer.success
    assert 'did not replace another model' in answer.message


def test_undo_refuses_a_file_that_holds_another_model_by_now(
    bus: InProcessBus, clock: SteppedClock, publisher: Callable[[Topic], Publisher], calibrated: Path, small_model: Path
) -> None:
    started_anew = Live(bus, clock, calibrated, publisher(topics.FLOW_FEATURES))
    changed(small_model, 'small', {'gel': {'id': 'third'}})
    answer = started_anew.undo()
    assert not answer.success
    assert 'replaced model' in answer.message


@pytest.mark.parametrize(
    ('card', 'reason'),
    [
        (
            {'flow': {'name': 'dis', 'options': {'preset': 'medium'}}},
            ': the flow dis with preset=medium and not preset=ultrafast;',
        ),
        ({'crop_px': 240}, ': 240x240 pixels and not 160x160 pixels;'),
    ],
)
def test_a_model_of_other_features_is_refused_and_the_one_in_use_stays(
    live: Live, forces: Subscription, small_model: Path, card: dict[str, Any], reason: str
) -> None:
    live.frame()
    result = live.set_model(changed(small_model, 'other', card))
    live.frame()
    assert not result.successful
    assert reason in result.reason
    assert {each.provenance.model for each in taken(forces)} == {'small'}
    assert live.node.params.model.endswith('small.safetensors')


def test_a_file_that_is_no_model_is_refused(live: Live, tmp_path: Path) -> None:
    (file := tmp_path / 'odd.safetensors').write_bytes(b'no model')
    assert 'is not a model of tactile_nodes' in live.set_model(file).reason


def test_who_comes_later_is_reported_the_model_in_use(
    live: Live, calibrated: Path, listen: Callable[[Topic], Subscription]
) -> None:
    live.set_model(calibrated)
    assert [each.model for each in taken(listen(topics.MODEL_IN_USE))] == ['calibrated']
