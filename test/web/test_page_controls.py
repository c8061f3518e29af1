"""What the buttons do."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.messages import services, types
from tactile_nodes.web import controls
from tactile_nodes.web.controls import Controls


@pytest.fixture
def bus() -> Iterator[InProcessBus]:
    made = InProcessBus()
    yield made
    made.close()


def serve(bus: InProcessBus, name: str, called: list[str], *, success: bool = True) -> None:
    def answer(_: types.Trigger_Request, reply: object) -> None:
        called.append(name)
        reply(types.Trigger_Response(success=success, message=f'answer of {name}'))

    bus.serve(name, services.TRIGGER, answer)


def test_each_action_calls_the_service_of_its_node(bus: InProcessBus) -> None:
    called: list[str] = []
    for name in ('/left/flow_features/capture_reference', '/left/recorder/start', '/left/recorder/stop'):
        serve(bus, name, called)
    acting = Controls(bus, '/left')
    outcomes = [acting.act(action) for action in (controls.REST_IMAGE, controls.START, controls.STOP)]
    assert called == ['/left/flow_features/capture_reference', '/left/recorder/start', '/left/recorder/stop']
    assert [outcome.done for outcome in outcomes] == [True, True, True]
    assert outcomes[1].text == 'answer of /left/recorder/start'


def test_a_rest_image_is_refused_while_something_touches(bus: InProcessBus) -> None:
    called: list[str] = []
    serve(bus, '/flow_features/capture_reference', called)
    outcome = Controls(bus).act(controls.REST_IMAGE, touching_n=0.43)
    assert (outcome.done, outcome.insistable, called) == (False, True, [])
    assert '0.430 N' in outcome.text


def test_a_person_may_insist_that_nothing_touches(bus: InProcessBus) -> None:
    called: list[str] = []
    serve(bus, '/flow_features/capture_reference', called)
    assert Controls(bus).act(controls.REST_IMAGE, touching_n=0.43, insist=True).done
    assert called == ['/flow_features/capture_reference']


def test_what_a_node_refuses_is_reported_in_its_words(bus: InProcessBus) -> None:
    serve(bus, '/recorder/stop', [], success=False)
    outcome = Controls(bus).act(controls.STOP)
    assert (outcome.done, outcome.text) == (False, 'answer of /recorder/stop')


def test_an_action_that_nobody_serves_is_one_sentence(bus: InProcessBus) -> None:
    outcome = Controls(bus).act(controls.START)
    assert not outcome.done
    assert 'no node offers the service /recorder/start' in outcome.text


def test_an_action_that_does_not_exist_calls_nothing(bus: InProcessBus) -> None:
    assert not Controls(bus).act('shutdown').done


def test_only_what_somebody_serves_is_available(bus: InProcessBus) -> None:
    serve(bus, '/recorder/start', [])
    found = Controls(bus).available(bus.graph())
    assert found == {controls.REST_IMAGE: False, controls.START: True, controls.STOP: False}
